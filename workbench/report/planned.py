"""What a plan is shown by: the path as it is run, the bevel that its final layer makes, colours, tables and charts."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from workbench.artefacts import Edge, Gate, Inspection, Layer, Moves, RawEdge, Section, Toolpath
from workbench.errors import one_line
from workbench.geometry.blocks import evenly
from workbench.geometry.moves import runs, step_lengths_mm, step_times_s
from workbench.geometry.poses import rotation_from_quaternion
from workbench.marks import AIR, code, ramp, rgb
from workbench.report.along import axes_at, developed, hidden_stretches
from workbench.report.text import alike, decimals, span
from workbench.units import COVERAGE, DEG, AnyArray, Bool, Float, Int, Shaped

LOCAL_MM = 10.0  # of edge to both sides, whose least-squares plane is the direction of a rough end face
FEEDS, MOST_NAMES = 5, 12  # feeds, and layers, that a key names
Row = tuple[str, str]


class Run(NamedTuple):
    """The whole path in the order in which it is run, k points, in the base."""

    position_mm: Shaped[Float, "k 3"]
    feed_mm_s: Shaped[Float, " k"]
    cutting: Shaped[Bool, " k"]
    layer: Shaped[Int, " k"]  # index of the layer; 0: travel between layers
    length_mm: Shaped[Float, " k"]  # of the step to the point
    time_s: Shaped[Float, " k"]  # of the step to the point

    @property
    def cutting_step(self) -> Bool:
        """(k,) whether the step to the point cuts: both its ends do."""
        cuts = self.cutting.copy()
        cuts[1:] &= self.cutting[:-1] & (np.diff(self.layer) == 0)
        return cuts

    @property
    def layer_start(self) -> Int:
        """(l,) where each layer and each travel move begins."""
        return np.flatnonzero(np.diff(self.layer, prepend=-1))


class PlannedBevel(NamedTuple):
    """Root face and bevel angle that the final layer makes at its k cutting points, in their section planes."""

    arc_length_mm: Shaped[Float, " k"]
    root_mm: Shaped[Float, " k"]
    bevel_deg: Shaped[Float, " k"]


def whole_run(toolpath: Toolpath) -> Run:
    """Travels and layers in turn."""
    parts = toolpath.in_order
    position = toolpath.in_base(np.concatenate([part.position_mm for part in parts]))
    feed = np.concatenate([part.feed_mm_s for part in parts])
    cutting = [p.cutting if isinstance(p, Layer) else np.zeros(len(p.feed_mm_s), dtype=bool) for p in parts]
    layer = [np.full(len(p.feed_mm_s), p.index if isinstance(p, Layer) else 0) for p in parts]
    return Run(
        position,
        feed,
        np.concatenate(cutting),
        np.concatenate(layer),
        step_lengths_mm(position),
        step_times_s(position, feed),
    )


def frames_in_base(toolpath: Toolpath, layer: Layer) -> Float:
    """(k, 3, 3) x, y, z of a layer's points as columns, in the base."""
    rotation = rotation_from_quaternion(layer.quaternion_wxyz)
    return rotation if toolpath.base_from_workobject is None else toolpath.base_from_workobject[:3, :3] @ rotation


def planned_bevel(toolpath: Toolpath, edge: Edge) -> PlannedBevel:
    """Where the final layer's plane, or its ball end, meets the measured end face, and at what angle its plane does."""
    final = toolpath.layers[-1]
    cut = final.cutting
    s, u, v = developed(toolpath.in_base(final.position_mm[cut]), final.arc_length_mm[cut], edge).T
    frames, radius = frames_in_base(toolpath, final)[cut], toolpath.root_radius_mm
    sides = [axes_at(s, edge, each) for each in (edge.normal, edge.across)]
    (out, up), inward = (np.einsum("ij,kij->ki", frames[:, :, k], sides) for k in (2, 0))
    root = v - u * up / out
    if radius:  # the ball's centre is (u, v) of the frame, down the axis, and a radius off
        reach = toolpath.cutter.cylinder_end_mm
        ball_u, ball_v = u + reach * out - radius * inward[0], v + reach * up - radius * inward[1]
        root = ball_v - np.sqrt(np.maximum(radius**2 - ball_u**2, 0.0))
    return PlannedBevel(s, root, np.arctan2(np.abs(out), np.abs(up)) / DEG)


def middle_of_cut_mm(toolpath: Toolpath) -> float | None:
    """Arc length of the middle of the longest stretch that the final layer cuts; None where it cuts nowhere."""
    final = toolpath.layers[-1]
    spans = [final.arc_length_mm[[*ends]] for ends in runs(final.cutting)]
    return float(max(spans, key=np.ptp).mean()) if spans else None


def planned_u(edge: Edge, toolpath: Toolpath) -> tuple[float | None, float | None]:
    """Standard uncertainty of the planned root face, mm, and bevel angle, deg: of scan, hand-eye pose and stated links.

    The plane meets the end face at v = r: an error (du, dv) of the lower edge moves that by dv + du / tan(beta); a
    fillet meets it square, and is moved by dv. None where the edge does not state its own.
    """
    if not isinstance(edge, RawEdge):
        return None, None
    shared = 0.0 if edge.hand_eye_u_mm is None else edge.hand_eye_u_mm
    place_mm, turn = (0.0, 0.0) if toolpath.chain is None else (toolpath.chain.place_mm, toolpath.chain.turn)
    u_out, u_across = np.nanmedian(np.hypot(np.hypot(edge.position_u_mm, shared), place_mm), axis=0)
    root = float(u_across if toolpath.root_radius_mm else np.hypot(u_across, u_out / np.tan(toolpath.bevel_deg * DEG)))
    return root, float(np.median(np.hypot(edge.normal_u, turn)) / DEG)


def local_turn_deg(edge: Edge) -> float | None:
    """Standard deviation of the end face's direction from place to place, deg, beside what turns evenly; None: unknown.

    From its second differences over `LOCAL_MM`, whose variance is six times that of independent places.
    """
    apart = round(LOCAL_MM / float(np.median(np.diff(edge.arc_length_mm))))
    if not isinstance(edge, RawEdge) or len(edge.normal) <= 2 * apart:
        return None
    n, seen = np.where(edge.seen[:, None], edge.normal, np.nan), edge.across[apart:-apart]
    bend = np.einsum("ij,ij->i", n[2 * apart :] - 2.0 * n[apart:-apart] + n[: -2 * apart], seen)
    bend = bend[np.isfinite(bend)]
    return float(np.sqrt(np.mean(bend**2) / 6.0) / DEG) if len(bend) else None


def thickness_mm(edge: Edge) -> Float:
    """(n,) height of a raw edge's end face at its stations; NaN where hidden."""
    if not isinstance(edge, RawEdge):
        return np.full(len(edge.arc_length_mm), np.nan)
    rise = edge.upper_position_mm - edge.position_mm
    return np.asarray(np.einsum("ij,ij->i", rise, edge.across))


def layer_colours(layer: AnyArray, count: int) -> AnyArray:
    """(k, 3): light for the first layer, dark for the final one, grey for travel moves between layers."""
    colour = ramp((count - np.asarray(layer)) / max(1, count - 1))
    return np.where((np.asarray(layer) == 0)[:, None], rgb(AIR), colour)


def layer_ink(index: int, count: int) -> str:
    """'#rrggbb' of one of `count` layers."""
    return code(layer_colours(np.array([index]), count)[0] / 255.0)


def feed_colours(run: Run) -> AnyArray:
    """(k, 3): the darker the slower."""
    low, high = feed_range(run)
    return ramp((run.feed_mm_s - low) / (high - low))


def feed_range(run: Run) -> tuple[float, float]:
    """Slowest and fastest feed of a path, mm/s; from 0 where they are one."""
    low, high = float(run.feed_mm_s.min()), float(run.feed_mm_s.max())
    return (low, high) if high - low > 1e-3 * high else (0.0, high)


def feed_key(run: Run) -> list[Row]:
    """Some feeds, evenly from the slowest on, and their colours."""
    low, high = feed_range(run)
    share = np.linspace(0.0, 1.0, FEEDS)
    named = zip(low + share * (high - low), ramp(share) / 255.0, strict=True)
    return [(f"{feed:.3g} mm/s", code(colour)) for feed, colour in named]


def layer_key(toolpath: Toolpath) -> list[Row]:
    """Layers with their heights above the finished bevel, and their colours."""
    count = len(toolpath.layers)
    heights = alike(*(round(layer.height_mm, 6) for layer in toolpath.layers))
    named = 1 + evenly(count, MOST_NAMES)
    shades = layer_colours(named, count) / 255.0
    return [(f"{k} ({heights[k - 1]} mm)", code(shade)) for k, shade in zip(named.tolist(), shades, strict=True)]


def thickness(edge: Edge) -> str:
    """Height of the end face along the edge."""
    return span(thickness_mm(edge), 2, " mm")


def required(edge: Edge, toolpath: Toolpath) -> Iterator[tuple[str, str, str, str, str]]:
    """Root and angle: name, required, planned lowest and highest along the final layer, expanded uncertainty."""
    bevel = planned_bevel(toolpath, edge)
    root_u, bevel_u = planned_u(edge, toolpath)
    rows = (
        ("Root face", " mm", toolpath.root_mm, bevel.root_mm, root_u),
        ("Bevel angle", "°", toolpath.bevel_deg, bevel.bevel_deg, bevel_u),
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
    """One row per layer: index, height, width of its face, length cut, points, feed, time."""

    def driven(here: Bool) -> tuple[str, str, str]:
        """Points, feed, time."""
        return f"{int(here.sum()):,}", span(run.feed_mm_s[here], 2, ""), duration(float(run.time_s[here].sum()))

    for layer in toolpath.layers:
        here = run.layer == layer.index
        cut = f"{run.length_mm[here & run.cutting_step].sum():.1f}"
        width = span(layer.width_mm[layer.cutting], 2, "")
        yield f"{layer.index}", f"{layer.height_mm:.2f}", width, cut, *driven(here)
    if (run.layer == 0).any():
        yield "between", "–", "–", "–", *driven(run.layer == 0)


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


class Compared(NamedTuple):
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
