"""Collision and clearance of a posture by python-fcl, with geometry objects of its own. Lengths in mm.

fcl gets copies built here: objects of pin's own geometry crash it. Its quaternions are w x y z.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from workbench.extras import Extra
from workbench.geometry.poses import inverse
from workbench.robot.cell import COVERAGE, ON_TURNTABLE, Cell, Shape
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

    def collision(self, joints: Float, turntable: float = 0.0) -> tuple[str, str] | None:
        """The first pair of bodies that are too near at joint angles (6,), rad; None: the posture is free."""
        self._place(joints, turntable)
        for i, (a, b) in enumerate(self.pairs):
            if self._near(i):
                return self.names(a, b)
        return None

    def gaps(self, joints: Float, turntable: float = 0.0) -> list[Clearance]:
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

    def clearance(self, joints: Float, turntable: float = 0.0) -> Clearance | None:
        """The smallest distance and its pair at joint angles (6,), rad; None where nothing could touch."""
        self._place(joints, turntable)
        best: Clearance | None = None
        for a, b in self.pairs:
            distance = 0.0 if self._touch(a, b) else self._distance(a, b)
            if best is None or distance < best.distance_mm:
                best = Clearance(distance, self.names(a, b))
        return best

    def first_hit(self, moved: Shaped[Float, "7 4 4"], turned: Shaped[Float, "4 4"], pairs: list[int]) -> int:
        """The first of some pairs (indices into `pairs`) that is nearer than it must keep apart; -1: none.

        Args:
            moved: (7, 4, 4) motions of base and links.
            turned: (4, 4) pose of the turntable.
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

    def _place(self, joints: Float, turntable: float) -> None:
        moved = motions(self._cell.chain, joints)
        turned = turntable_pose(self._cell, turntable)
        for shape in range(len(self._objects)):
            self._put(shape, moved, turned)

    def _put(self, index: int, moved: Float, turned: Float) -> None:
        shape = self._cell.shapes[index]
        pose = (turned if shape.link == ON_TURNTABLE else moved[max(shape.link, 0)]) @ shape.pose
        self._objects[index].setTransform(fcl.Transform(pose[:3, :3], pose[:3, 3]))


def turntable_pose(cell: Cell, angle: Float | float) -> Float:
    """`base_from_turntable` (..., 4, 4) at values (...), rad; the base itself where there is no turntable."""
    moved = np.broadcast_to(np.eye(4), (*np.shape(angle), 4, 4)).copy()
    if cell.turntable is None:
        return moved
    if cell.turntable.slides:
        moved[..., 2, 3] = np.asarray(angle) / DEG
    else:
        moved[..., 0, 0] = moved[..., 1, 1] = np.cos(angle)
        moved[..., 1, 0], moved[..., 0, 1] = np.sin(angle), -np.sin(angle)
    return np.asarray(cell.turntable.base_from_turntable @ moved)


def sliding(cell: Cell) -> bool:
    """Whether the robot stands on a track."""
    return cell.turntable is not None and cell.turntable.slides


def base_from_targets(cell: Cell, angle: Float | float) -> Float:
    """Where the frame (..., 4, 4) in which a program has its targets stands in the robot's base, at values (...), rad.

    The controller knows a track as the robot's own: targets stay on the floor, where the base is with the track at 0.
    """
    if not sliding(cell):
        return np.broadcast_to(np.eye(4), (*np.shape(angle), 4, 4))
    return np.asarray(turntable_pose(cell, angle) @ inverse(turntable_pose(cell, 0.0)))


def checked_pairs(cell: Cell) -> list[tuple[int, int]]:
    """Indices of the cell's shapes that must not touch each other."""
    free = {frozenset(pair) for pair in cell.may_touch}
    shapes = cell.shapes
    return [
        (a, b)
        for a in range(len(shapes))
        for b in range(a + 1, len(shapes))
        if _checked(shapes[a], shapes[b], carried=sliding(cell))
        and frozenset((shapes[a].body, shapes[b].body)) not in free
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


def _checked(a: Shape, b: Shape, *, carried: bool) -> bool:
    """Neighbours along the robot touch at their joint; what does not move cannot run into each other.

    What is `carried` along a track can run into what stands beside it.
    """
    if a.body == b.body:
        return False
    if not (1 <= a.link <= 6 or 1 <= b.link <= 6):
        return carried and (a.link == ON_TURNTABLE) != (b.link == ON_TURNTABLE)
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
