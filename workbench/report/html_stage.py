"""The stage `report.html`: one page to sign under, complete in one file."""

from __future__ import annotations

import base64
import hashlib
import json
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from html.parser import HTMLParser
from typing import Any, ClassVar

import numpy as np
from markupsafe import Markup

from workbench.artefacts import Chapter, Document, Mark, Part, Provenance, Scene, Shading, Strokes
from workbench.artefacts.evidence import MOST_CHARACTERS, iso_date
from workbench.errors import InputError, one_line
from workbench.report.scene import everything_mm
from workbench.report.tables import WORST_FIRST, one_line_a_stage, shown_path
from workbench.report.text import render, source
from workbench.stage import stage
from workbench.units import AnyArray, Float, Int

FORBIDDEN = {"script", "style", "link", "iframe", "object", "embed", "base", "meta", "form"}
ADDRESSES = {"src", "srcset", "href", "xlink:href", "data", "poster", "background", "action", "formaction", "ping"}
WITHIN = ("data:image/", "#")  # pictures that the page holds, places in it
CALLS = ("url", "image", "\\", "@")  # in a style: what could fetch something, or hide that it does
BLOCK_POINTS = 8192
HALF_STEPS = 32_767  # of int16
SAMPLE, WINDOW = 50, 2048  # points whose nearest neighbour is looked for; among so many on either side, in order


class _Outside(HTMLParser):
    """Collects what reaches outside."""

    def __init__(self) -> None:
        super().__init__()
        self.found: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        if tag in FORBIDDEN:
            self.found.append(f"<{tag}>")
        for name, value in attrs:
            address = (value or "").strip()
            elsewhere = name in ADDRESSES and not address.startswith(WITHIN)
            fetches = name == "style" and any(call in address.lower() for call in CALLS)
            if elsewhere or fetches or name.startswith("on") or name == "srcdoc":
                self.found.append(f"<{tag} {name}={address[:40]!r}>")


def outside(html: str) -> str:
    """'' where the HTML needs nothing else, else the first thing that does."""
    parser = _Outside()
    parser.feed(html)
    parser.close()
    return parser.found[0] if parser.found else ""


@dataclass(frozen=True, slots=True)
class Sheet:
    """What an office writes on a certificate besides the measurement; None: nothing."""

    __pydantic_config__: ClassVar[Any] = {
        "extra": "forbid",
        "coerce_numbers_to_str": True,
        "str_max_length": MOST_CHARACTERS,
    }

    report_number: str | None = None
    issued_at: str | None = None  # ISO 8601
    customer: str | None = None
    order: str | None = None
    sensor_certificate: str | None = None  # number of its calibration certificate
    temperature_c: float | None = None  # of the part, while it was scanned

    def __post_init__(self) -> None:
        """The date must be one."""
        if self.issued_at is not None and iso_date(self.issued_at) is None:
            raise ValueError(f"issued_at: expected a date as 2026-03-31 (ISO 8601), got {self.issued_at!r}")


EMPTY_SHEET = Sheet()


@stage("report.html")
def html(
    chapters: tuple[Chapter, ...], provenance: Provenance | None = None, *, sheet: Sheet = EMPTY_SHEET
) -> Document:
    """The chapters as one self-contained page, `report.html`, with verdict and provenance.

    The overall verdict is the worst of the chapters. Chapters with a scene turn in the browser (WebGL 2; 300,000
    points).

    Args:
        chapters: what stages such as `report.inspection` and `report.plan` made, plug-ins' included.
        provenance: inputs, versions, pipeline and seed; the runner supplies it, without it the page says so.
        sheet: report number, issue date, customer, order, sensor's calibration certificate, temperature.

    Raises:
        InputError: no chapter, or one whose HTML reaches outside the page.

    Example:
        >>> from workbench import edge, inspect, report, scan
        >>> points = scan.fuse(scan.read(recording="data/synthetic/groove.h5"))
        >>> groove = edge.segment_groove(points)
        >>> chapter = report.groove(points, groove, inspect.groove(groove))
        >>> page = report.html([chapter])
        >>> page.name, page.content[:15]
        ('report.html', b'<!doctype html>')
    """
    if not chapters:
        raise InputError("report", "expected at least one chapter, such as report.inspection makes")
    for chapter in chapters:
        if found := outside(chapter.html):
            raise InputError(f"chapter '{chapter.title}'", f"expected HTML that is complete in itself, got {found}")
    return Document("report.html", page(chapters, provenance, sheet).encode())


def packed(scene: Scene, most: int) -> str:
    """JSON of a scene with its first `most` points at most; nothing in it ends a script or starts a tag."""
    origin = np.round(everything_mm(scene).mean(axis=0), 3)
    local = scene.points_mm[:most] - origin
    order = np.argsort(local @ scene.axes[0], kind="stable")
    local = local[order]
    content = {
        "origin": origin.tolist(),
        "axes": scene.axes.tolist(),
        "axes_names": scene.axes_names,
        "marks_are": scene.marks_are,
        **_points(local),
        "pitch_mm": round(pitch_mm(local), 4),
        "shadings": [_shading(each, order) for each in scene.shadings],
        "strokes": [_strokes(each, origin) for each in scene.strokes if each.lines_mm],
        "marks": [_mark(each, origin) for each in scene.marks],
        "frames": scene.frames,
    }
    text = json.dumps(content, allow_nan=False, ensure_ascii=True, separators=(",", ":"))
    return text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")


def pitch_mm(points_mm: Float) -> float:
    """How far a point is from its nearest neighbour, where they are sparse: nine in ten are nearer.

    points_mm: (n, 3), rising along one axis, so that neighbours are near in order too.
    """
    if len(points_mm) < 2:
        return 1.0
    nearest = []
    for k in range(0, len(points_mm), max(1, len(points_mm) // SAMPLE)):
        window = points_mm[max(0, k - WINDOW) : k + WINDOW]
        nearest.append(np.partition(((window - points_mm[k]) ** 2).sum(axis=1), 1)[1])  # the very nearest is itself
    return math.sqrt(float(np.percentile(nearest, 90.0)))


def _points(local_mm: Float) -> dict[str, Any]:
    """Blocks (middle x, y, z, step, number of points) and the coordinates in steps from the middle."""
    blocks, steps = [], []
    for block in np.array_split(local_mm, max(1, -(-len(local_mm) // BLOCK_POINTS))) if len(local_mm) else ():
        low, high = block.min(axis=0), block.max(axis=0)
        middle = np.round((low + high) / 2, 3)
        step = max(1e-6, float((np.abs(block - middle)).max()) / HALF_STEPS)
        blocks.append([*middle.tolist(), step, len(block)])
        steps.append(np.round((block - middle) / step).astype("<i2"))
    return {"blocks": blocks, "points": _text(np.vstack(steps) if steps else np.zeros(0, "<i2"))}


def _shading(shading: Shading, order: Int) -> dict[str, Any]:
    palette = np.zeros((256, 3), np.uint8)
    palette[: len(shading.palette)] = shading.palette
    return {
        "name": shading.name,
        "palette": _text(palette),
        "index": _text(shading.index[order]),
        "legend": shading.legend,
    }


def _strokes(strokes: Strokes, origin: Float) -> dict[str, Any]:
    """Points of all lines, and red, green, blue and whether a line leads to the point (0 at a line's first one)."""
    rgba = [np.column_stack([colour, np.full(len(colour), 255)]) for colour in strokes.colours]
    for colour in rgba:
        colour[0, 3] = 0
    motion = {} if strokes.moved is None else {"moved": _text(_about(strokes.moved, origin).astype("<f4"))}
    return {
        **motion,
        "name": strokes.name,
        "shown": strokes.shown,
        "points": _text((np.vstack(strokes.lines_mm) - origin).astype("<f4")),
        "colours": _text(np.vstack(rgba).astype(np.uint8)),
    }


def _about(moved: Float, origin: Float) -> Float:
    """Motions (f, 4, 4) of places that count from `origin`, column after column."""
    pose = moved.copy()
    pose[:, :3, 3] += moved[:, :3, :3] @ origin - origin
    return np.swapaxes(pose, 1, 2)


def _mark(mark: Mark, origin: Float) -> dict[str, Any]:
    return {
        "key": mark.key,
        "place": np.round(mark.place_mm - origin, 3).tolist(),
        "outline": np.round(mark.outline_mm - origin, 3).tolist(),
        "colour": mark.colour,
        "facts": mark.facts,
    }


def _text(array: AnyArray) -> str:
    return base64.b64encode(np.ascontiguousarray(array).tobytes()).decode()


SCENE_POINTS = 300_000  # on the page, all scenes together
DIGITS, MOST_FILES = 16, 3  # of a digest and of inputs on the first page
MOST_OPEN = 6  # of what was not checked, beside a certificate


def page(chapters: Sequence[Chapter], provenance: Provenance | None, sheet: Sheet = EMPTY_SHEET) -> str:
    """The whole page."""
    parts = sorted(_parts(chapters), key=lambda part: part.part_id is None)
    about = "part" if any(chapter.part and chapter.about == "part" for chapter in chapters) else "instruments"
    count = sum(chapter.scene is not None for chapter in chapters)  # that share the points alike
    viewer = viewer_script() if count else Markup("")
    return render(
        "page.html.j2",
        style=source("page.css"),
        viewer=viewer,
        policy=policy(viewer),
        scenes=[Markup(packed(one.scene, SCENE_POINTS // count) if one.scene else "") for one in chapters],
        in_space=next((k for k, chapter in enumerate(chapters) if chapter.scene), None),  # report.html#view: that alone
        heading=_heading(parts if about == "part" else (), provenance),
        identity=Markup(identity_html(parts[0], about, sheet)) if parts else "",
        foot=css_text(f"report {shortened(sheet.report_number)}") if sheet.report_number else "",
        simulated=any(part.simulated for part in parts),
        certificate=next((Markup(chapter.certificate) for chapter in chapters if chapter.certificate), ""),
        title=provenance.title if provenance else "",
        verdict=overall(chapters),
        chapters=chapters,
        warnings=_warnings(chapters),
        not_checked=_not_checked(chapters),
        provenance=provenance,
        inputs=[(name, shown_path(path), digest) for name, path, digest in provenance.inputs] if provenance else [],
        data=_data(provenance) if provenance else [],
        versions=sorted(provenance.versions.items()) if provenance else [],
        pipeline=one_line_a_stage(provenance.pipeline) if provenance else "",
    )


def _data(provenance: Provenance) -> list[str]:
    """What binds the first page to its data and to what evaluated them."""
    files = [f"{shown_path(path)}, SHA-256 {digest[:DIGITS]}…" for _, path, digest in provenance.inputs]
    more = [f"{len(files) - MOST_FILES} further files (annex)"] if len(files) > MOST_FILES else []
    return [*files[:MOST_FILES], *more, f"evaluated by workbench {provenance.versions.get('workbench', '')}".rstrip()]


def _parts(chapters: Sequence[Chapter]) -> list[Part]:
    """The parts that the chapters are about; that of the certificate first."""
    ranked = sorted(chapters, key=lambda chapter: not chapter.certificate)
    named = (chapter.part for chapter in ranked if chapter.part)
    return list(dict.fromkeys(Part(part_id=part) if isinstance(part, str) else part for part in named))


def _heading(parts: Sequence[Part], provenance: Provenance | None) -> str:
    """The parts by name; where none has one, what was done."""
    names = list(dict.fromkeys(shortened(part.part_id) for part in parts if part.part_id))
    if names or parts:
        return one_line(", ".join(names)) or "Part without identification"
    return provenance.title if provenance else "Report"


def policy(script: str) -> str:
    """What a browser lets the page do (Content-Security-Policy): its own pictures and styles, this one script."""
    scripts = script_source(script)
    return f"default-src 'none'; base-uri 'none'; img-src data:; style-src 'unsafe-inline'; script-src {scripts}"


def script_source(script: str) -> str:
    """This script and no other, as a policy names it."""
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    return f"'sha256-{digest}'" if script else "'none'"


def viewer_script() -> Markup:
    """What turns a scene in the browser: the only script of a page."""
    return source("painter.js") + source("viewer.js")


def overall(chapters: Sequence[Chapter]) -> str:
    """The worst verdict of the chapters that decide something; '' where none does."""
    given = {chapter.verdict for chapter in chapters}
    return next((verdict for verdict in WORST_FIRST if verdict in given), "")


def _not_checked(chapters: Sequence[Chapter]) -> list[str]:
    """What was not checked, each once; beside a certificate, what its page has room for."""
    texts = list(dict.fromkeys(one_line(text) for chapter in chapters for text in chapter.not_checked))
    if len(texts) <= MOST_OPEN or not any(chapter.certificate for chapter in chapters):
        return texts
    return [*texts[:MOST_OPEN], f"and {len(texts) - MOST_OPEN} more: toolpath.json and the program's head"]


def _warnings(chapters: Sequence[Chapter]) -> list[str]:
    """Each once; named by chapter where there are several, since two edges may have the same to say."""
    several = len(chapters) > 1
    return list(dict.fromkeys(f"{c.title}: {text}" if several else text for c in chapters for text in c.warnings))


# Whose measurement it is, as the first page says it: part, people, instruments, calibrations.

ALWAYS = ("Recorded", "Operator", "Robot")  # told of instruments, known or not
SHOWN = 60  # characters of a name
DAYS_A_YEAR = 365.25


def identity_html(part: Part, about: str = "part", sheet: Sheet = EMPTY_SHEET) -> str:
    """What is known of the part, or of the instruments alone, and what is not."""
    rows = [*identity_rows(part), *calibration_rows(part, sheet)]
    shown = [(name, value, known) for name, value, known in rows if about == "part" or known or name in ALWAYS]
    return render("identity.html.j2", rows=[*office_rows(sheet), *shown])


def office_rows(sheet: Sheet) -> Iterator[tuple[str, str, bool]]:
    """What an office gave, as identity_rows."""
    issued = sheet.issued_at and sheet.issued_at.partition("T")[0]
    given = (sheet.report_number, issued, sheet.customer, sheet.order)
    for name, value in zip(("Report number", "Issued", "Customer", "Order"), given, strict=True):
        if value:
            yield name, shortened(value), True


def identity_rows(part: Part) -> Iterator[tuple[str, str, bool]]:
    """Name, value and whether it is known."""
    for name, value in (
        ("Part", part.part_id),
        ("Drawing", part.drawing),
        ("Recorded", part.recorded_at and part.recorded_at.replace("T", " ")),
        ("Operator", part.operator),
    ):
        yield name, shortened(value) if value else "unknown", bool(value)
    if part.simulated is False:  # of a simulated one the page's head and foot say so
        yield "Kind of part", "real", True


def calibration_rows(part: Part, sheet: Sheet = EMPTY_SHEET) -> Iterator[tuple[str, str, bool]]:
    """Instruments, their calibrations, and the part's temperature; as identity_rows."""
    yield "Sensor", instrument(part.sensor, part.sensor_serial), part.sensor is not None
    calibrated = dated(part.sensor_calibrated_at, part.recorded_at)
    certificate = f"certificate {shortened(sheet.sensor_certificate)}; " if sheet.sensor_certificate else ""
    when = f"{calibrated}; interval unknown" if calibrated else "date unknown" if certificate else "unknown"
    yield "Sensor calibrated", certificate + when, bool(calibrated)
    yield "Robot", instrument(part.robot, part.robot_serial), part.robot is not None
    yield "Hand-eye calibration", hand_eye(part), part.hand_eye is not None
    if sheet.temperature_c is not None:
        yield "Temperature", f"{sheet.temperature_c:g} °C", True


def instrument(name: str | None, serial: str | None) -> str:
    """An instrument and its serial number."""
    number = f"serial number {shortened(serial)}" if serial else "serial number unknown"
    return f"{shortened(name)}, {number}" if name else f"unknown, {number}" if serial else "unknown"


def hand_eye(part: Part) -> str:
    """The hand-eye calibration in use: from where, of when, how good."""
    if part.hand_eye is None:
        return "unknown"
    when = dated(part.hand_eye_calibrated_at, part.recorded_at) or "date unknown"
    good = f"{part.hand_eye_u_mm:.3f} mm over the field of view" if part.hand_eye_u_mm is not None else "unknown"
    return f"{shortened(part.hand_eye)}, {when}; u {good}"


def dated(day: str | None, of: str | None) -> str:
    """A date, and how long before the recording it was; '' where there is none."""
    if day is None:
        return ""
    then, now = iso_date(day), iso_date(of) if of else None
    if then is None or now is None:
        return day.partition("T")[0]
    days = (now - then).days
    age = f"{days} days" if abs(days) < DAYS_A_YEAR else f"{days / DAYS_A_YEAR:.1f} years"
    return f"{then}, {age} before" if days >= 0 else f"{then}, after the recording"


def shortened(text: str | None) -> str:
    """A name out of a file on one line, cut where it is long."""
    text = one_line(text or "")
    return text if len(text) <= SHOWN else text[: SHOWN - 1] + "…"


def css_text(text: str) -> Markup:
    """A text as a string of CSS in which every character that could mean something is escaped."""
    return Markup('"' + "".join(c if c.isalnum() or c == " " else f"\\{ord(c):x} " for c in text) + '"')
