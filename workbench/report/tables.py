"""What stands in the report's tables and sentences, as text."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import PurePath, PurePosixPath, PureWindowsPath
from typing import Any

import numpy as np

from workbench.artefacts import Check, Cloud, Edge, Inspection
from workbench.errors import one_line
from workbench.report.along import PlanView, hidden_stretches
from workbench.report.text import decimals, measured
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
