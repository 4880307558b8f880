"""How far a driven tool leaves the planned path, as the part sees it: the part turns with the turntable."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from workbench.artefacts import Layer, Toolpath
from workbench.geometry.poses import inverse, rotation_from_quaternion
from workbench.robot.cell import Cell
from workbench.robot.collision import turntable_pose
from workbench.units import AnyArray, Float, Int

NEAR_MM = 20.0  # along the way, in which a place looks for its counterpart on the path
MOST_STEP_MM = 1.0  # between points of the path that are compared with


@dataclass(frozen=True, slots=True, eq=False)
class Planned:
    """The path that a program is to follow."""

    toolpath: Toolpath
    turntable: float  # where it stood when the path was planned, rad
    tolerance_mm: float  # by which the tool may leave it
    flange_from_point: Float  # (4, 4) the path's frames in the flange


def deviations(cell: Cell, planned: Planned, tool: Float, turntable: Float) -> tuple[float, list[tuple[int, str]]]:
    """The largest deviation over all layers, mm, and what is wrong: index of the place and words.

    Off the path's line, and turned, over half the flutes. Every layer must be driven from end to end in its order; what
    lies between the layers is in the air and only collides.

    Args:
        cell: the turntable.
        planned: the path.
        tool: (n, 4, 4) the path's frame on the flange, in the base; so near to each other that chords are the way.
        turntable: (n,) rad.
    """
    back = turntable_pose(cell, planned.turntable) @ inverse(_poses(cell, turntable)) @ tool
    faults: list[tuple[int, str]] = []
    largest, begin = 0.0, 0
    for layer in planned.toolpath.layers:
        found = _layer(planned, layer, back[begin:])
        if isinstance(found, str):
            faults.append((begin, found))
            continue
        first, off = found
        worst = int(off.argmax())
        largest = max(largest, float(off[worst]))
        if off[worst] > planned.tolerance_mm:
            faults.append((begin + first + worst, f"the tool leaves layer {layer.index} of the path by "
                           f"{off[worst]:.3f} mm, expected at most {planned.tolerance_mm:g} mm"))  # fmt: skip
        begin += first + len(off) - 1
    return largest, faults


def _poses(cell: Cell, turntable: Float) -> Float:
    distinct, which = np.unique(turntable, return_inverse=True)
    return np.array([turntable_pose(cell, float(angle)) for angle in distinct])[which]


def _layer(planned: Planned, layer: Layer, tool: Float) -> tuple[int, Float] | str:
    """Index of the first place on a layer, and the deviation (k,) from there to its last; or what is wrong."""
    path = planned.toolpath
    points, axes = path.in_base(layer.position_mm), rotation_from_quaternion(layer.quaternion_wxyz)
    if path.base_from_workobject is not None:
        axes = path.base_from_workobject[:3, :3] @ axes
    near = max(10 * planned.tolerance_mm, 0.5)
    first = _first(tool[:, :3, 3], points[0], near)
    if first is None:
        return f"the program never comes to the beginning of layer {layer.index} of its path"
    last = _first(tool[first:, :3, 3], points[-1], near)
    if last is None:
        return f"the program never comes to the end of layer {layer.index} of its path"
    driven = tool[first : first + last + 1]
    if len(driven) < 2:
        return f"layer {layer.index} of the path is not driven"
    lever = path.cutter.flute_length_mm / 2
    fine, turned = _densified(points, axes)
    there, back_ = _along(driven[:, :3, 3]), _along(fine)
    if abs(there[-1] - back_[-1]) > 0.01 * back_[-1] + NEAR_MM / 2:
        return f"layer {layer.index} of the path is {back_[-1]:.1f} mm long, the program drives {there[-1]:.1f} mm"
    off = _apart(driven, there * back_[-1] / max(there[-1], 1e-9), fine, turned, back_, lever)
    missed = _apart_points(fine, back_ * there[-1] / max(back_[-1], 1e-9), driven[:, :3, 3], there)
    off[np.searchsorted(there, there[-1] * 0.5)] = max(off[np.searchsorted(there, there[-1] * 0.5)],
                                                      float(missed.max()))  # fmt: skip
    return first, off


def _first(position: Float, target: Float, near: float) -> int | None:
    """The first place that passes a point nearest: the way between places counts."""
    if len(position) < 2:
        return None
    distance = _to_segments(target, position[:-1], np.diff(position, axis=0))[0]
    hits = np.flatnonzero(distance < near)
    if not len(hits):
        return None
    run = hits[: int(np.append(np.flatnonzero(np.diff(hits) > 1) + 1, len(hits))[0])]
    best = int(run[distance[run].argmin()])
    return best + int(np.linalg.norm(position[best + 1] - target) < np.linalg.norm(position[best] - target))


def _to_segments(point: Float, start: Float, way: Float) -> tuple[Float, Float]:
    """Distance of points (n, 3) or (3,) from segments (n, 3), and the share at which it lies."""
    square = np.maximum((way * way).sum(axis=-1), 1e-30)
    share = np.clip(((point - start) * way).sum(axis=-1) / square, 0.0, 1.0)
    return np.asarray(np.linalg.norm(start + share[..., None] * way - point, axis=-1)), share


def _along(position: Float) -> Float:
    return np.append(0.0, np.cumsum(np.linalg.norm(np.diff(position, axis=0), axis=1)))


def _densified(points: Float, axes: Float) -> tuple[Float, Float]:
    """Points no farther than MOST_STEP_MM from each other, and the frames of the nearest given ones."""
    step = np.linalg.norm(np.diff(points, axis=0), axis=1)
    count = np.maximum(np.ceil(step / MOST_STEP_MM), 1).astype(int)
    at = np.concatenate([*(i + np.arange(c) / c for i, c in enumerate(count.tolist())), [len(points) - 1]])
    index = np.minimum(at.astype(int), len(points) - 2)
    share = (at - index)[:, None]
    fine = points[index] + share * (points[index + 1] - points[index])
    turned = axes[index] + share[..., None] * (axes[index + 1] - axes[index])  # a degree apart at most: near enough
    return fine, turned


def _windows(places: Float, along: Float) -> Iterator[Int]:
    """For each shift in turn the segment of `along` that each of `places` (arc lengths) is compared with."""
    low = np.searchsorted(along, places - NEAR_MM).clip(0, len(along) - 2)
    high = np.searchsorted(along, places + NEAR_MM).clip(0, len(along) - 2)
    for shift in range(int((high - low).max()) + 1):
        yield np.minimum(low + shift, high)


def _apart(driven: Float, places: Float, fine: Float, turned: Float, along: Float, lever: float) -> Float:
    """Distance (k,) of the driven tool from the path near the same arc length, and its axis's tilt times the lever."""
    best, axis = np.full(len(driven), np.inf), np.zeros((len(driven), 3))
    for segment in _windows(places, along):
        start = fine[segment]
        distance, share = _to_segments(driven[:, :3, 3], start, fine[segment + 1] - start)
        nearer = distance < best
        best = np.where(nearer, distance, best)
        z = turned[segment, :, 2] + share[:, None] * (turned[segment + 1, :, 2] - turned[segment, :, 2])
        axis[nearer] = z[nearer]
    axis /= np.maximum(np.linalg.norm(axis, axis=1, keepdims=True), 1e-12)
    tilt = np.linalg.norm(np.cross(axis, driven[:, :3, 2]), axis=1)
    return np.asarray(best + lever * tilt)


def _apart_points(points: Float, places: Float, driven: Float, along: Float) -> Float:
    """Distance (m,) of the path's points from the driven way near the same arc length."""
    best: AnyArray = np.full(len(points), np.inf)
    for segment in _windows(places, along):
        start = driven[segment]
        best = np.minimum(best, _to_segments(points, start, driven[segment + 1] - start)[0])
    return np.asarray(best)
