"""Collision and clearance of a posture by python-fcl, with geometry objects of its own. Lengths in mm.

fcl gets copies built here: objects of pin's own geometry crash it. Its quaternions are w x y z.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from workbench.errors import InputError
from workbench.extras import Extra
from workbench.geometry.poses import inverse
from workbench.robot.cell import COVERAGE, ON_TURNTABLE, Cell, Shape, Turntable
from workbench.robot.kinematics import motions
from workbench.units import DEG, Float, Shaped

if TYPE_CHECKING:
    import fcl
else:
    fcl = Extra("fcl")

POINTS_FIT_MM = 0.1  # how exactly fcl's nearest points have to fit its distance


@dataclass(frozen=True, slots=True, eq=False)
class Clearance:
    """The smallest distance between two bodies that must not touch; 0 where they do."""

    distance_mm: float
    pair: tuple[str, str]
    points_mm: Shaped[Float, "2 3"] | None = None  # the nearest points, in the base, where they are known
    near: bool = False  # nearer than the two must keep apart


class CollisionModel:
    """The cell's shapes as fcl objects, and the pairs of them that must not touch."""

    def __init__(self, cell: Cell) -> None:
        """Build once, ask often."""
        self._cell = cell
        self._objects = [fcl.CollisionObject(body_of(shape)) for shape in cell.shapes]
        self.pairs = checked_pairs(cell)
        self.least_mm = least_mm(cell)

    def __repr__(self) -> str:
        """The cell, and how much is looked at."""
        return f"CollisionModel({self._cell.title!r}, {len(self._objects)} bodies, {len(self.pairs)} pairs)"

    def collision(self, joints: Float, turntable: Float | float = 0.0) -> tuple[str, str] | None:
        """The first pair of bodies that are too near at joint angles (6,), rad; None: the posture is free."""
        self._place(joints, turntable)
        for i, (a, b) in enumerate(self.pairs):
            if self._near(i):
                return self.names(a, b)
        return None

    def gaps(self, joints: Float, turntable: Float | float = 0.0) -> list[Clearance]:
        """The distance of every pair of bodies that must not touch, at joint angles (6,), rad; the nearest first."""
        self._place(joints, turntable)
        least: dict[tuple[str, str], Clearance] = {}
        for i, (a, b) in enumerate(self.pairs):
            pair = self.names(a, b)
            distance, points = (0.0, None) if self._touch(a, b) else self._nearest_points(a, b)
            near = distance <= 0 or distance < self.least_mm[i]
            if pair not in least or (not near, distance) < (not least[pair].near, least[pair].distance_mm):
                least[pair] = Clearance(distance, pair, points, near)
        return sorted(least.values(), key=lambda gap: gap.distance_mm)

    def clearance(self, joints: Float, turntable: Float | float = 0.0) -> Clearance | None:
        """The smallest distance and its pair at joint angles (6,), rad; None where nothing could touch."""
        self._place(joints, turntable)
        best: Clearance | None = None
        for a, b in self.pairs:
            distance = 0.0 if self._touch(a, b) else self._distance(a, b)
            if best is None or distance < best.distance_mm:
                best = Clearance(distance, self.names(a, b))
        return best

    def first_hit(self, moved: Shaped[Float, "7 4 4"], turned: Shaped[Float, "a 4 4"], pairs: list[int]) -> int:
        """The first of some pairs (indices into `pairs`) that is nearer than it must keep apart; -1: none.

        Args:
            moved: (7, 4, 4) motions of base and links.
            turned: (a, 4, 4) poses of the turntable and of what it stands on (`standing_poses`).
            pairs: to be looked at.
        """
        for shape in {s for i in pairs for s in self.pairs[i]}:
            self._put(shape, moved, turned)
        return next((i for i in pairs if self._near(i)), -1)

    def distances(self, moved: Float, turned: Float, pairs: list[int]) -> list[float]:
        """The distance of some pairs (indices into `pairs`), 0 where they touch; arguments as in `first_hit`."""
        for shape in {s for i in pairs for s in self.pairs[i]}:
            self._put(shape, moved, turned)
        at = (self.pairs[i] for i in pairs)
        return [0.0 if self._touch(a, b) else self._distance(a, b) for a, b in at]

    def names(self, a: int, b: int) -> tuple[str, str]:
        """Of two bodies by the indices of their shapes."""
        return self._cell.shapes[a].body, self._cell.shapes[b].body

    def _near(self, pair: int) -> bool:
        (a, b), least = self.pairs[pair], self.least_mm[pair]
        return self._touch(a, b) or bool(least > 0 and self._distance(a, b) < least)

    def _touch(self, a: int, b: int) -> bool:
        return bool(fcl.collide(self._objects[a], self._objects[b], fcl.CollisionRequest(), fcl.CollisionResult()))

    def _distance(self, a: int, b: int) -> float:
        return max(float(fcl.distance(self._objects[a], self._objects[b], fcl.DistanceRequest())), 0.0)

    def _nearest_points(self, a: int, b: int) -> tuple[float, Float | None]:
        """The distance, and fcl's two nearest points if they are as far apart."""
        result, request = fcl.DistanceResult(), fcl.DistanceRequest(enable_nearest_points=True)
        distance = max(float(fcl.distance(self._objects[a], self._objects[b], request, result)), 0.0)
        points = np.array(result.nearest_points)
        fits = abs(np.linalg.norm(points[1] - points[0]) - distance) < POINTS_FIT_MM
        return distance, points if fits else None

    def _place(self, joints: Float, turntable: Float | float) -> None:
        moved = motions(self._cell.chain, joints)
        turned = standing_poses(self._cell, turntable)
        for shape in range(len(self._objects)):
            self._put(shape, moved, turned)

    def _put(self, index: int, moved: Float, turned: Float) -> None:
        shape = self._cell.shapes[index]
        carrier = turned[shape.link - ON_TURNTABLE] if shape.link >= ON_TURNTABLE else moved[max(shape.link, 0)]
        pose = carrier @ shape.pose
        self._objects[index].setTransform(fcl.Transform(pose[:3, :3], pose[:3, 3]))


def turntable_pose(cell: Cell, angle: Float | float) -> Float:
    """`base_from_turntable` (..., 4, 4) at values of the external axes, rad; the base itself where there are none."""
    return np.asarray(standing_poses(cell, angle)[0])


def standing_poses(cell: Cell, angle: Float | float) -> Float:
    """Poses (a, ..., 4, 4) in the base of the external axes at their values, rad: the outermost, what carries it, ...

    One number is the outermost's, with the others at 0.
    """
    axes = cell.axes
    values = np.asarray(angle, float) if np.ndim(angle) else outermost(cell, np.asarray(angle, float))
    each = np.moveaxis(values, -1, 0) if len(axes) > 1 else values[None]
    pose, found, before = np.eye(4), [], np.eye(4)
    for axis, value in zip(axes, each, strict=False):
        pose = pose @ inverse(before) @ axis.base_from_turntable @ _moved(axis, value)
        before = axis.base_from_turntable
        found.append(pose)
    return np.stack(found[::-1] or [np.broadcast_to(np.eye(4), (*values.shape, 4, 4))])


def outermost(cell: Cell, angle: Float) -> Float:
    """Values of the external axes where the outermost stands at (...), rad, and the others at 0."""
    many = len(cell.axes)
    return np.asarray(angle if many < 2 else np.multiply.outer(angle, np.arange(many) == many - 1))


def external_at(cell: Cell, turntable_deg: float, tilt_deg: float, where: str) -> Float:
    """Values of the external axes, rad; InputError, named `where`, for the angle of a tilt that is not there."""
    if len(cell.axes) > 1:
        return np.array([tilt_deg, turntable_deg]) * DEG
    if tilt_deg:
        raise InputError(where, "expected a tilt of 0 deg: the cell's turntable has none")
    return np.asarray(turntable_deg * DEG)


def _moved(axis: Turntable, value: Float) -> Float:
    """An axis against where it is at 0 (..., 4, 4)."""
    moved = np.broadcast_to(np.eye(4), (*value.shape, 4, 4)).copy()
    if axis.slides:
        moved[..., 2, 3] = value / DEG
    else:
        moved[..., 0, 0] = moved[..., 1, 1] = np.cos(value)
        moved[..., 1, 0], moved[..., 0, 1] = np.sin(value), -np.sin(value)
    return moved


def sliding(cell: Cell) -> bool:
    """Whether the robot stands on a track."""
    return cell.turntable is not None and cell.turntable.slides


def base_from_targets(cell: Cell, angle: Float | float) -> Float:
    """Where the frame (..., 4, 4) in which a program has its targets stands in the robot's base, at values (...), rad.

    The controller knows a track as the robot's own: targets stay on the floor, where the base is with the track at 0.
    """
    if not sliding(cell):
        each = np.shape(angle)[:-1] if len(cell.axes) > 1 else np.shape(angle)
        return np.broadcast_to(np.eye(4), (*each, 4, 4))
    return np.asarray(turntable_pose(cell, angle) @ inverse(turntable_pose(cell, 0.0)))


def checked_pairs(cell: Cell) -> list[tuple[int, int]]:
    """Indices of the cell's shapes that must not touch each other."""
    free = {frozenset(pair) for pair in cell.may_touch}
    shapes = cell.shapes
    return [
        (a, b)
        for a in range(len(shapes))
        for b in range(a + 1, len(shapes))
        if _checked(shapes[a], shapes[b], cell.axes) and frozenset((shapes[a].body, shapes[b].body)) not in free
    ]


def least_mm(cell: Cell) -> Float:
    """How far each of the checked pairs (P,) must keep apart: the clearance, and what tool and part may be off.

    Coverage 2. A rotation of the tool turns its bodies about the flange, one of the part turns what stands there about
    itself.
    """
    margins, flange = cell.margins, cell.chain.base_from_flange_at_zero[:3, 3]
    off = np.zeros(len(cell.shapes))
    for i, shape in enumerate(cell.shapes):
        middle, radius = shape.sphere
        if shape.body in ("tool", "cutter"):
            off[i] = np.hypot(margins.flange_mm, margins.flange_rad * (np.linalg.norm(middle - flange) + radius))
        elif not 0 <= shape.link <= 6:
            off[i] = np.hypot(margins.part_mm, margins.part_rad * radius)
    two = off[np.array(checked_pairs(cell), int).reshape(-1, 2)]
    return np.asarray(cell.margin_mm + COVERAGE * np.hypot(two[:, 0], two[:, 1]))


def _checked(a: Shape, b: Shape, axes: tuple[Turntable, ...]) -> bool:
    """Neighbours along the robot touch at their joint, and a turntable what carries it.

    What external axes move otherwise, on a turntable, along a track or tilted, can run into what stands beside it.
    """
    if a.body == b.body:
        return False
    if not (1 <= a.link <= 6 or 1 <= b.link <= 6):
        low, high = sorted(len(axes) - one.link + ON_TURNTABLE if one.link >= ON_TURNTABLE else 0 for one in (a, b))
        turns = high == len(axes) == low + 1 and not axes[-1].slides
        return low != high and not (turns and "turntable" in (a.body, b.body))
    neighbours = abs(a.link - b.link) <= 1
    return not (neighbours and 0 <= a.link <= 6 and 0 <= b.link <= 6)


def body_of(shape: Shape) -> fcl.CollisionGeometry:
    """fcl's geometry of a shape, about the shape's own frame."""
    if shape.kind == "mesh":
        assert shape.vertices_mm is not None
        assert shape.triangles is not None
        mesh = fcl.BVHModel()
        mesh.beginModel(len(shape.vertices_mm), len(shape.triangles))
        mesh.addSubModel(shape.vertices_mm, shape.triangles)
        mesh.endModel()
        return mesh
    makers = {"box": fcl.Box, "sphere": fcl.Sphere, "capsule": fcl.Capsule, "cylinder": fcl.Cylinder}
    return makers[shape.kind](*shape.size_mm)
