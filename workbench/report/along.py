"""Charts over arc length: root face and bevel angle with tolerance and uncertainty (the paper's Figs. 20 and 21)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from workbench.artefacts import Edge, Inspection, Section
from workbench.report.colours import INK, LIMIT, MEASURED, TOLERANCE, VERDICTS
from workbench.report.figures import hatch_hidden, mark_sections, svg
from workbench.report.plot import Axes, Figure
from workbench.report.values import COVERAGE, alike
from workbench.units import Bool, Float, Shaped


@dataclass(frozen=True, slots=True, eq=False)
class Characteristic:
    """One measured quantity along the edge and what is required of it."""

    label: str
    unit: str
    value: Shaped[Float, " n"]
    u: Shaped[Float, " n"]  # standard uncertainty
    at_sections: list[tuple[Section, float, float]]  # measured sections: value, standard uncertainty
    nominal: float
    tolerance: tuple[float, float]


def root_chart(edge: Edge, inspection: Inspection) -> bytes:
    """SVG of the root face along the edge."""
    profile, required = inspection.profile, inspection.requirements
    at = [(s, s.root_mm, s.root_u_mm) for s in inspection.sections if s.root_mm is not None and s.root_u_mm is not None]
    root = Characteristic(
        "root face", " mm", profile.root_mm, profile.root_u_mm, at, required.root_nominal_mm, required.root_tolerance_mm
    )
    return _chart(root, edge, inspection)


def angle_chart(edge: Edge, inspection: Inspection) -> bytes:
    """SVG of the bevel angle along the edge."""
    profile, required = inspection.profile, inspection.requirements
    at = [
        (s, s.bevel_deg, s.bevel_u_deg)
        for s in inspection.sections
        if s.bevel_deg is not None and s.bevel_u_deg is not None
    ]
    angle = Characteristic(
        "bevel angle",
        "°",
        profile.bevel_deg,
        profile.bevel_u_deg,
        at,
        required.bevel_nominal_deg,
        required.bevel_tolerance_deg,
    )
    return _chart(angle, edge, inspection)


def hidden_stretches(edge: Edge) -> list[tuple[float, float]]:
    """Arc lengths, mm, from the last station seen before each gap to the first one seen after it."""
    return gaps(edge.arc_length_mm, edge.seen)


def gaps(s: Float, seen: Bool) -> list[tuple[float, float]]:
    """The stretches of `s` (n,) between what was `seen` (n,), from the last value seen to the next one."""
    change = np.flatnonzero(np.diff(seen.astype(np.int8)))
    starts = [int(k) for k in change if seen[k]]
    ends = [int(k) + 1 for k in change if not seen[k]]
    if len(s) and not seen[0]:
        starts.insert(0, 0)
    if len(s) and not seen[-1]:
        ends.append(len(s) - 1)
    return [(float(s[a]), float(s[b])) for a, b in zip(starts, ends, strict=True)]


def _chart(what: Characteristic, edge: Edge, inspection: Inspection) -> bytes:
    s = inspection.profile.arc_length_mm
    figure = Figure(figsize=(10, 2.8))
    axes = figure.add_axes((0.068, 0.15, 0.8, 0.76))
    axes.set_xlim(0.0, float(s[-1]))
    _draw_tolerance(axes, what, s, inspection.guard_factor)
    mark_sections(axes, [x.arc_length_mm for x in inspection.sections], [str(x.index) for x in inspection.sections])
    hatch_hidden(axes, hidden_stretches(edge))
    _draw_measured(axes, what, s)
    axes.set_xlabel("arc length along the lower edge, mm")
    axes.set_ylabel(f"{what.label}, {what.unit.strip()}")
    return svg(figure)


def _draw_tolerance(axes: Axes, what: Characteristic, s: Float, guard_factor: float) -> None:
    """Tolerance zone, its limits and the nominal value; inside it the limits less the guard band."""
    lower, upper = (what.nominal + deviation for deviation in what.tolerance)
    axes.axhspan(lower, upper, color=TOLERANCE, zorder=0.1)
    guard = guard_factor * what.u
    low, middle, high = alike(lower, what.nominal, upper)
    for level, name, inside in ((upper, f"upper limit {high}", -1.0), (lower, f"lower limit {low}", 1.0)):
        axes.axhline(level, color=LIMIT, linewidth=1.2, zorder=1)
        axes.plot(s, level + inside * guard, color=LIMIT, linewidth=0.8, dashes=(4, 2.5), zorder=1)
        _label_level(axes, level, name + what.unit)
    axes.axhline(what.nominal, color=LIMIT, linewidth=0.7, dashes=(8, 2, 1.5, 2), zorder=1)
    _label_level(axes, what.nominal, f"nominal {middle}{what.unit}")


def _draw_measured(axes: Axes, what: Characteristic, s: Float) -> None:
    """The measured value with its expanded uncertainty, and the sections' values on it."""
    expanded = COVERAGE * what.u
    axes.fill_between(s, what.value - expanded, what.value + expanded, color=MEASURED, alpha=0.25, zorder=2)
    axes.plot(s, what.value, color=MEASURED, linewidth=1.1, zorder=3)
    for section, value, u in what.at_sections:
        axes.errorbar(
            section.arc_length_mm,
            value,
            COVERAGE * u,
            markersize=4,
            capsize=2.5,
            linewidth=1.0,
            color=VERDICTS[section.verdict],
            zorder=4,
        )


def _label_level(axes: Axes, level: float, text: str) -> None:
    axes.annotate(
        text,
        (1.0, level),
        (6, 0),
        xycoords=("axes fraction", "data"),
        va="center",
        fontsize=8,
        color=INK if text.startswith("nominal") else LIMIT,
    )
