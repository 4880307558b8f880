"""What stands in the report's tables and sentences, as text."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import PurePath, PurePosixPath, PureWindowsPath
from typing import Any

import numpy as np

from workbench.artefacts import (
    FACE_NAMES,
    ROOT_FACE,
    Characteristic,
    Check,
    Cloud,
    Edge,
    Inspection,
    JointInspection,
    RawEdge,
    Unseen,
    Verdict,
    u_name,
)
from workbench.artefacts.edges import RecognisedInspection
from workbench.errors import one_line
from workbench.marks import FACES, VERDICTS
from workbench.report.along import PlanView, hidden_stretches
from workbench.report.text import alike, data_address, decimals, measured, render, source
from workbench.units import COVERAGE, Float


def facts(cloud: Cloud, edge: Edge) -> Iterator[tuple[str, str]]:
    """What the report is about: name and value."""
    frames, columns = cloud.x_mm.shape
    passes = len(np.unique(cloud.pass_index))
    yield "Recording", one_line(PurePath(cloud.source).name) or "not named"
    yield "Scan", f"{frames:,} frames × {columns:,} columns, {passes} pass{'es' if passes > 1 else ''}"
    yield "Points kept", f"{np.count_nonzero(cloud.keep):,}"
    yield "Edge", f"{np.ptp(edge.arc_length_mm):.1f} mm long, {100.0 * np.mean(edge.seen):.0f} % of it seen"


HIDDEN = "hidden"  # in place of a value


def verdicts_found(inspection: JointInspection) -> list[tuple[str, str]]:
    """Verdicts of sections, as they are drawn."""
    found = {section.verdict for section in inspection.sections}
    return [one for one in VERDICTS.items() if one[0] in found]


def section_rows(inspection: JointInspection, found: Sequence[Characteristic]) -> list[dict[str, Any]]:
    """One row per section: some of its sizes with their expanded uncertainties, its verdict."""
    columns = [(one.pairs, decimals(pair and pair[1] for pair in one.pairs)) for one in found]
    rows = [
        [HIDDEN if (pair := pairs[k]) is None else measured(pair[0], pair[1], places) for pairs, places in columns]
        for k in range(len(inspection.sections))
    ]
    return [
        {
            "index": s.index,
            "arc_length_mm": s.arc_length_mm,
            "cells": cells,
            "verdict": s.verdict,
            "reason": s.reason,
            # what of its reason speaks against it
            "because": ""
            if s.verdict == "pass" or {*cells} == {HIDDEN}
            else one_line(", ".join(part for part in s.reason.split(", ") if "within tolerance" not in part)),
        }
        for s, cells in zip(inspection.sections, rows, strict=True)
    ]


def exclusions(cloud: Cloud, edge: Edge) -> Iterator[tuple[str, str, str]]:
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
MOST_UNSEEN = 3  # that are told on the page
MOST_ROWS = 12  # sections on the page
WORST_FIRST = ("fail", "undecided", "pass")


NOT_JUDGED = "No specification was stated: the joint was measured, conformity was not assessed."
MOST_SIZES = 2  # whose sections the certificate has room for


def certificate_html(inspection: JointInspection) -> str:
    """What stands on the first page between who and what was measured and the signature."""
    found = inspection.characteristics
    judged, known = bool(inspection.required), inspection.uncertainty
    shown = least_favourable(inspection) if len(found) <= MOST_SIZES else set()
    sources, totals = budget(inspection)
    return render(
        "certificate.html.j2",
        verdict=inspection.verdict if judged else "",
        statement=STATEMENTS[inspection.verdict] if judged else NOT_JUDGED,
        reason=one_line(inspection.reason[:1].upper() + inspection.reason[1:]).rstrip(".") if judged else "",
        recognised=inspection if isinstance(inspection, RecognisedInspection) else None,
        specification=[row for one in found for row in specification(one)],
        heads=list(map(head, found)),
        sections=[row for row in section_rows(inspection, found) if row["index"] in shown],
        left_out=len(inspection.sections) - len(shown),
        count=len(inspection.sections),
        budget=sources,
        totals=totals,
        correlations=known.correlations,
        not_included=_dearest(known.not_included),
        decision_rule=decision_rule(inspection.guard_factor) if judged else "",
        terms=data_address(source("bevel_terms.svg").encode()) if isinstance(inspection, Inspection) else "",
    )


def _dearest(unseen: Sequence[Unseen]) -> list[str]:
    """What the page has room for of what U does not hold; the result file has all of it."""
    rest = len(unseen) - MOST_UNSEEN
    return [one.told for one in unseen[:MOST_UNSEEN]] + ([f"{rest} more: see the result file."] if rest > 0 else [])


def least_favourable(inspection: JointInspection) -> set[int]:
    """Indices of the sections that the page has room for, by verdict; all where they are few."""
    ranked = sorted(inspection.sections, key=lambda s: (WORST_FIRST.index(s.verdict), s.index))
    return {section.index for section in ranked[:MOST_ROWS]}


def head(one: Characteristic) -> str:
    """Letter of a size, or its term where it has none."""
    return one.letter if one.letter != "–" else one.term


def unit_of(one: Characteristic) -> str:
    """' mm' or '°', as it follows a value."""
    return "°" if one.is_angle else " mm"


def specification(one: Characteristic) -> Iterator[tuple[str, ...]]:
    """A row a characteristic: name, letter, nominal, limits, lowest and highest section, largest U."""
    known = [pair for pair in one.pairs if pair is not None]
    if not known and one.required is None:
        return
    places, unit = decimals(u for _, u in known), unit_of(one)
    ends = [measured(end(value for value, _ in known), None, places) + unit if known else "–" for end in (min, max)]
    wide = f"{COVERAGE * max(u for _, u in known):.{places}f}{unit}" if known else "–"
    nominal, zone = "–", "not specified"
    if one.required is not None and one.limits is not None:
        low, middle, high = alike(one.limits[0], one.required[0], one.limits[1])
        nominal, zone = f"{middle}{unit}", f"{low} to {high}{unit}"
    yield one.term, one.letter, nominal, zone, *ends, wide


def budget(inspection: JointInspection) -> tuple[list[tuple[str, ...]], list[tuple[str, ...]]]:
    """A row a source, its u of every size; and the combined and the expanded uncertainty of each largest section."""
    largest = []
    for one in inspection.characteristics:
        u = max((pair[1] for pair in one.pairs if pair), default=math.nan)
        largest.append((u_name(one.name), u, decimals([u], 1.0, 6)))
    k = inspection.uncertainty.coverage_factor
    return [
        (row["name"], row["kind"], *(small(row.get(name, 0.0), places) for name, _, places in largest))
        for row in inspection.sources
    ], [
        ("Combined u", "", *(small(u, places) for _, u, places in largest)),
        (f"Expanded U = {k:g} u", "", *(small(k * u, places) for _, u, places in largest)),
    ]


def small(u: float, places: int) -> str:
    """An uncertainty; '–' for none, '< 0.001' where the decimals do not show it."""
    if not u > 0.0 or not math.isfinite(u):
        return "–"
    return f"{u:.{places}f}" if u >= 0.5 * 10.0**-places else f"< {10.0**-places:.{places}f}"


def decision_rule(guard_factor: float) -> str:
    """The decision rule of ISO 14253-1 in words, with the risk that its guard band leaves."""
    risk = 50.0 * math.erfc(guard_factor / math.sqrt(2.0))
    return (
        f"ISO 14253-1, guard band g = {guard_factor:g} u: a value passes inside its limits by at least g, fails "
        f"outside by at least g, is undecided in between. Risk of a wrong statement: at most "
        f"{risk:.2g} % per value. A part fails if any section fails and passes if all pass."
    )


def faces_seen(edge: Edge) -> list[tuple[str, str]]:
    """Name and colour of each face that some of a few hundred frames show."""
    labels = np.unique(edge.labels[:: max(1, len(edge.labels) // 300)])
    names = {ROOT_FACE: "end face"} if isinstance(edge, RawEdge) else {}
    return [(names.get(face, FACE_NAMES[face]), FACES[face]) for face in FACES if face in labels]
