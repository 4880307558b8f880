"""`path.feed`: slow in the material, fast in travel moves; and the stock that still stands before each layer."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Annotated, NamedTuple

import numpy as np
from pydantic import Field

from workbench.artefacts import Cloud, Edge, Layer, Toolpath, Travel
from workbench.errors import InputError
from workbench.geometry.distances import LineIndex, Stock, axis_distances, build_stock, index_lines, line_distances
from workbench.geometry.moves import limit_acceleration, step_lengths_mm
from workbench.geometry.stations import Cuts, standing_layers
from workbench.path.course import Bevel, Course, Poses, components, cutter_ends, finished, lower_course, poses_of
from workbench.path.obstacles import open_ends, scan_of, sections_of
from workbench.stage import AtLeast, stage
from workbench.units import DEG, AnyArray, Bool, Float

TANGENTS = 8  # that stand for a fillet: they leave it by 0.4 % of its radius at most
SWEPT_STATIONS = 10  # a mm of edge: fine enough for the steep sides of the circle that a cutter leaves


class Remaining(NamedTuple):
    """Points of the cloud that no earlier layer took away, and the face that each layer leaves."""

    stock: Stock
    faces: tuple[LineIndex | None, ...]  # of each layer once it is cut: a line across it at each key point
    open_ends: tuple[tuple[Float, Float], ...]  # where the scan stops on the edge: the place (3,), outwards (3,)


def remaining_stock(toolpath: Toolpath, cloud: Cloud, edge: Edge) -> Remaining:
    """What stands along a path. A point is gone once a layer cut below it, within the reach of the cutter's tip."""
    stock = build_stock(cloud.x_mm, cloud.z_mm, cloud.base_from_profiler, standing(toolpath, cloud, edge))
    ends = lower_course(edge, edge.arc_length_mm[[0, -1]])
    outwards = ends.tangent * np.array([[-1.0], [1.0]])
    stops = zip(ends.position_mm, outwards, open_ends(edge, cloud), strict=True)
    return Remaining(
        stock,
        tuple(face_lines(toolpath, layer) for layer in (*toolpath.before, *toolpath.layers)),
        tuple((place, out) for place, out, is_open in stops if is_open),
    )


def standing(toolpath: Toolpath, cloud: Cloud, edge: Edge, swept: bool = False) -> AnyArray:
    """For how many layers each point of the grid (N, M) still stands (`geometry.stations.standing_layers`).

    Layers count from the first of those that were milled before this path.

    `swept`: all that the cutter meets on its way, whether it is meant to cut there or not. It is round, so it takes
    some of what lies beside its places too; nothing below the finished face.
    """
    bevel, length = finished(toolpath), float(edge.arc_length_mm[-1])
    count = (len(edge.arc_length_mm) - 1) * (SWEPT_STATIONS if swept else 1) + 1
    table = lower_course(edge, np.linspace(0.0, length, count))
    (cosine, sine), radius = bevel.normal, toolpath.cutter.radius_mm
    final, faces = toolpath.layers[-1], []
    course = lower_course(edge, final.arc_length_mm)
    for layer in (*toolpath.before, *toolpath.layers):
        if layer.arc_length_mm is not final.arc_length_mm:
            course = lower_course(edge, layer.arc_length_mm)
        height = bevel.height_mm(from_edge(toolpath, layer, course))
        if swept:
            faces.append(_swept(np.maximum(height, 0.0), layer.arc_length_mm, table, bevel, radius))
        else:
            height = np.where(layer.cutting, height, np.inf)
            faces.append(_at_stations(height, layer.arc_length_mm, table.arc_length_mm))
    down = (from_edge(toolpath, layer, course) @ np.array([[sine], [-cosine]]))[:, 0]
    reach = np.interp(table.arc_length_mm, layer.arc_length_mm, down) + toolpath.cutter.flute_length_mm / 2.0
    if bevel.fillet_mm:  # as required, not as the path has it: below the fillet the part must remain
        reach = np.full_like(reach, radius - (bevel.root_mm + bevel.fillet_mm) * cosine)
    cuts = Cuts(
        cosine,
        sine,
        bevel.plane_mm * sine,
        bevel.fillet_mm,
        np.stack(faces, axis=1),
        reach,
        radius if swept else 0.0,
    )
    return standing_layers(scan_of(cloud, edge, sections_of(table)), cloud.keep, cuts)


def stock_distances(remaining: Remaining, toolpath: Toolpath, points: Layer | Travel, done: int, at: Bool) -> Float:
    """d_min of equation (26): distance (k,) mm of the cutter's axis to the stock after `done` layers.

    The axis reaches from the tip over the flute's length. NaN where `at` (k,) is false. Where the scan stops on the
    edge, the stock of the last section is taken to go on.
    """
    start, end = (ends[at] for ends in cutter_ends(toolpath, poses_of(toolpath, points)))
    for place, out in remaining.open_ends:
        beyond = np.maximum(((start + end) / 2.0 - place) @ out, 0.0)[:, None] * out
        start, end = start - beyond, end - beyond
    face = remaining.faces[done - 1] if done else None
    bound = np.full(len(start), np.inf) if face is None else line_distances(face, start, end)
    out = np.full(at.shape, np.nan)
    out[at] = axis_distances(remaining.stock, start, end, np.full(len(start), done), bound)
    return out


def moves_in_order(toolpath: Toolpath) -> Sequence[tuple[Layer | Travel, int]]:
    """Every travel and layer in the order in which they run, and how many layers are done by then."""
    layers, before = [isinstance(part, Layer) for part in toolpath.in_order], len(toolpath.before)
    return [(part, before + sum(layers[:k])) for k, part in enumerate(toolpath.in_order)]


def from_edge(toolpath: Toolpath, layer: Layer, course: Course) -> Float:
    """A layer's origins in the section plane (k, 2), along n and m, from the lower edge."""
    return components(poses_of(toolpath, layer).origin_mm - course.position_mm, course.normal, course.across)


def _at_stations(height: Float, s: Float, stations: Float) -> Float:
    """Heights (k,) at arc lengths s (k,) as those of the nearest stations (n,); infinite beyond the ends."""
    after = np.clip(np.searchsorted(s, stations), 1, s.size - 1)
    nearest = np.where(stations - s[after - 1] < s[after] - stations, after - 1, after)
    inside = (stations >= s[0] - 0.5) & (stations <= s[-1] + 0.5)
    return np.where(inside, height[nearest], np.inf)


def _swept(height: Float, s: Float, table: Course, bevel: Bevel, radius: float) -> Float:
    """Height (n,) at the stations of `table` that a cutter leaves which cuts to heights (k,) at s (k,).

    Across the feed it leaves a circle at each place. Seen from an edge that bends towards the cutter the circle is
    flatter: 1 / radius - curvature.
    """
    at, out = table.arc_length_mm, np.full(table.arc_length_mm.shape, np.inf)
    steep = np.maximum(1.0 / radius - table.curvature @ bevel.normal, 1e-3)
    first = np.searchsorted(s, at - radius)
    for k in range(int(np.max(np.searchsorted(s, at + radius, side="right") - first))):
        key = np.minimum(first + k, s.size - 1)
        apart = np.abs(s[key] - at)
        rise = (1.0 - np.sqrt(np.maximum(1.0 - (apart * steep) ** 2, 0.0))) / steep
        out = np.minimum(out, np.where(apart <= radius, height[key] + rise, np.inf))
    return out


def face_lines(toolpath: Toolpath, layer: Layer) -> LineIndex | None:
    """The face that a layer leaves, as lines across it where it cuts; None where it cuts nothing."""
    poses, half, cut = poses_of(toolpath, layer), layer.width_mm[:, None] / 2.0, layer.cutting
    middle = toolpath.in_base(toolpath.face_middle_mm(layer))
    lines = [((middle + half * poses.z)[cut], (middle - half * poses.z)[cut])]
    if toolpath.root_radius_mm:
        corners = _around_fillet(toolpath, poses)
        lines += [(a[cut], b[cut]) for a, b in itertools.pairwise(corners)]
    return index_lines(*(np.concatenate(ends) for ends in zip(*lines, strict=True)))


def _around_fillet(toolpath: Toolpath, poses: Poses) -> list[Float]:
    """Corners (k, 3) of a line of tangents around the fillet that a ball end makes, from the bevel face down."""
    radius, whole = toolpath.root_radius_mm, math.pi / 2.0 - toolpath.bevel_deg * DEG
    centre = poses.origin_mm + toolpath.cutter.cylinder_end_mm * poses.z - radius * poses.x
    each = whole / TANGENTS
    angles = [0.0, *(each * (np.arange(TANGENTS) + 0.5)), whole]
    reach = [radius, *[radius / math.cos(each / 2.0)] * TANGENTS, radius]
    return [
        np.asarray(centre + r * (math.cos(a) * poses.x + math.sin(a) * poses.z))
        for a, r in zip(angles, reach, strict=True)
    ]


@stage("path.feed")
def feed(
    toolpath: Toolpath,
    cloud: Cloud,
    edge: Edge,
    *,
    v_fast_mm_s: Annotated[float, Field(gt=0, le=5000), AtLeast("v_slow_mm_s", Toolpath)] = 20.0,
    acceleration_mm_s2: Annotated[float, Field(gt=0, le=1e5)] = 50.0,
) -> Toolpath:
    """Plan the feed by the distance of the cutter's axis to the remaining stock: the paper's equation (26).

    Formula and stock: docs/planning.md, "Feed". The feed of a point is the feed towards it.

    Args:
        toolpath: the path.
        cloud: the scan that it was planned from.
        edge: the edge that it was planned for.
        v_fast_mm_s: feed far from all material.
        acceleration_mm_s2: greatest change of the feed, per time.

    Raises:
        InputError: v_fast below the path's v_slow.

    Example:
        >>> from workbench import edge, path, scan
        >>> points = scan.fuse(scan.read(recording="data/synthetic/raw_edge.h5"))
        >>> raw = edge.segment_raw(points, upper_side=[0, 0, 1])
        >>> plan = path.feed(path.layers(raw, points), points, raw)
        >>> plan.time_s < plan.time_at_v_slow_s
        True
    """
    slow = toolpath.v_slow_mm_s
    if v_fast_mm_s < slow:
        raise InputError("v_fast_mm_s", f"expected at least the path's v_slow_mm_s = {slow:g}, found {v_fast_mm_s:g}")
    remaining, moves = remaining_stock(toolpath, cloud, edge), moves_in_order(toolpath)
    radius = toolpath.cutter.diameter_mm / 2.0
    wanted = []
    for points, done in moves:
        cutting = points.cutting if isinstance(points, Layer) else np.zeros(len(points.position_mm), bool)
        distance = stock_distances(remaining, toolpath, points, done, ~cutting)
        free = feed_of_distance(distance, radius, slow, v_fast_mm_s)
        wanted.append(np.where(cutting, slow, free if isinstance(points, Layer) else _sparse(free)))
    position = np.concatenate([points.position_mm for points, _ in moves])
    limited = limit_acceleration(np.concatenate(wanted), step_lengths_mm(position), acceleration_mm_s2)
    parts = iter(np.split(limited, np.cumsum([len(points.position_mm) for points, _ in moves])[:-1]))
    fed = [replace(points, feed_mm_s=part) for (points, _), part in zip(moves, parts, strict=True)]
    return replace(
        toolpath,
        layers=tuple(p for p in fed if isinstance(p, Layer)),
        travels=tuple(p for p in fed if isinstance(p, Travel)),
    )


def feed_of_distance(distance_mm: Float, radius_mm: float, v_slow_mm_s: float, v_fast_mm_s: float) -> Float:
    """Equation (26)."""
    steep = 1.0 + np.exp(-0.5 * (distance_mm - 10.0 - radius_mm))
    return np.asarray((v_fast_mm_s - v_slow_mm_s) / steep + v_slow_mm_s, dtype=np.float64)


def _sparse(feed_mm_s: Float) -> Float:
    """Feeds towards points that lie far apart: no faster than at either end of the step."""
    return np.asarray(np.minimum(feed_mm_s, np.concatenate([feed_mm_s[:1], feed_mm_s[:-1]])))
