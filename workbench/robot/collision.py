"""Collision and clearance of a posture by python-fcl, with geometry objects of its own. Lengths in mm.

fcl gets copies built here: objects of pin's own geometry crash it. Its quaternions are w x y z.
"""

from __future__ import annotations

import functools
import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from workbench.errors import InputError
from workbench.extras import Extra
from workbench.geometry.poses import inverse
from workbench.robot.cell_model import ON_CRADLE, ON_TURNTABLE, Cell, Shape, Turntable
from workbench.robot.kinematics import Chain, motions
from workbench.units import COVERAGE, DEG, Float, Shaped

if TYPE_CHECKING:
    import fcl
else:
    fcl = Extra("fcl")

LOOKS = 73  # places of an axis at which a pair of bodies is looked at that it alone moves: 5 deg of a full turn
ALIKE_MM = 1.0  # by which a distance may change that is the same: bodies are stated to the mm
TOOL = ("tool", "cutter")  # bodies of the tool
CUTS = frozenset(("cutter", "workpiece"))  # may touch: nothing is left out by that
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
        self.least_mm = least_mm(cell, self.pairs)

    def __repr__(self) -> str:
        """The cell, and how much is looked at."""
        return f"CollisionModel({self._cell.title!r}, {len(self._objects)} bodies, {len(self.pairs)} pairs)"

    def collision(self, joints: Float, turntable: Float | float = 0.0) -> tuple[str, str] | None:
        """The first pair of bodies that are too near at joint angles (6,), rad; None: the posture is free."""
        every = range(len(self.pairs))
        hit = self.first_hit(motions(self._cell.chain, joints), standing_poses(self._cell, turntable), every)
        return None if hit < 0 else self.names(hit)

    def gaps(self, joints: Float, turntable: Float | float = 0.0) -> list[Clearance]:
        """The distance of every pair of bodies that must not touch, at joint angles (6,), rad; the nearest first."""
        self._place(motions(self._cell.chain, joints), standing_poses(self._cell, turntable), range(len(self.pairs)))
        least: dict[tuple[str, str], Clearance] = {}
        for i, (a, b) in enumerate(self.pairs):
            pair = self.names(i)
            touch = _touching(self._objects[a], self._objects[b])
            distance, points = (0.0, None) if touch else self._nearest_points(a, b)
            near = distance <= 0 or distance < self.least_mm[i]
            if pair not in least or (not near, distance) < (not least[pair].near, least[pair].distance_mm):
                least[pair] = Clearance(distance, pair, points, near)
        return sorted(least.values(), key=lambda gap: gap.distance_mm)

    def first_hit(self, moved: Shaped[Float, "7 4 4"], turned: Shaped[Float, "a 4 4"], pairs: Sequence[int]) -> int:
        """The first of some pairs (indices into `pairs`) that is nearer than it must keep apart; -1: none.

        Args:
            moved: (7, 4, 4) motions of base and links.
            turned: (a, 4, 4) poses of the turntable and of what it stands on (`standing_poses`).
            pairs: to be looked at.
        """
        self._place(moved, turned, pairs)
        return next((i for i in pairs if self._near(i)), -1)

    def distances(self, moved: Float, turned: Float, pairs: Sequence[int]) -> list[float]:
        """The distance of some pairs (indices into `pairs`), 0 where they touch; arguments as in `first_hit`."""
        self._place(moved, turned, pairs)
        return [_apart(*(self._objects[s] for s in self.pairs[i])) for i in pairs]

    def names(self, pair: int) -> tuple[str, str]:
        """Of the two bodies of a pair, by its index into `pairs`."""
        a, b = self.pairs[pair]
        return self._cell.shapes[a].body, self._cell.shapes[b].body

    def _near(self, pair: int) -> bool:
        (one, other), least = (self._objects[s] for s in self.pairs[pair]), self.least_mm[pair]
        return _touching(one, other) or bool(least > 0 and _distance(one, other) < least)

    def _nearest_points(self, a: int, b: int) -> tuple[float, Float | None]:
        """The distance, and fcl's two nearest points if they are as far apart."""
        result, request = fcl.DistanceResult(), fcl.DistanceRequest(enable_nearest_points=True)
        distance = max(float(fcl.distance(self._objects[a], self._objects[b], request, result)), 0.0)
        points = np.array(result.nearest_points)
        fits = abs(np.linalg.norm(points[1] - points[0]) - distance) < POINTS_FIT_MM
        return distance, points if fits else None

    def _place(self, moved: Float, turned: Float, pairs: Sequence[int]) -> None:
        """Put the shapes of some pairs where their carriers are."""
        for index in {shape for pair in pairs for shape in self.pairs[pair]}:
            shape = self._cell.shapes[index]
            carrier = turned[shape.link - ON_TURNTABLE] if shape.link >= ON_TURNTABLE else moved[max(shape.link, 0)]
            _put_at(self._objects[index], carrier @ shape.pose)


def turntable_pose(cell: Cell, angle: Float | float) -> Float:
    """`base_from_turntable` (..., 4, 4) at values of the external axes, rad; the base itself where there are none."""
    return np.asarray(standing_poses(cell, angle)[0])


def standing_poses(cell: Cell, angle: Float | float) -> Float:
    """Poses (a, ..., 4, 4) in the base of the external axes at their values, rad: the outermost, what carries it, ...

    One number is the outermost's, with the others at 0.
    """
    axes = cell.axes
    values = np.asarray(angle, float) if np.ndim(angle) else outermost(cell, np.asarray(angle, float))
    each = list(np.moveaxis(values, -1, 0)) if len(axes) > 1 else [values][: len(axes)]
    pose, found, before = np.eye(4), [], np.eye(4)
    for axis, value in zip(axes, each, strict=True):
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
    if not axis.slides:
        return turn_about_z(value)
    moved = np.broadcast_to(np.eye(4), (*value.shape, 4, 4)).copy()
    moved[..., 2, 3] = value / DEG
    return moved


def turn_about_z(angles: Float) -> Float:
    """Poses (..., 4, 4) turned by angles (...) about z."""
    turn = np.zeros((*np.shape(angles), 4, 4))
    turn[..., 0, 0] = turn[..., 1, 1] = np.cos(angles)
    turn[..., 1, 0], turn[..., 0, 1] = np.sin(angles), -np.sin(angles)
    turn[..., 2, 2] = turn[..., 3, 3] = 1.0
    return turn


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
    """Indices of the cell's shapes that must not touch each other: all that any axis moves against each other.

    But for links that are neighbours along the arm, which their joint's limits keep apart, for what `may_touch` names,
    and for an axis' own body where one of it and what carries it is round about the axis, or where they are too near
    at every place of it: there it is borne.
    """
    free, borne = {frozenset(pair) for pair in cell.may_touch}, _borne(cell)
    bodies = [shape.body for shape in cell.shapes]
    return [
        (a, b)
        for a, b in _moving_pairs(cell.shapes, cell.axes)
        if (a, b) not in borne and frozenset((bodies[a], bodies[b])) not in free
    ]


def least_mm(cell: Cell, pairs: Sequence[tuple[int, int]]) -> Float:
    """How far each of some pairs (P,) must keep apart: the clearance, and what tool and part may be off.

    Coverage 2. A rotation of the tool turns its bodies about the flange, one of the part turns what stands there about
    itself.
    """
    margins, flange = cell.margins, cell.chain.base_from_flange_at_zero[:3, 3]
    off = np.zeros(len(cell.shapes))
    for i, shape in enumerate(cell.shapes):
        middle, radius = shape.sphere
        if shape.body in TOOL:
            off[i] = np.hypot(margins.flange_mm, margins.flange_rad * (np.linalg.norm(middle - flange) + radius))
        elif not 0 <= shape.link <= 6:
            off[i] = np.hypot(margins.part_mm, margins.part_rad * radius)
    two = off[np.array(pairs, int).reshape(-1, 2)]
    return np.asarray(cell.margin_mm + COVERAGE * np.hypot(two[:, 0], two[:, 1]))


def left_out(cell: Cell, allowed: Sequence[tuple[str, str]]) -> Iterator[str]:
    """Bodies that could come apart and meet again, or meet elsewhere too, and that nothing looks at.

    Args:
        cell: whose bodies are looked at.
        allowed: pairs of bodies that its file lets touch.
    """
    later = Shape("workpiece", ON_TURNTABLE, "sphere", (1.0,), np.eye(4))  # a scan may become it, of any shape
    shapes, apart = (*cell.shapes, later), set[frozenset[str]]()
    may = {frozenset(pair) for pair in allowed} - {CUTS}
    for a, b in _moving_pairs(shapes, cell.axes):
        names = frozenset((shapes[a].body, shapes[b].body))
        if names in may - apart and (
            "workpiece" in names or not _standing(cell.axes, cell.chain, shapes[a], shapes[b])[1]
        ):
            apart.add(names)
    for one, other in sorted(map(sorted, apart)):
        yield f"collision of {one} and {other}: the cell file lets them touch ($.may_touch)"
    yield from dict.fromkeys(borne_doubtfully(cell).values())


def borne_doubtfully(cell: Cell) -> dict[tuple[int, int], str]:
    """Shapes that count as borne though they may not be, and what is said of them."""
    found = {}
    for (a, b), (gap, alike) in _borne(cell).items():
        names = f"collision of {cell.shapes[a].body} and {cell.shapes[b].body}"
        if not alike:
            found[a, b] = (
                f"{names}: too near wherever their axis stands: one bears the other, and may meet elsewhere too"
            )
        elif ALIKE_MM < gap < least_mm(cell, [(a, b)])[0]:
            found[a, b] = f"{names}: {gap:.1f} mm apart, nearer than bodies must keep"
    return found


def _carrier(shape: Shape, axes: tuple[Turntable, ...]) -> int:
    """What carries a shape, along one line: 0 the base, 1 to 6 the links, -1 the first external axis, -2 the second."""
    return max(shape.link, 0) if shape.link < ON_TURNTABLE else shape.link - ON_TURNTABLE - len(axes)


def _moving_pairs(shapes: tuple[Shape, ...], axes: tuple[Turntable, ...]) -> list[tuple[int, int]]:
    """Indices of shapes that some axis moves against each other, but for the arm's own neighbours."""
    on = [_carrier(shape, axes) for shape in shapes]
    arm = [0 <= shape.link <= 6 and shape.body not in TOOL for shape in shapes]
    pairs = itertools.combinations(range(len(shapes)), 2)
    return [(a, b) for a, b in pairs if on[a] != on[b] and not (arm[a] and arm[b] and abs(on[a] - on[b]) == 1)]


def _borne(cell: Cell) -> dict[tuple[int, int], tuple[float, bool]]:
    """Shapes of an axis' own body and of what carries it that no turn takes apart, or changes: as `_standing` tells."""
    found = dict[tuple[int, int], tuple[float, bool]]()
    own = {**({} if sliding(cell) else {"turntable": ON_TURNTABLE, "tilt": ON_CRADLE}), **dict.fromkeys(TOOL, 6)}
    on = [abs(_carrier(shape, cell.axes)) for shape in cell.shapes]
    owns = [own.get(shape.body) == shape.link for shape in cell.shapes]
    pairs = [(i, j) for i, j in itertools.permutations(range(len(on)), 2) if owns[i] and on[i] - on[j] == 1]
    for (i, j), least in zip(pairs, least_mm(cell, pairs), strict=True):
        gap, alike = _standing(cell.axes, cell.chain, cell.shapes[i], cell.shapes[j], float(least))
        if gap is not None:
            found[min(i, j), max(i, j)] = gap, alike
    return found


@functools.lru_cache(maxsize=1024)
def _standing(
    axes: tuple[Turntable, ...], chain: Chain, one: Shape, other: Shape, least: float | None = None
) -> tuple[float | None, bool]:
    """Two shapes' distance, less than 0 inside, if the one axis between them keeps it below `least`, or alike; whether.

    Alike where one is round about the axis, and where neither distance nor depth changes; of a mesh neither is known
    between the places. Looked at on a whole turn; `least` None: anything, within the axis' limits.
    """
    inner, outer = sorted((one, other), key=lambda shape: abs(_carrier(shape, axes)))
    if (poses := _between(inner, outer, axes, chain, least is not None)) is None:
        return None, False
    here, there = poses
    body, other_body = fcl.CollisionObject(body_of(outer)), fcl.CollisionObject(body_of(inner))
    gaps = (_signed(_put_at(body, b), _put_at(other_body, a)) for a, b in zip(here, there, strict=True))
    if _round(outer, inverse(here) @ there) or _round(inner, inverse(there) @ here):
        return next(gaps), True
    near = list(itertools.takewhile(lambda gap: gap <= 0 or least is None or gap < least, gaps))
    if len(near) < len(here):
        return None, False
    return max(near), "mesh" not in (one.kind, other.kind) and max(near) - min(near) < ALIKE_MM


def _round(shape: Shape, seen: Shaped[Float, "n 4 4"]) -> bool:
    """Whether a shape fills the same space at all of some poses: what is round about the line of its middles."""
    if shape.kind not in ("sphere", "capsule", "cylinder"):
        return False
    reach = 0.0 if shape.kind == "sphere" else shape.sphere[1]
    return all(np.ptp(seen[:, :3, 3] + off * seen[:, :3, 2], axis=0).max() < ALIKE_MM for off in (0.0, reach))


def _between(
    inner: Shape, outer: Shape, axes: tuple[Turntable, ...], chain: Chain, whole: bool
) -> tuple[Float, Float] | None:
    """Poses (n, 4, 4) of two shapes as the axis between them moves the outer, all else at 0; None: there are more."""
    on = _carrier(outer, axes)
    if _carrier(inner, axes) != on - np.sign(on):
        return None
    limits = (-np.pi, np.pi) if whole else chain.limits[on - 1] if on > 0 else axes[-on - 1].limits
    values = np.linspace(limits[0], limits[1], LOOKS)
    if on > 0:
        joints = values[:, None] * (np.arange(1, 7) == on)
        return np.broadcast_to(inner.pose, (len(values), 4, 4)), motions(chain, joints)[:, on] @ outer.pose
    here = np.eye(4) if on == -1 else axes[-on - 2].base_from_turntable
    moved = axes[-on - 1].base_from_turntable @ _moved(axes[-on - 1], values)
    return np.broadcast_to(here @ inner.pose, (len(values), 4, 4)), moved @ outer.pose


def _put_at(body: fcl.CollisionObject, pose: Float) -> fcl.CollisionObject:
    body.setTransform(fcl.Transform(pose[:3, :3], pose[:3, 3]))
    return body


def _touching(one: fcl.CollisionObject, other: fcl.CollisionObject) -> bool:
    return bool(fcl.collide(one, other, fcl.CollisionRequest(), fcl.CollisionResult()))


def _distance(one: fcl.CollisionObject, other: fcl.CollisionObject) -> float:
    """Of bodies that do not touch."""
    return max(float(fcl.distance(one, other, fcl.DistanceRequest())), 0.0)


def _apart(one: fcl.CollisionObject, other: fcl.CollisionObject) -> float:
    """The distance, 0 where they touch."""
    return 0.0 if _touching(one, other) else _distance(one, other)


def _signed(one: fcl.CollisionObject, other: fcl.CollisionObject) -> float:
    """The distance of two bodies, less than 0 by their depth where they touch: fcl keeps the deepest contact."""
    result = fcl.CollisionResult()
    hit = fcl.collide(one, other, fcl.CollisionRequest(enable_contact=True), result)
    return -abs(float(result.contacts[0].penetration_depth)) if hit else _apart(one, other)


@functools.lru_cache(maxsize=64)
def body_of(shape: Shape) -> fcl.CollisionGeometry:
    """fcl's geometry of a shape, about the shape's own frame; a mesh's tree takes long, so it is kept."""
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
