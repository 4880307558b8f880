"""How far a driven tool leaves the planned path, as the part sees it: the part turns with the turntable."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from workbench.artefacts import Layer, Toolpath, Travel
from workbench.geometry.moves import arc_lengths_mm, chords_mm, runs
from workbench.geometry.poses import interpolate_poses, inverse
from workbench.robot.cell_model import Cell
from workbench.robot.collision import turntable_pose
from workbench.units import DEG, Float, Int, Shaped

NEAR_MM = 20.0  # along the way, in which a place looks for its counterpart on the path
MOST_STEP_MM = 1.0  # between points of the path that are compared with
MOST_TURN = 0.5 * DEG  # likewise
NO_LENGTH_MM = 1e-6
FEED_NEAR_MM = 1.0  # along the way, in which a place looks for the fastest feed
LEAST_S = 1e-12
QUICKER = 1.05  # times the feed: what angles that go evenly add where a turntable turns


@dataclass(frozen=True, slots=True, eq=False)
class Planned:
    """The path that a program is to follow."""

    toolpath: Toolpath
    turntable: Float | float  # where it stood when the path was planned, rad
    tolerance_mm: float  # by which the tool may leave it
    flange_from_point: Shaped[Float, "4 4"]  # the path's frames in the flange


@dataclass(slots=True)
class Driven:
    """What came of holding a way against the path; places by their indices."""

    largest_mm: float = 0.0
    faults: list[tuple[int, str, str]] = field(default_factory=list)  # place, kind, finding
    ends: tuple[int, int] | None = None  # from and to which place the path is driven


def deviations(
    cell: Cell,
    planned: Planned,
    tool: Shaped[Float, "n 4 4"],
    turntable: Shaped[Float, "n ..."],
    row: Shaped[Int, " n"],
    seconds: Shaped[Float, " n-1"],
) -> Driven:
    """How far the tool leaves the path over all layers and travels, and where it is faster than the path's feed.

    The cutter's axis off the path's, and turned, over half the flutes. Layers and the travels between them must be
    driven from end to end in their order: then what was checked of the path holds for the program.

    Args:
        cell: the external axes.
        planned: the path.
        tool: (n, 4, 4) the path's frame on the flange, in the base; so near to each other that chords are the way.
        turntable: (n,) or (n, e) their values, rad.
        row: (n,) index of the move that each place is on.
        seconds: (n - 1,) between places, where the program says times; inf elsewhere.
    """
    back = turntable_pose(cell, planned.turntable) @ inverse(turntable_pose(cell, turntable)) @ tool
    back[:, :3, 3] -= planned.toolpath.cutter.diameter_mm / 2 * back[:, :3, 0]  # a cutter may turn about its axis
    made, begin = Driven(), 0
    for name, points, axis, feed in _parts(planned.toolpath):
        found = _part(planned, name, points, axis, back[begin:])
        if isinstance(found, str):
            made.faults.append((begin, "deviation", found))
            continue
        first, off = found
        worst = int(off.argmax())
        made.largest_mm = max(made.largest_mm, float(off[worst]))
        if off[worst] > planned.tolerance_mm:
            finding = f"the tool leaves {name} of the path by {off[worst]:.3f} mm, expected at most "
            made.faults.append((begin + first + worst, "deviation", f"{finding}{planned.tolerance_mm:g} mm"))
        begin, last = begin + first, begin + first + len(off) - 1
        part, rows = back[begin : last + 1, :3, 3], row[begin + 1 : last + 1]
        place, speed, most = _quickest(part, rows, seconds[begin:last], points, feed)
        if speed > QUICKER * most:
            finding = f"the tool goes along {name} at {speed:.3g} mm/s, expected the path's feed, {most:.3g} mm/s there"
            made.faults.append((begin + place, "feed", finding))
        made.ends = (made.ends[0] if made.ends else begin, last)
        begin = last
    return made


def lateral_mm(path: Toolpath, tool: Shaped[Float, "4 4"], back_mm: float) -> float:
    """How far a tool frame, drawn back along its axis by `back_mm`, stands beside where its path's first layer cuts."""
    layer = next(part for part in path.layers if part.cutting.any())
    position, quaternion = layer.position_mm[layer.cutting], layer.quaternion_wxyz[layer.cutting]
    points = _densified(path, position, quaternion, layer.feed_mm_s[layer.cutting])[0]
    at = tool[:3, 3] - path.cutter.diameter_mm / 2 * tool[:3, 0] + back_mm * tool[:3, 2]
    return float(_to_segments(at, points[:-1], np.diff(points, axis=0))[0].min())


def _quickest(driven: Float, row: Int, seconds: Float, fine: Float, feed: Float) -> tuple[int, float, float]:
    """The last place (of n) of the move that is too fast on the whole, its speed, and the path's fastest near it, mm/s.

    Within a move the speed is the controller's: angles that go evenly make it waver where a turntable turns.
    """
    there, along = arc_lengths_mm(driven), arc_lengths_mm(fine)
    first = np.flatnonzero(np.append(True, np.diff(row) != 0))
    last = np.append(first[1:], len(row))
    speed = (there[last] - there[first]) / np.maximum(np.add.reduceat(seconds, first), LEAST_S)
    there *= along[-1] / max(there[-1], 1e-9)
    low = np.searchsorted(along, there[first] - FEED_NEAR_MM).clip(1, len(feed)) - 1
    high = np.searchsorted(along, there[last] + FEED_NEAR_MM).clip(1, len(feed))
    most = np.array([feed[a:b].max() for a, b in zip(low.tolist(), high.tolist(), strict=True)])
    worst = int((speed / most).argmax())
    return int(last[worst]), float(speed[worst]), float(most[worst])


def _parts(path: Toolpath) -> Iterator[tuple[str, Float, Float, Float]]:
    """Layers and what lies between them, in order: name, points (k, 3) of the cutter's axis, axis (k, 3), feed (k-1,).

    A travel begins where the part before it ends, and ends where the next one begins. Between its points the path's own
    frame moves straight and turns evenly, as `stiffness.posture` fills it up.
    """
    parts = [part for part in path.in_order if len(part.feed_mm_s)]
    for i, part in enumerate(parts):
        row = [part]
        if not isinstance(part, Layer):
            row = [*parts[max(i - 1, 0) : i], part, *parts[i + 1 : i + 2]]
        position = np.concatenate([_ends(one, j, part)[0] for j, one in enumerate(row)])
        quaternion = np.concatenate([_ends(one, j, part)[1] for j, one in enumerate(row)])
        feed = np.concatenate([_ends(one, j, part)[2] for j, one in enumerate(row)])
        if chords_mm(position).sum() <= NO_LENGTH_MM:
            continue
        name = f"layer {part.index}" if isinstance(part, Layer) else f"the travel {_neighbour(parts, i)}"
        yield name, *_densified(path, position, quaternion, feed)


def _neighbour(parts: list[Layer | Travel], i: int) -> str:
    """Which layer a travel follows, or leads to."""
    before = [part.index for part in parts[:i] if isinstance(part, Layer)]
    return f"behind layer {before[-1]}" if before else "before the first layer"


def _ends(one: Layer | Travel, place: int, part: Layer | Travel) -> tuple[Float, Float, Float]:
    """All points of the part itself, the last one of the part before it, the first one of the part behind it."""
    which = slice(None) if one is part else slice(-1, None) if place == 0 else slice(0, 1)
    return one.position_mm[which], one.quaternion_wxyz[which], one.feed_mm_s[which]


def _part(planned: Planned, name: str, fine: Float, axis: Float, tool: Float) -> tuple[int, Float] | str:
    """Index of the first place on a part, and the deviation (k,) from there to its last; or what is wrong."""
    near = max(10 * planned.tolerance_mm, 0.5)
    first = _first(tool[:, :3, 3], fine[0], near)
    if first is None:
        return f"the program never comes to the beginning of {name} of its path"
    last = _first(tool[first:, :3, 3], fine[-1], near)
    if last is None:
        return f"the program never comes to the end of {name} of its path"
    driven = tool[first : first + last + 1]
    if len(driven) < 2:
        return f"{name} of the path is not driven"
    lever = planned.toolpath.cutter.flute_length_mm / 2
    there, back = arc_lengths_mm(driven[:, :3, 3]), arc_lengths_mm(fine)
    if abs(there[-1] - back[-1]) > 0.01 * back[-1] + NEAR_MM / 2:
        return f"{name} of the path is {back[-1]:.1f} mm long, the program drives {there[-1]:.1f} mm"
    off, at, share = _nearest(driven[:, :3, 3], there * back[-1] / max(there[-1], 1e-9), fine, back)
    z = axis[at] + share[:, None] * (axis[at + 1] - axis[at])
    z /= np.maximum(np.linalg.norm(z, axis=1, keepdims=True), 1e-12)
    off = off + lever * np.linalg.norm(np.cross(z, driven[:, :3, 2]), axis=1)
    along = back * there[-1] / max(back[-1], 1e-9)
    missed = _nearest(fine, along, driven[:, :3, 3], there)[0]
    worst = int(missed.argmax())
    nearest = min(int(np.searchsorted(there, along[worst])), len(off) - 1)
    off[nearest] = max(off[nearest], float(missed[worst]))
    return first, off


def _first(position: Float, target: Float, near: float) -> int | None:
    """The first place that passes a point nearest: the way between places counts."""
    if len(position) < 2:
        return None
    distance = _to_segments(target, position[:-1], np.diff(position, axis=0))[0]
    passes = runs(distance < near)
    if not passes:
        return None
    begin, end = passes[0]
    best = begin + int(distance[begin : end + 1].argmin())
    return best + int(np.linalg.norm(position[best + 1] - target) < np.linalg.norm(position[best] - target))


def _to_segments(point: Float, start: Float, way: Float) -> tuple[Float, Float]:
    """Distance of points (n, 3) or (3,) from segments (n, 3), and the share at which it lies."""
    square = np.maximum((way * way).sum(axis=-1), 1e-30)
    share = np.clip(((point - start) * way).sum(axis=-1) / square, 0.0, 1.0)
    return np.asarray(np.linalg.norm(start + share[..., None] * way - point, axis=-1)), share


def turned(one: Float, other: Float) -> Float:
    """Angle (...), 0 to pi, between orientations, unit quaternions (..., 4)."""
    return np.asarray(2 * np.arccos(np.clip(np.abs((one * other).sum(axis=-1)), 0, 1)))


def _densified(path: Toolpath, position: Float, quaternion: Float, feed: Float) -> tuple[Float, Float, Float]:
    """Points of the cutter's axis in the base, at most MOST_STEP_MM from each other, its direction and its speed."""
    step = chords_mm(position)
    turn = turned(quaternion[1:], quaternion[:-1])
    count = np.maximum(np.ceil(np.maximum(step / MOST_STEP_MM, turn / MOST_TURN)), 1).astype(int)
    at = np.concatenate([*(i + np.arange(c) / c for i, c in enumerate(count.tolist())), [len(position) - 1]])
    poses = interpolate_poses(at, np.arange(len(position), dtype=float), position, quaternion)
    axes, points = poses[:, :3, :3], poses[:, :3, 3] - path.cutter.diameter_mm / 2 * poses[:, :3, 0]
    rotation = np.eye(3) if path.base_from_workobject is None else path.base_from_workobject[:3, :3]
    own, axis = (chords_mm(one) for one in (poses[:, :3, 3], points))
    towards = feed[np.floor(at[:-1]).astype(int) + 1]
    speed = np.where(own > NO_LENGTH_MM, towards * axis / np.maximum(own, NO_LENGTH_MM), np.inf)
    return path.in_base(points), axes[:, :, 2] @ rotation.T, speed


def _nearest(points: Float, places: Float, chain: Float, along: Float) -> tuple[Float, Int, Float]:
    """Distance of points (k, 3) from a chain (m, 3) near the same arc length; the segment, and the share of it."""
    low = np.searchsorted(along, places - NEAR_MM).clip(0, len(along) - 2)
    high = np.searchsorted(along, places + NEAR_MM).clip(0, len(along) - 2)
    best, at, of = np.full(len(points), np.inf), np.zeros(len(points), int), np.zeros(len(points))
    for shift in range(int((high - low).max()) + 1):
        segment = np.minimum(low + shift, high)
        distance, share = _to_segments(points, chain[segment], chain[segment + 1] - chain[segment])
        nearer = distance < best
        best[nearer], at[nearer], of[nearer] = distance[nearer], segment[nearer], share[nearer]
    return best, at, of
