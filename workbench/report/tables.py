"""What stands in the report's tables and sentences, as text."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import PurePath, PurePosixPath, PureWindowsPath
from typing import Any

import numpy as np

from workbench.artefacts import (
    BEVEL_FACE,
    FACE_NAMES,
    ROOT_FACE,
    Check,
    Cloud,
    Edge,
    Inspection,
    RawEdge,
    Section,
    Uncertainty,
    Verdict,
)
from workbench.errors import one_line
from workbench.report.along import PlanView, hidden_stretches
from workbench.report.marks import FACES, REJECTED, VERDICTS
from workbench.report.section_drawing import of_interest
from workbench.report.text import COVERAGE, alike, data_address, decimals, measured, render, source
from workbench.units import Float


def facts(cloud: Cloud, edge: Edge) -> Iterator[tuple[str, str]]:
    """What the report is about: name and value."""
    frames, columns = cloud.x_mm.shape
    passes = len(np.unique(cloud.pass_index))
    yield "Recording", one_line(PurePath(cloud.source).name) or "not named"
    yield "Scan", f"{frames:,} frames × {columns:,} columns, {passes} pass{'es' if passes > 1 else ''}"
    yield "Points kept", f"{np.count_nonzero(cloud.keep):,}"
    yield "Edge", f"{np.ptp(edge.arc_length_mm):.1f} mm long, {100.0 * np.mean(edge.seen):.0f} % of it seen"


def section_rows(inspection: Inspection) -> list[dict[str, Any]]:
    """A row a section, values with their expanded uncertainties."""
    root = decimals(s.root_u_mm for s in inspection.sections)
    bevel = decimals(s.bevel_u_deg for s in inspection.sections)
    return [
        {
            "index": s.index,
            "arc_length_mm": s.arc_length_mm,
            "root": measured(s.root_mm, s.root_u_mm, root),
            "bevel": measured(s.bevel_deg, s.bevel_u_deg, bevel),
            "verdict": s.verdict,
            "reason": s.reason,
            "because": "" if s.verdict == "pass" else _because(s.reason),
        }
        for s in inspection.sections
    ]


def set_aside(cloud: Cloud, edge: Edge) -> Iterator[tuple[str, str, str]]:
    """Rejected points by cause, hidden stretches and burrs: what, how much, where."""
    returns = int(np.count_nonzero(cloud.keep)) + sum(cloud.rejected.values())
    for cause, count in sorted(cloud.rejected.items()):
        yield (
            f"Rejected: {one_line(cause)}",
            f"{count:,} points",
            f"{100.0 * count / max(1, returns):.3f} % of all returns",
        )
    hidden = hidden_stretches(edge)
    total = sum(end - start for start, end in hidden)
    yield "Hidden stretches", f"{total:.1f} mm", "; ".join(f"{a:.1f} to {b:.1f} mm" for a, b in hidden) or "none"
    burrs = edge.arc_length_mm[edge.burr_stations]
    yield "Burrs", f"{len(burrs)} stations", ", ".join(_runs(burrs)) or "none"


def _runs(arc_length_mm: Float) -> Iterator[str]:
    """Arc lengths in mm as runs of neighbours: '31 to 32 mm'."""
    for run in np.split(arc_length_mm, np.flatnonzero(np.diff(arc_length_mm) > 2.0) + 1):
        if len(run):
            yield f"{run[0]:.0f} mm" if len(run) == 1 else f"{run[0]:.0f} to {run[-1]:.0f} mm"


def _because(reason: str) -> str:
    """What of a section's reason speaks against it."""
    against = [part for part in reason.split(", ") if "within tolerance" not in part and "hidden" not in part]
    if "hidden" in reason:
        against.append("hidden")
    return one_line(", ".join(against))


def check_rows(checks: Iterable[Check], passed: bool) -> list[tuple[str, ...]]:
    """A row a check that passed, or that did not: name, value, limits; why the limit is there, or what was found.

    Of a check that is told only the finding is all there is to say.
    """
    return [
        (
            *check_texts(check.name, check.value, check.limit),
            one_line(check.reason if passed and check.limit is not None else check.finding or check.reason),
        )
        for check in checks
        if check.passed == passed
    ]


CHECK_UNITS = {"_mm_s": " mm/s", "_mm": " mm", "_deg": "°", "_ms": " ms", "_s": " s"}


def check_texts(name: str, value: float | None, limit: float | Sequence[float] | None) -> tuple[str, str, str]:
    """Name, value and limit of a check, the unit taken from its name: 'obliquity', '3.869°', 'at most 20°'."""
    ending = next((one for one in CHECK_UNITS if name.endswith(one)), "")
    unit = CHECK_UNITS.get(ending, "")

    def text(number: float) -> str:
        return (f"{number:.0f}" if abs(number) >= 1e4 else f"{number:.4g}") + unit

    least, most = limit if isinstance(limit, Sequence) else (None, limit)
    bounds = "–" if most is None else f"at most {text(most)}" if least is None else f"{text(least)} to {text(most)}"
    return name.removesuffix(ending).replace("_", " "), "–" if value is None else text(value), bounds


def plan_note(plan: PlanView) -> str:
    """What the plan view leaves out."""
    searched = "All frames" if plan.every_frame == 1 else f"One frame in {plan.every_frame}"
    beyond = f"; {plan.outside:,} rejected points lie outside the picture" if plan.outside else ""
    return f"{searched} searched{beyond}."


def shown_path(path: str) -> str:
    """A path as a page shows it: a relative one as given, of an absolute one the name alone."""
    for kind in (PurePosixPath, PureWindowsPath):
        if kind(path).is_absolute():
            return kind(path).name or path
    return path


def _without_folders(value: Any) -> Any:
    """A pipeline's value with absolute paths shown by name."""
    if isinstance(value, Mapping):
        return {key: _without_folders(one) for key, one in value.items()}
    if isinstance(value, Sequence) and not isinstance(value, str):
        return [_without_folders(one) for one in value]
    return shown_path(str(value)) if isinstance(value, str | PurePath) else value


def one_line_a_stage(pipeline: Mapping[str, Any]) -> str:
    """A pipeline as JSON that is still JSON, laid out to be read: a line for each stage and each other key."""

    def compact(value: Any) -> str:
        return json.dumps(_without_folders(value), default=str, ensure_ascii=False)

    lines = []
    for key, value in pipeline.items():
        several = key == "stages" and isinstance(value, Sequence)
        shown = "[\n    " + ",\n    ".join(map(compact, value)) + "\n  ]" if several else compact(value)
        lines.append(f"  {compact(key)}: {shown}")
    return "{\n" + ",\n".join(lines) + "\n}"


STATEMENTS: dict[Verdict, str] = {
    "pass": "Conformity with the specification is verified.",
    "fail": "Nonconformity with the specification is verified.",
    "undecided": "Neither conformity nor nonconformity with the specification is verified.",
}
MOST_ROWS = 12  # sections on the page
WORST_FIRST = ("fail", "undecided", "pass")


def certificate_html(inspection: Inspection) -> str:
    """What stands on the first page between who and what was measured and the signature."""
    shown = least_favourable(inspection)
    known = inspection.uncertainty
    sources, totals = budget(known, inspection.sections)
    return render(
        "certificate.html.j2",
        verdict=inspection.verdict,
        statement=STATEMENTS[inspection.verdict],
        reason=one_line(inspection.reason[:1].upper() + inspection.reason[1:]).rstrip("."),
        specification=specification(inspection),
        sections=[row for row in section_rows(inspection) if row["index"] in shown],
        left_out=len(inspection.sections) - len(shown),
        count=len(inspection.sections),
        budget=sources,
        totals=totals,
        correlations=known.correlations,
        not_included=known.not_included,
        decision_rule=decision_rule(inspection.guard_factor),
        terms=data_address(source("bevel_terms.svg").encode()),
    )


def least_favourable(inspection: Inspection) -> set[int]:
    """Indices of the sections that the page has room for, by verdict; all where they are few."""
    ranked = sorted(inspection.sections, key=lambda s: (WORST_FIRST.index(s.verdict), s.index))
    return {section.index for section in ranked[:MOST_ROWS]}


def specification(inspection: Inspection) -> list[tuple[str, ...]]:
    """A row a characteristic: name, symbol, nominal, limits, lowest and highest section, largest U."""
    needs, sections = inspection.requirements, inspection.sections
    rows = []
    for name, symbol, unit, nominal, (lower, upper), values, u in (
        (
            "Root face",
            "c",
            " mm",
            needs.root_nominal_mm,
            needs.root_tolerance_mm,
            [s.root_mm for s in sections],
            [s.root_u_mm for s in sections],
        ),
        (
            "Bevel angle",
            "β",
            "°",
            needs.bevel_nominal_deg,
            needs.bevel_tolerance_deg,
            [s.bevel_deg for s in sections],
            [s.bevel_u_deg for s in sections],
        ),
    ):
        places, known = decimals(u), [value for value in values if value is not None]
        ends = [measured(end(known), None, places) + unit if known else "–" for end in (min, max)]
        largest = max((one for one in u if one is not None), default=None)
        wide = "–" if largest is None else f"{COVERAGE * largest:.{places}f}{unit}"
        low, middle, high = alike(nominal + lower, nominal, nominal + upper)
        rows.append((name, symbol, f"{middle}{unit}", f"{low} to {high}{unit}", *ends, wide))
    rows.append(("Depth of preparation", "h", "t − c", "not specified", "–", "–", "–"))
    return rows


def budget(known: Uncertainty, sections: tuple[Section, ...]) -> tuple[list[tuple[str, ...]], list[tuple[str, ...]]]:
    """A row a source; and the combined and the expanded uncertainty of the section that has the largest."""
    largest = [
        max((u for s in sections if (u := getattr(s, name)) is not None), default=math.nan)
        for name in ("root_u_mm", "bevel_u_deg")
    ]
    root, bevel = (_places(u) for u in largest)
    k = known.coverage_factor
    return [(s.name, s.kind, small(s.root_u_mm, root), small(s.bevel_u_deg, bevel)) for s in known.sources], [
        ("Combined standard uncertainty u", "", small(largest[0], root), small(largest[1], bevel)),
        (f"Expanded U = k u, coverage factor k = {k:g}", "", small(k * largest[0], root), small(k * largest[1], bevel)),
    ]


def _places(u: float) -> int:
    """Decimals that show two significant digits of an uncertainty."""
    return min(6, max(1, 1 - math.floor(math.log10(u)))) if u > 0.0 and math.isfinite(u) else 3


def small(u: float, places: int) -> str:
    """An uncertainty; '–' for none, '< 0.001' where the decimals do not show it."""
    if not u > 0.0 or not math.isfinite(u):
        return "–"
    return f"{u:.{places}f}" if u >= 0.5 * 10.0**-places else f"< {10.0**-places:.{places}f}"


def decision_rule(guard_factor: float) -> str:
    """The decision rule of ISO 14253-1 in words, with the risk that its guard band leaves."""
    risk = 50.0 * math.erfc(guard_factor / math.sqrt(2.0))
    return (
        f"ISO 14253-1 with the guard band g = {guard_factor:g} u. Conformity of a value is verified inside the limits "
        "by at least g (pass), nonconformity outside by at least g (fail). In between, in the uncertainty zone, "
        f"neither is verified (undecided). The risk of a wrong statement is at most {risk:.2g} % for each value. "
        "A part fails if any section fails; it passes if all sections pass."
    )


def inspection_html(
    cloud: Cloud, edge: Edge, inspection: Inspection, drawn: Mapping[str, bytes], aside: PlanView
) -> str:
    """The chapter; `drawn`: PNG or SVG of `overview`, `close_up`, `sections`, `root` and `angle`."""
    return render(
        "inspection.html.j2",
        facts=list(facts(cloud, edge)),
        pictures={name: data_address(content) for name, content in {**drawn, "plan": aside.svg}.items()},
        of_interest=of_interest(inspection).index,
        sections=section_rows(inspection) if len(inspection.sections) > MOST_ROWS else [],
        failed_checks=check_rows(inspection.checks, passed=False),
        passed_checks=check_rows(inspection.checks, passed=True),
        set_aside=list(set_aside(cloud, edge)),
        plan_note=plan_note(aside),
        tilt={"whole edge": "once for the whole edge", "per section": "section by section"}.get(
            inspection.root_face_tilt, inspection.root_face_tilt
        ),
        guard_factor=inspection.guard_factor,
        faces=faces_seen(edge),
        verdicts=[(name, VERDICTS[name]) for name in VERDICTS if any(s.verdict == name for s in inspection.sections)],
        root_colour=FACES[ROOT_FACE],
        bevel_colour=FACES[BEVEL_FACE],
        rejected_colour=REJECTED,
    )


def faces_seen(edge: Edge) -> list[tuple[str, str]]:
    """Name and colour of each face that some of a few hundred frames show."""
    labels = np.unique(edge.labels[:: max(1, len(edge.labels) // 300)])
    names = {ROOT_FACE: "end face"} if isinstance(edge, RawEdge) else {}
    return [(names.get(face, FACE_NAMES[face]), FACES[face]) for face in FACES if face in labels]
