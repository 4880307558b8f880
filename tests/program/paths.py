"""Milling paths from formulas, and what a robot's controller makes of moves: by other means than the product's."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from itertools import zip_longest

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from workbench.artefacts import Cutter, Layer, Toolpath, Travel

LEAD_MM = 10


@dataclass(frozen=True)
class Shape:
    """An edge: an arc that bends by `bend` (1/mm; 0 straight, negative concave), with a wave across it."""

    bend: float = 0.0
    length_mm: int = 600
    wave_mm: float = 0.0
    wave_length_mm: float = 100.0
    layers: int = 2
    lifted_mm: tuple[float, float] | None = None  # not measured there, the cutter is above it
    turn: tuple[float, float, float] = (0.4, -0.7, 1.1)  # rotation vector of the whole part


def course(shape: Shape, s):
    """Points (n, 3) and unit tangents of the edge in the plane z = 0; outward is to the right of the tangent."""
    angle, k = s * shape.bend, 2 * np.pi / shape.wave_length_mm
    along = np.sinc(angle / np.pi) * s if shape.bend else s
    inward = np.sin(angle / 2) ** 2 * 2 / shape.bend if shape.bend else 0 * s
    tangent = np.stack([np.cos(angle), np.sin(angle), 0 * s], axis=1)
    normal = np.stack([np.sin(angle), -np.cos(angle), 0 * s], axis=1)
    points = np.stack([along, inward, 0 * s], axis=1) + (shape.wave_mm * np.sin(k * s))[:, None] * normal
    tangent = tangent + (shape.wave_mm * k * np.cos(k * s))[:, None] * normal
    return points, tangent / np.linalg.norm(tangent, axis=1, keepdims=True)


def mill_path(shape: Shape = Shape(), **more) -> Toolpath:
    """Layers 1 mm apart down to a bevel of 40 deg, key points every mm, with travels above the part."""
    s = np.arange(-LEAD_MM, shape.length_mm + LEAD_MM + 1.0)
    points, y = course(shape, s)
    up = np.tile([0.0, 0.0, 1.0], (len(s), 1))
    z = -up * np.cos(np.radians(40)) + np.cross(y, up) * np.sin(np.radians(40))
    x = np.cross(y, z)
    whole = Rotation.from_rotvec(shape.turn)
    turned = whole * Rotation.from_matrix(np.stack([x, y, z], axis=2))
    points, x, q = whole.apply(points) + np.array([900, -200, 700]), whole.apply(x), turned.as_quat(scalar_first=True)
    inside, measured = (s >= 0) & (s <= shape.length_mm), np.full(len(s), True)
    lift = np.zeros(len(s))
    if shape.lifted_mm:
        a, b = shape.lifted_mm
        measured = (s < a) | (s > b)
        ramp = np.clip(np.minimum(s - a + 10, b + 10 - s) / 10, 0, 1)
        lift = 20 * ramp**2 * (3 - 2 * ramp)
    cutting = inside & measured & (lift == 0)
    feed = np.where(cutting, 1.0, 6.0)
    heights = np.arange(shape.layers)[::-1]
    layers = tuple(
        Layer(i + 1, float(h), s, points - x * (h + lift)[:, None], q, feed, cutting, measured, 5.0 * cutting)
        for i, h in enumerate(heights)
    )
    ends = [layer.position_mm[[0, -1]] for layer in layers]
    above = [end - 40 * x[[0, -1]] for end in ends]
    travels = [travel([above[0][0], ends[0][0]], q[[0, 0]])]
    for i in range(shape.layers - 1):
        travels.append(travel([ends[i][1], above[i][1], above[i + 1][0], ends[i + 1][0]], q[[-1, -1, 0, 0]]))
    travels.append(travel([ends[-1][1], above[-1][1]], q[[-1, -1]]))
    return Toolpath(Cutter(), layers, tuple(travels), 1.5, 40.0, 1.0, 1.0, float(shape.length_mm), **more)


def thinned(path: Toolpath, some) -> Toolpath:
    """The path with some points (indices) of every layer."""

    def fewer(layer: Layer) -> Layer:
        columns = {one.name: getattr(layer, one.name) for one in fields(layer)}
        return replace(layer, **{name: part[some] for name, part in columns.items() if isinstance(part, np.ndarray)})

    return replace(path, layers=tuple(map(fewer, path.layers)))


def moved(path: Toolpath, move: np.ndarray) -> Toolpath:
    """The path elsewhere."""

    def part(one):
        place = one.position_mm @ move[:3, :3].T + move[:3, 3]
        turn = Rotation.from_matrix(move[:3, :3]) * Rotation.from_quat(one.quaternion_wxyz, scalar_first=True)
        return replace(one, position_mm=place, quaternion_wxyz=turn.as_quat(scalar_first=True))

    layers: tuple[Layer, ...] = tuple(part(layer) for layer in path.layers)
    return replace(path, layers=layers, travels=tuple(part(one) for one in path.travels))


def in_work_object(path: Toolpath, base_from_workobject: np.ndarray) -> Toolpath:
    """The same path with its poses in the frame of a work object."""
    finishing = path.finishing and in_work_object(path.finishing, base_from_workobject)
    there = moved(path, np.linalg.inv(base_from_workobject))
    return replace(there, finishing=finishing, base_from_workobject=base_from_workobject)


def travel(points, quaternions) -> Travel:
    return Travel(np.array(points), np.array(quaternions), np.full(len(points), 20.0))


def all_points(path: Toolpath):
    """Positions, quaternions and feeds of all points in the order of motion."""
    parts = [part for pair in zip_longest(path.travels, path.layers) for part in pair if part is not None]
    return tuple(
        np.concatenate([getattr(part, name) for part in parts])
        for name in ("position_mm", "quaternion_wxyz", "feed_mm_s")
    )


def circle(start, via, target):
    """Centre, axis and sweep of the circle from start over via to target: three planes meet in its centre."""
    axis = np.cross(via - start, target - start)
    axis /= np.linalg.norm(axis)
    planes = np.array([via - start, target - start, axis])
    centre = np.linalg.solve(
        planes, [(via - start) @ (via + start) / 2, (target - start) @ (target + start) / 2, axis @ start]
    )
    a, b = start - centre, target - centre
    return centre, axis, np.arctan2(np.cross(a, b) @ axis, a @ b) % (2 * np.pi)


def run_move(start, via, target, count=500):
    """Places that the controller passes, evenly spaced; via None: on a line."""
    f = np.linspace(0, 1, count)
    if via is None:
        return start + f[:, None] * (target - start)
    centre, axis, sweep = circle(start, via, target)
    return centre + Rotation.from_rotvec(f[:, None] * sweep * axis).apply(start - centre)


def deviations(points, quaternions, position, quaternion, via):
    """How far each point of a path is from the moves that should pass it: mm and deg, and in order.

    `position`, `quaternion` (k, 3), (k, 4) are the targets, `via` (k, 3) NaN for straight moves. A point belongs to
    the first move that ends at it or after it: targets are found among the points, in order, to 0.001 mm.
    """
    off_mm, off_deg, i = [], [], 0
    for k in range(1, len(position)):
        ahead = np.flatnonzero(np.linalg.norm(points[i + 1 :] - position[k], axis=1) < 1e-3)
        assert ahead.size, f"target {k} is no point of the path"
        j = i + 1 + ahead[0]
        places = run_move(position[k - 1], None if np.isnan(via[k, 0]) else via[k], position[k])
        distance, fraction = to_polyline(points[i : j + 1], places)
        assert (np.diff(fraction) >= -1e-3).all(), f"move {k} passes its points in another order"
        turns = Rotation.from_quat(quaternion[[k - 1, k]], scalar_first=True)
        turned = Slerp([0, 1], turns)(np.clip(fraction, 0, 1))
        wanted = Rotation.from_quat(quaternions[i : j + 1], scalar_first=True)
        off_mm.append(distance)
        off_deg.append(np.degrees((turned * wanted.inv()).magnitude()))
        i = j
    assert i == len(points) - 1, "the program ends before the path"
    return np.concatenate(off_mm), np.concatenate(off_deg)


def to_polyline(points, places):
    """Distance of each point from the polyline through `places`, and the share of it at which it lies."""
    a, d = places[:-1], np.diff(places, axis=0)
    length2 = np.maximum((d**2).sum(axis=1), 1e-30)
    t = np.clip(((points[:, None] - a) * d).sum(axis=2) / length2, 0, 1)
    distance = np.linalg.norm(points[:, None] - a - t[..., None] * d, axis=2)
    best = np.argmin(distance, axis=1)
    rows = np.arange(len(points))
    return distance[rows, best], (best + t[rows, best]) / len(d)
