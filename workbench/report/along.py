"""Along the edge laid out straight: charts of root face and bevel angle (the paper's Figs. 20, 21), rejected points.

For a point p near arc length s: u = (p - P(s)) . n, v = (p - P(s)) . m with the lower edge P and the axes (n, m) of
the stations, where s is the foot point, (p - P(s)) . t = 0. So a section of a curved edge is drawn without the
curvature.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from itertools import product
from types import MappingProxyType
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from workbench.artefacts import UNLABELLED, Characteristic, Cloud, Edge, Inspection, JointInspection, Quantity, Section
from workbench.geometry.moves import interpolated, runs
from workbench.geometry.splines import hermite
from workbench.marks import FACES, LIMIT, MEASURED, REJECTED, TOLERANCE, VERDICTS, Lettering
from workbench.pieces import GREY, INK, PALE
from workbench.plot import Axes, Figure
from workbench.report.scene import Points, frame_arc_length_mm, overview, rejected
from workbench.report.text import alike
from workbench.units import COVERAGE, Bool, Float, Int

if TYPE_CHECKING:
    from workbench.result_files import ScanPlanFile


PART_COLOURS = {"blind": REJECTED}  # of parts beside each other; others as what was measured


def mark_sections(axes: Axes, inspection: JointInspection) -> None:
    """Numbered ticks along the top of a chart over arc length."""
    for section in inspection.sections:
        axes.axvline(section.arc_length_mm, color=PALE, linewidth=0.7, zorder=0.5)
        axes.annotate(
            f"{section.index}",
            (section.arc_length_mm, 1.0),
            (0, 2),
            xycoords=("data", "axes fraction"),
            ha="center",
            va="bottom",
            fontsize=8,
            look=Lettering(GREY),
        )


def hatch_hidden(axes: Axes, stretches_mm: list[tuple[float, float]]) -> None:
    """Stretches of the edge where nothing was measured."""
    for start, end in stretches_mm:
        axes.axvspan(start, end, facecolor="white", zorder=0.6)
        axes.axvspan(start, end, hatch="////", zorder=0.6)
        if end - start > 0.05 * (axes.get_xlim()[1] - axes.get_xlim()[0]):
            axes.annotate(
                "hidden",
                ((start + end) / 2, 0.5),
                xycoords=("data", "axes fraction"),
                ha="center",
                va="center",
                fontsize=8,
                look=Lettering(GREY, rotation=90, box=True),
            )


FOOT_STEPS = 3  # Newton steps to the foot point: each divides its error by the radius over the distance
FOOT_MM = 1e-4  # a step as short is the last: the foot is then known far better


def developed(position_mm: Float, start_mm: Float, edge: Edge) -> Float:
    """(n, 3) arc length s, u (outward) and v (from the lower to the upper side), mm, of base positions (n, 3).

    `start_mm` (n,): arc length near each point, where the search for its foot point starts; NaN gives NaN.
    """
    arc_length = start_mm
    for _ in range(FOOT_STEPS):
        tangent = axes_at(arc_length, edge, edge.tangent)
        step = np.einsum("ij,ij->i", position_mm - _on_curve(arc_length, edge), tangent)
        arc_length = arc_length + step
        if not (np.abs(step) > FOOT_MM).any():
            break
    offset = position_mm - _on_curve(arc_length, edge)
    u = np.einsum("ij,ij->i", offset, axes_at(arc_length, edge, edge.normal))
    v = np.einsum("ij,ij->i", offset, axes_at(arc_length, edge, edge.across))
    return np.column_stack([arc_length, u, v])


def in_section(position_mm: Float, start_mm: Float, edge: Edge, section: Section) -> Float:
    """(n, 2) u and v in the section's own axes, which differ from the stations' by a turn about t and an origin."""
    _, u, v = developed(position_mm, start_mm, edge).T
    here = np.array([section.arc_length_mm])
    normal, across = axes_at(here, edge, edge.normal)[0], axes_at(here, edge, edge.across)[0]
    turn = math.atan2(float(section.normal @ across), float(section.normal @ normal))
    shift = section.origin_mm - _on_curve(here, edge)[0]
    u, v = u - shift @ normal, v - shift @ across
    return np.column_stack([math.cos(turn) * u + math.sin(turn) * v, math.cos(turn) * v - math.sin(turn) * u])


def _on_curve(arc_length: Float, edge: Edge) -> Float:
    """P(s): through the measured stations along their tangents, straight on beyond the first and the last of them."""
    measured = np.isfinite(edge.position_mm).all(axis=1)
    stations, position, tangent = edge.arc_length_mm[measured], edge.position_mm[measured], edge.tangent[measured]
    if len(stations) == 1:
        return position + (arc_length - stations)[:, None] * tangent
    return hermite(stations, position, tangent)(arc_length, straight=True)


def axes_at(arc_length: Float, edge: Edge, vectors: Float) -> Float:
    """Unit vectors of the stations, interpolated."""
    mixed = interpolated(arc_length, edge.arc_length_mm, vectors)
    unit: Float = mixed / np.sqrt(np.einsum("ij,ij->i", mixed, mixed))[:, None]
    return unit


def draw_course(axes: Axes, s: Float, value: Float, u: Float, color: str = MEASURED, label: str | None = None) -> None:
    """What was measured at arc lengths (n,): a line, and the band of U = 2 u about it."""
    axes.fill_between(s, value - COVERAGE * u, value + COVERAGE * u, color=color, alpha=0.25, zorder=2)
    axes.plot(s, value, color=color, linewidth=1.1, zorder=3, label=label)


def draw_values(axes: Axes, inspection: JointInspection, what: Characteristic, less: float = 0.0) -> None:
    """A size in the sections, less a nominal value, with U, in the colours of their verdicts."""
    for section, pair in zip(inspection.sections, what.pairs, strict=True):
        if pair is not None:
            ink = VERDICTS[section.verdict]
            axes.errorbar(section.arc_length_mm, pair[0] - less, COVERAGE * pair[1], color=ink, zorder=4)


def stacked() -> tuple[Figure, list[Axes]]:
    """A figure, and two charts of one edge in it."""
    figure = Figure(figsize=(10, 3.4))
    rows: list[Axes] = figure.subplots(2, 1, sharex=True)
    figure.subplots_adjust(0.1, 0.15, 0.985, 0.93, hspace=0.18)
    return figure, rows


def deviation_chart(
    parts: Mapping[str, Inspection],
    nominal: Mapping[str, float],
    planned: Mapping[str, Sequence[float | None]] = MappingProxyType({}),
) -> bytes:
    """SVG of root face and bevel angle along the edge as deviations, one over the other, and in the sections; with
    the tolerance where nothing was planned.

    Args:
        parts: inspections by name.
        nominal: by size, what the deviations are from.
        planned: by size, a value a section of the one part, drawn as a cross; None: not planned there.
    """
    first = next(iter(parts.values()))
    figure, rows = stacked()
    for axes, what in zip(rows, first.characteristics, strict=True):
        asked, s = nominal[what.name], first.profile.arc_length_mm
        unit = "°" if what.is_angle else "mm"
        axes.set(xlim=(float(s[0]), float(s[-1])), ylabel=f"{what.term.lower()}\ndeviation, {unit}")
        axes.y_label_at = -0.062
        if what.limits is not None and not planned:  # beside it what was planned could not be told apart
            axes.axhspan(*(limit - asked for limit in what.limits), color=TOLERANCE, zorder=0.1)
        axes.axhline(0.0, color=LIMIT, linewidth=0.8, dashes=(8, 2, 1.5, 2))
        for name, one in parts.items():
            size, where = one.profile.sizes[what.name], one.profile.arc_length_mm
            draw_course(axes, where, size.value - asked, size.u, PART_COLOURS.get(name, MEASURED), name)
            draw_values(axes, one, one.characteristics[rows.index(axes)], asked)
            hatch_hidden(axes, gaps(where, np.isfinite(size.value)))
        for section, value in zip(first.sections, planned.get(what.name, ()), strict=False):
            if value is not None:
                axes.points(section.arc_length_mm, value - asked, "x", color=INK, markersize=6, zorder=5)
    if len(parts) > 1:
        rows[0].legend()
    else:
        mark_sections(rows[0], first)
    rows[-1].set(xlabel="arc length along the lower edge of the milled part, mm")
    return figure.svg()


def size_chart(s: Float, along: Quantity, seen: Bool, inspection: JointInspection, what: Characteristic) -> bytes:
    """SVG of a size along the edge, with its tolerance, guard and uncertainty bands and the sections' values.

    Args:
        s: (m,) arc length, mm.
        along: the size there.
        seen: (m,) whether it was measured there.
        inspection: its sections, and how it decided.
        what: the size as required, and in the sections.
    """
    unit, course = "°" if what.is_angle else " mm", "lower edge"
    if not isinstance(inspection, Inspection):
        course = "groove" if inspection.WHAT == "groove" else "edge"
    figure = Figure(figsize=(10, 2.8))
    axes = figure.add_axes((0.068, 0.15, 0.8, 0.76))
    axes.set(xlim=(0.0, float(s[-1])))
    _draw_tolerance(axes, what, unit, s, inspection.guard_factor * along.u)
    mark_sections(axes, inspection)
    hatch_hidden(axes, gaps(s, seen))
    draw_course(axes, s, along.value, along.u)
    draw_values(axes, inspection, what)
    axes.set(xlabel=f"arc length along the {course}, mm", ylabel=f"{what.term.lower()}, {unit.strip()}")
    return figure.svg()


def u_chart(plan: ScanPlanFile, inspection: Inspection) -> bytes:
    """SVG of U = 2 u of root face and bevel angle along the edge: wanted and predicted by a scan plan, achieved."""
    expected, s, along = plan.predicted, inspection.profile.arc_length_mm, inspection.profile.sizes
    rows = (
        ("U root face, mm", expected.root_U_mm, expected.promised_root_U_mm, plan.wanted_root_U_mm, along["root_mm"].u),
        (
            "U bevel angle, °",
            expected.bevel_U_deg,
            expected.promised_bevel_U_deg,
            plan.wanted_bevel_U_deg,
            along["bevel_deg"].u,
        ),
    )
    figure = Figure(figsize=(10, 3.6))
    at = np.array(expected.arc_length_mm)
    for axes, (name, predicted, promised, wanted, u) in zip(figure.subplots(2, 1, sharex=True), rows, strict=True):
        axes.set(xlim=(0.0, float(s[-1])))
        axes.axhline(wanted, color=LIMIT, linewidth=1.2)
        axes.plot(at, np.array(predicted, float), color=INK, linewidth=1.1, dashes=(5, 3))
        if promised:
            axes.plot(at, np.array(promised, float), color=INK, linewidth=0.7, dashes=(1.5, 2))
        axes.plot(s, COVERAGE * u, color=MEASURED, linewidth=1.4)
        axes.set(ylim=(0.0, None), ylabel=name)
    figure.axes[-1].set(xlabel="arc length along the lower edge, mm")
    figure.subplots_adjust(0.068, 0.13, 0.868, 0.97, hspace=0.15)
    return figure.svg()


def hidden_stretches(edge: Edge) -> list[tuple[float, float]]:
    """Arc lengths, mm, from the last station seen before each gap to the first one seen after it."""
    return gaps(edge.arc_length_mm, edge.seen)


def gaps(s: Float, seen: Bool) -> list[tuple[float, float]]:
    """The stretches of `s` (n,) between what was `seen` (n,), from the last value seen to the next one."""
    return [(float(s[max(a - 1, 0)]), float(s[min(b + 1, len(s) - 1)])) for a, b in runs(~seen)]


def _draw_tolerance(axes: Axes, what: Characteristic, unit: str, s: Float, guard: Float) -> None:
    """Tolerance zone, its limits and the nominal value; inside it the limits less the guard band (n,)."""
    if what.required is None or what.limits is None:
        return
    nominal, (lower, upper) = what.required[0], what.limits
    axes.axhspan(lower, upper, color=TOLERANCE, zorder=0.1)
    low, middle, high = alike(lower, nominal, upper)
    for level, name, inside in ((upper, f"upper limit {high}", -1.0), (lower, f"lower limit {low}", 1.0)):
        axes.axhline(level, color=LIMIT, linewidth=1.2, zorder=1)
        axes.plot(s, level + inside * guard, color=LIMIT, linewidth=0.8, dashes=(4, 2.5), zorder=1)
        label_level(axes, level, name + unit)
    axes.axhline(nominal, color=LIMIT, linewidth=0.7, dashes=(8, 2, 1.5, 2), zorder=1)
    label_level(axes, nominal, f"nominal {middle}{unit}", INK)


def label_level(axes: Axes, level: float, text: str, ink: str = LIMIT) -> None:
    """The name of a value, beside the axes."""
    coords = ("axes fraction", "data")
    axes.annotate(text, (1.0, level), (6, 0), xycoords=coords, va="center", fontsize=8, look=Lettering(ink))


SEARCHED, KEPT, REJECTS = 4_000_000, 100_000, 20_000  # grid points searched for rejects; points drawn of each sort
MARGIN_MM = 3.0  # shown beyond the faces


class PlanView(NamedTuple):
    """The picture and what it leaves out."""

    svg: bytes
    every_frame: int  # one frame in so many was searched for rejected points
    outside: int  # rejected points found there that lie outside the picture


def plan_view(cloud: Cloud, edge: Edge, inspection: Inspection) -> PlanView:
    """Arc length to the right, the way from the lower to the upper side upwards."""
    points, kept = _laid_out(overview(cloud, edge, KEPT), cloud, edge)
    found, step = rejected(cloud, edge, SEARCHED)
    _, out = _laid_out(found, cloud, edge)
    faces = kept if len(kept) else np.zeros((1, 3))
    low, high = faces[:, 2].min() - MARGIN_MM, faces[:, 2].max() + MARGIN_MM
    s = edge.arc_length_mm
    shown = (out[:, 2] > low) & (out[:, 2] < high) & (out[:, 0] >= s[0]) & (out[:, 0] <= s[-1])
    figure = Figure(figsize=(10, 2.7))
    axes = figure.add_axes((0.068, 0.18, 0.8, 0.71))
    axes.set(xlim=(0.0, s[-1]), ylim=(low, high))
    pass_index = cloud.pass_index[points.frame]
    for label, each in product(np.setdiff1d(points.label, [UNLABELLED]), np.unique(pass_index)):
        face = (points.label == label) & (pass_index == each)
        if face.any():
            band = _band(points.frame[face], kept[face])
            axes.fill_between(*band, color=FACES[int(label)], alpha=0.3)
    mark_sections(axes, inspection)
    hatch_hidden(axes, hidden_stretches(edge))
    few = out[shown][:: max(1, int(shown.sum()) // REJECTS)]
    axes.points(few[:, 0], few[:, 2], ".", color=REJECTED, markersize=2.2)
    if len(edge.burr_stations):
        axes.points(s[edge.burr_stations], np.full(len(edge.burr_stations), low), "^", color=INK, clip_on=False)
    axes.set(xlabel="arc length along the lower edge, mm", ylabel="v across the edge, mm")
    return PlanView(figure.svg(), step, int((~shown).sum()))


def _band(frame: Int, laid_out_mm: Float) -> tuple[Float, Float, Float]:
    """Arc length, lowest and highest v of a face in one pass, one value per frame; NaN where frames leave a gap."""
    first = np.flatnonzero(np.diff(frame, prepend=-1))
    s, low, high = (
        reduce.reduceat(laid_out_mm[:, k], first) for reduce, k in ((np.minimum, 0), (np.minimum, 2), (np.maximum, 2))
    )
    step = np.abs(np.diff(s))
    gaps = np.flatnonzero(step > 4.0 * np.median(step)) + 1 if len(step) else np.arange(0)
    return np.insert(s, gaps, np.nan), np.insert(low, gaps, np.nan), np.insert(high, gaps, np.nan)


def laid_out(points: Points, cloud: Cloud, edge: Edge) -> Float:
    """(n, 3) s, u, v of points of a cloud; NaN in passes that never saw the edge."""
    return developed(points.position_mm, frame_arc_length_mm(cloud, edge)[points.frame], edge)


def _laid_out(points: Points, cloud: Cloud, edge: Edge) -> tuple[Points, Float]:
    """The points and their (n, 3) s, u, v; those of passes that never saw the edge are left out."""
    suv = laid_out(points, cloud, edge)
    known = np.isfinite(suv[:, 0])  # an unknown start makes all three unknown
    return points.where(known), suv[known]
