"""Checks of the cutter against the cloud: what it must not meet, and what must remain of the part."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from workbench.artefacts import UNLABELLED, Cloud, Edge, Layer, RawEdge, Toolpath, Travel
from workbench.geometry.stock import ALWAYS, Stock, axis_distances, build_stock
from workbench.path.course import stocked_course
from workbench.path.obstacles import find_foreign, sections_of
from workbench.path.poses import poses_of
from workbench.path.remaining import moves_in_order, standing
from workbench.path.section import LEAST_DEPTH_MM, finished
from workbench.units import Float

SHANK_MM = 300.0  # the cutter and its shank, as long as may matter
STOCK_SHARE = 1.5  # of the depth of cut: beside where it cuts, the cutter may meet a layer and what is rough on it
CORE_SHARE = 0.95  # of the radius: what comes so near the axis was run into, whatever the depth of cut
STEP_MM = 1.0  # between looks at a travel move


def collisions(
    toolpath: Toolpath, edge: Edge, cloud: Cloud, penetration_mm: float, as_it_comes: bool = True
) -> Iterator[str]:
    """Where the cutter enters what it must not, in words.

    The finished part and all that is foreign by more than `penetration_mm` + 3 u; where it is not meant to cut, the
    stock that earlier layers left by more than a ramp takes at its foot. A layer that takes nothing away; not of a path
    that the tool will not follow `as_it_comes`, whose layers need not lie where they cut.
    """
    stands = standing(toolpath, cloud, edge, swept=True)
    taken = np.unique(stands[(stands > 0) & (stands < ALWAYS)])
    above = [layer.height_mm for layer in (*toolpath.before, *toolpath.layers)]
    for order, layer in enumerate(toolpath.layers, start=len(toolpath.before) + 1):
        # The first layer of all may be too thin to hold a point, and so may one that only evens out what is left.
        lower = order > 1 and above[order - 2] - layer.height_mm > LEAST_DEPTH_MM
        if as_it_comes and lower and order not in taken:
            yield f"layer {layer.index} takes nothing away that was measured"
    foreign = find_foreign(cloud, edge, sections_of(stocked_course(edge, edge.arc_length_mm, toolpath)))
    stands[edge.labels == UNLABELLED] = 0  # stray returns, but for those that neighbours support
    stands[foreign.frame, foreign.column] = ALWAYS
    stock = build_stock(cloud.x_mm, cloud.z_mm, cloud.base_from_profiler, stands)
    allowed, radius = penetration_mm + 3.0 * _edge_u_mm(toolpath, edge), toolpath.cutter.radius_mm
    if allowed >= radius:
        yield f"the cutter's radius is no more than the {allowed:.2f} mm that it may enter: it cannot be checked"
        return
    in_stock = min(STOCK_SHARE * toolpath.depth_of_cut_mm + allowed, CORE_SHARE * radius)
    for points, done in moves_in_order(toolpath):
        yield from _entered(toolpath, points, ALWAYS - 1, stock, allowed, "what must remain")
        yield from _entered(toolpath, points, done, stock, in_stock, "the stock")


def _edge_u_mm(toolpath: Toolpath, edge: Edge) -> float:
    """Standard uncertainty of the finished bevel's place, along its normal: the worst of where it is cut."""
    if not isinstance(edge, RawEdge):
        return 0.0
    final = toolpath.layers[-1]
    cut = np.interp(edge.arc_length_mm, final.arc_length_mm, final.cutting.astype(float)) > 0.0
    bevel, places = finished(toolpath), edge.position_u_mm[cut]
    u = np.hypot(*(places * bevel.normal).T)
    u = np.maximum(u, places[:, 1]) if bevel.fillet_mm else u  # where the fillet ends it lies along m
    return float(np.nanmax(u)) if np.isfinite(u).any() else 0.0


def _entered(
    toolpath: Toolpath, points: Layer | Travel, after: int, stock: Stock, allowed: float, what: str
) -> Iterator[str]:
    """The deepest place of a move at which the cutter is inside what stands after `after` layers."""
    radius, (centre, axis) = toolpath.cutter.radius_mm, axes_of(toolpath, points)
    at = np.arange(len(centre))
    if isinstance(points, Layer) and after < ALWAYS - 1:
        at = np.flatnonzero(~points.cutting)
        centre, axis = centre[at], axis[at]
    if not len(at):
        return
    start, end = shank_lines(toolpath, centre, axis, allowed)
    bound, flat = np.full(len(start), radius - allowed), not toolpath.cutter.ball_end
    depth = radius - axis_distances(stock, start, end, np.full(len(start), after), bound, flat)
    worst = int(np.argmax(depth))
    if depth[worst] > allowed + 1e-9:
        where = f"at {np.round(centre[worst], 1).tolist()} mm in a travel move"
        if isinstance(points, Layer):
            where = f"in layer {points.index} at arc length {points.arc_length_mm[at[worst]]:.1f} mm"
        yield f"the cutter enters {what} by {depth[worst]:.2f} mm {where}"


def shank_lines(toolpath: Toolpath, centre: Float, axis: Float, allowed_mm: float) -> tuple[Float, Float]:
    """Ends (k, 3) of the cutter's axis: from its ball's centre, or where it may enter by `allowed_mm`, up the shank."""
    cutter = toolpath.cutter
    reach = cutter.cylinder_end_mm - (0.0 if cutter.ball_end else allowed_mm)
    return np.asarray(centre + reach * axis), np.asarray(centre - SHANK_MM * axis)


def axes_of(toolpath: Toolpath, points: Layer | Travel) -> tuple[Float, Float]:
    """Points on the cutter's axis beside the path's own, and its directions; every mm on the lines of a travel."""
    poses = poses_of(toolpath, points)
    centre = poses.origin_mm - toolpath.cutter.radius_mm * poses.x
    return _dense(centre, poses.z) if isinstance(points, Travel) and len(centre) else (centre, poses.z)


def _dense(centre: Float, axis: Float) -> tuple[Float, Float]:
    """Points every mm on the straight lines of a travel move."""
    length = np.linalg.norm(np.diff(centre, axis=0), axis=1)
    counts = np.maximum(np.ceil(length / STEP_MM).astype(int), 1)
    at = np.concatenate([np.repeat(np.arange(len(counts)), counts), [len(centre) - 1]]).astype(np.int64)
    share = np.concatenate([*(np.arange(n) / n for n in counts), [0.0]])[:, None]
    after = np.minimum(at + 1, len(centre) - 1)
    middle = axis[at] + share * (axis[after] - axis[at])
    return centre[at] + share * (centre[after] - centre[at]), middle / np.linalg.norm(middle, axis=1, keepdims=True)
