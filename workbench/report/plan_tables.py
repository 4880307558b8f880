"""What stands in the tables of a plan, and in the charts of what was measured beside it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from workbench.artefacts import Edge, EdgeProfile, Gate, Inspection, Moves, Section, Toolpath
from workbench.errors import one_line
from workbench.report.along import gaps, hidden_stretches
from workbench.report.chart_parts import hatch_hidden, mark_sections, svg
from workbench.report.colours import INK, LIMIT, MEASURED, VERDICTS
from workbench.report.planned import Run, frames_in_base, planned_bevel, planned_u, thickness_mm
from workbench.report.plot import Axes, Figure
from workbench.report.text import COVERAGE, decimals, span
from workbench.units import DEG, Bool, Float

Row = tuple[str, str]


def thickness(edge: Edge) -> str:
    """Height of the end face along the edge."""
    return span(thickness_mm(edge), 2, " mm")


def required(edge: Edge, toolpath: Toolpath) -> Iterator[tuple[str, str, str, str, str]]:
    """Root and angle: name, required, planned lowest and highest along the final layer, expanded uncertainty."""
    bevel = planned_bevel(toolpath, edge)
    rows = (
        ("Root face", " mm", toolpath.root_mm, bevel.root_mm, planned_u(edge, toolpath)[0]),
        ("Bevel angle", "°", toolpath.bevel_deg, bevel.bevel_deg, planned_u(edge, toolpath)[1]),
    )
    for name, unit, nominal, values, u in rows:
        places = decimals([u])
        known = values[np.isfinite(values)]
        ends = [f"{end:.{places}f}{unit}" for end in (known.min(), known.max())] if len(known) else ["–", "–"]
        expanded = "–" if u is None else f"± {COVERAGE * u:.{places}f}{unit}"
        yield (name, f"{round(nominal, max(3, places)):g}{unit}", ends[0], ends[1], expanded)


def plan_rows(toolpath: Toolpath, run: Run) -> Iterator[Row]:
    """The path in numbers."""
    cutter, cut = toolpath.cutter, run.cutting_step
    length, time, at_slow = float(run.length_mm.sum()), float(run.time_s.sum()), toolpath.time_at_v_slow_s
    heights = [layer.height_mm for layer in toolpath.layers]
    final = toolpath.layers[-1]
    steps = np.diff(final.arc_length_mm[final.measured & (final.arc_length_mm >= 0.0)])
    ball = ", ball end" if cutter.ball_end else ""
    yield "Cutter", f"⌀ {cutter.diameter_mm:g} mm{ball}, {cutter.flutes} flutes of {cutter.flute_length_mm:g} mm"
    yield (
        "Layers",
        f"{len(heights)}, depth of cut {toolpath.depth_of_cut_mm:g} mm, the first {max(heights):g} mm above the "
        "finished bevel",
    )
    yield "Length of the path", f"{length:,.0f} mm, of which {run.length_mm[cut].sum():,.0f} mm cutting"
    yield (
        "Points",
        f"{len(run.layer):,}, of which {int(run.cutting.sum()):,} cutting"
        + (f"; key points {np.median(steps):.2f} mm apart along the lower edge" if len(steps) else ""),
    )
    yield "Feed", f"{run.feed_mm_s.min():.3g} to {run.feed_mm_s.max():.3g} mm/s, cutting {toolpath.v_slow_mm_s:g} mm/s"
    yield "Time", duration(time)
    yield (
        "Cutting",
        f"{100.0 * run.time_s[cut].sum() / time:.0f} % of the time, "
        f"{100.0 * run.length_mm[cut].sum() / length:.0f} % of the path length",
    )
    yield f"Time at constant {toolpath.v_slow_mm_s:g} mm/s", duration(at_slow)
    yield "Time saved", f"{duration(at_slow - time)} ({100.0 * (1.0 - time / at_slow):.0f} %)"


def move_rows(moves: Moves | None) -> Iterator[Row]:
    """What simplification made of the points."""
    if moves is None:
        yield "Targets after simplification", "not simplified"
        return
    count, arcs = len(moves.circular), int(moves.circular.sum())
    yield (
        "Targets after simplification",
        f"{count:,} ({moves.points_before / max(1, count):.1f} times fewer), {arcs:,} of them circular; within "
        f"{moves.chord_tolerance_mm:g} mm and {moves.angle_tolerance_deg:g}° of the points",
    )


def layer_rows(toolpath: Toolpath, run: Run) -> Iterator[tuple[str, ...]]:
    """A row a layer: index, height, width of its face, length cut, points, feed, time."""
    for layer in toolpath.layers:
        here = run.layer == layer.index
        width = layer.width_mm[layer.cutting]
        yield (
            f"{layer.index}",
            f"{layer.height_mm:.2f}",
            span(width, 2, ""),
            f"{run.length_mm[here & run.cutting_step].sum():.1f}",
            f"{int(here.sum()):,}",
            span(layer.feed_mm_s, 2, ""),
            duration(float(run.time_s[here].sum())),
        )
    air = run.layer == 0
    if air.any():
        yield (
            "between",
            "–",
            "–",
            "–",
            f"{int(air.sum()):,}",
            span(run.feed_mm_s[air], 2, ""),
            duration(float(run.time_s[air].sum())),
        )


def refused(edge: Edge, toolpath: Toolpath, gate: Gate | None) -> Iterator[tuple[str, str]]:
    """What is not milled, and why, and which check was loosened: what, where or why."""
    if gate is not None and not gate.passed:
        yield "The whole path", one_line(gate.reason)
    for what in gate.loosened if gate is not None else ():
        yield "Check loosened", one_line(what)
    for what in toolpath.refused:
        yield "Not milled", one_line(what)
    for start, end in hidden_stretches(edge):
        yield "Not seen", f"arc length {start:.1f} to {end:.1f} mm: nothing is cut where nothing was measured"


def duration(seconds: float) -> str:
    """'1 h 4 min', '12 min 5 s', '8.3 s'."""
    if seconds < 59.95:
        return f"{seconds:.1f} s"
    minutes, rest = divmod(round(seconds), 60)
    return f"{minutes} min {rest} s" if minutes < 60 else f"{minutes // 60} h {minutes % 60} min"


NEAR_MM = 20.0  # farther from the section's origin the path belongs to another place


@dataclass(frozen=True, slots=True, eq=False)
class Compared:
    """A section: planned root face, mm, and bevel angle, deg; None where the final layer does not cut there."""

    section: Section
    root_mm: float | None
    bevel_deg: float | None


def compared(inspection: Inspection, toolpath: Toolpath) -> list[Compared]:
    """Each inspected section with what the path's final layer makes in it."""
    final = toolpath.layers[-1]
    position = toolpath.in_base(final.position_mm)
    axis = frames_in_base(toolpath, final)[:, :, 2]
    both = final.cutting[1:] & final.cutting[:-1]
    found = []
    for section in inspection.sections:
        crossing = _crossing(section, position, axis, both)
        found.append(Compared(section, None, None) if crossing is None else _planned(section, *crossing))
    return found


def loop_chart(inspection: Inspection, toolpath: Toolpath, rows: list[Compared]) -> bytes:
    """SVG of the deviations from the requirement, along the edge: measured with uncertainty, planned as crosses."""
    profile = inspection.profile
    figure = Figure(figsize=(10, 3.4))
    root, bevel = figure.subplots(2, 1, sharex=True)
    figure.subplots_adjust(0.1, 0.15, 0.985, 0.93, hspace=0.18)
    _draw_deviation(root, profile, rows, "root", "mm", toolpath.root_mm)
    _draw_deviation(bevel, profile, rows, "bevel", "deg", toolpath.bevel_deg)
    root.set_ylabel("root face\ndeviation, mm")
    bevel.set_ylabel("bevel angle\ndeviation, °")
    for axes in (root, bevel):
        axes.y_label_at = -0.062
    mark_sections(root, [r.section.arc_length_mm for r in rows], [str(r.section.index) for r in rows])
    bevel.set_xlabel("arc length along the lower edge of the milled part, mm")
    return svg(figure)


def _draw_deviation(axes: Axes, profile: EdgeProfile, rows: list[Compared], name: str, unit: str, asked: float) -> None:
    """One quantity, `root` in `mm` or `bevel` in `deg`, deviation from the requirement."""
    value_name, u_name, s = f"{name}_{unit}", f"{name}_u_{unit}", profile.arc_length_mm
    off, wide = getattr(profile, value_name) - asked, COVERAGE * getattr(profile, u_name)
    axes.set_xlim(float(s[0]), float(s[-1]))
    axes.axhline(0.0, color=LIMIT, linewidth=0.8, dashes=(8, 2, 1.5, 2))
    axes.fill_between(s, off - wide, off + wide, color=MEASURED, alpha=0.25)
    axes.plot(s, off, color=MEASURED, linewidth=1.0)
    for row in rows:
        at, value, planned = row.section.arc_length_mm, getattr(row.section, value_name), getattr(row, value_name)
        if value is not None:
            axes.errorbar(
                at,
                value - asked,
                COVERAGE * (getattr(row.section, u_name) or 0.0),
                markersize=4,
                capsize=2.5,
                linewidth=1.0,
                color=VERDICTS[row.section.verdict],
                zorder=4,
            )
        if planned is not None:
            axes.points(at, planned - asked, "x", color=INK, markersize=6, zorder=5)
    hatch_hidden(axes, gaps(s, np.isfinite(off)))


def _crossing(section: Section, position: Float, axis: Float, cutting: Bool) -> tuple[Float, Float] | None:
    """Where the path crosses the section plane while it cuts: position (3,) and cutter axis (3,), in the base."""
    off = (position - section.origin_mm) @ section.tangent
    distance = np.linalg.norm(position[1:] - section.origin_mm, axis=1)
    crosses = cutting & (off[1:] * off[:-1] <= 0.0) & (distance < NEAR_MM)
    if not crosses.any():
        return None
    k = int(np.argmin(np.where(crosses, distance, np.inf)))
    span = off[k + 1] - off[k]
    part = -off[k] / span if span else 0.0
    return position[k] + part * (position[k + 1] - position[k]), axis[k] + part * (axis[k + 1] - axis[k])


def _planned(section: Section, position: Float, axis: Float) -> Compared:
    """Root face and bevel angle that the cutter's flank makes in the section's axes."""
    offset = position - section.origin_mm
    u, v = offset @ section.normal, offset @ section.across
    out, up = axis @ section.normal, axis @ section.across
    return Compared(section, float(v - u * up / out), float(np.arctan2(abs(out), abs(up)) / DEG))
