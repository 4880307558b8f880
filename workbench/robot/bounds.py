"""Collision of very many postures: a lower bound of the clearance; what it calls free is free, fcl decides the rest.

Every shape is put into a capsule, and where it does not hang on the robot into a box besides: exact for capsules,
spheres, boxes, and cylinders beside capsules; wider for meshes, and for one of two cylinders or boxes. Bounding volumes
that keep apart prove that the shapes do.

The bodies of a cell may move against each other while its joints stay within a reach of where they are: a point of a
body moves by at most its distance from each axis times that joint's reach; the distances themselves change by no more
than the point moves, hence the division (Schwarzer, Saha, Latombe, IEEE Trans. Robotics 21 (2005) 338).
"""

from __future__ import annotations

import itertools

import numpy as np

from workbench.geometry.blocks import in_order
from workbench.geometry.poses import inverse, mapped
from workbench.robot.bound_kernels import (
    BOX,
    CYLINDER,
    NONE,
    BoundingVolumes,
    bound_kernel,
    pairs_kernel,
    swept_kernel,
)
from workbench.robot.cell_model import ON_TURNTABLE, Cell, Shape
from workbench.robot.collision import LOOKS, CollisionModel, checked_pairs, standing_poses
from workbench.robot.kinematics import joint_axes, motions
from workbench.units import DEG, Bool, Float, Int, Shaped

SAFE_MM = 1e-3  # a posture counts as free only beyond this, so that rounding decides nothing
WAYS_A_BLOCK = 8  # some 20 ms
FREE = -1
FAR_MM = 1e9  # farther apart than anything


def bounding_volumes(cell: Cell) -> BoundingVolumes:
    """The cell's shapes in volumes whose distances are quick."""
    made = [_volume(shape) for shape in cell.shapes]
    count = len(made)  # 0: nothing is known of any body
    ends, radius = np.array([one for one, _ in made]).reshape(count, 2, 3), np.array([one for _, one in made])
    solid = np.array([_solid(shape) for shape in cell.shapes], np.int64)
    boxes = [shape.box for shape in cell.shapes]
    half = np.array([one for _, one in boxes]).reshape(count, 3)
    around = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1) / 2 + radius
    return BoundingVolumes(
        axes=cell.chain.axes,
        points_mm=cell.chain.points_mm,
        frames=_frames(cell),
        slides=np.array([axis.slides for axis in cell.axes] or [False]),
        link=np.array([max(shape.link, 0) for shape in cell.shapes], np.int64),
        solid=solid,
        ends_mm=ends,
        radius_mm=radius,
        pose=np.array([pose for pose, _ in boxes]).reshape(count, 4, 4),
        half_mm=half,
        around_mm=np.where(solid == BOX, np.linalg.norm(half, axis=1), around),
        pairs=np.array(checked_pairs(cell), np.int64).reshape(-1, 2),
    )


def _frames(cell: Cell) -> Float:
    """Of each external axis at 0 in what carries it (e, 4, 4); one, the base, where there is none."""
    poses = [np.eye(4), *(axis.base_from_turntable for axis in cell.axes)]
    return np.array([inverse(a) @ b for a, b in itertools.pairwise(poses)] or [np.eye(4)])


def with_externals(cell: Cell, joints: Float, turntable: Float | float) -> Float:
    """Joint angles (n, 6) and, behind them, values of the external axes (n,) or (n, e): (n, 6 + e)."""
    shape = (len(joints), len(cell.axes)) if len(cell.axes) > 1 else (len(joints),)
    return np.ascontiguousarray(np.column_stack([joints, np.broadcast_to(np.asarray(turntable, float), shape)]))


def _volume(shape: Shape) -> tuple[Float, float]:
    """Ends of a capsule's axis, and its radius."""
    pose, half = shape.box
    if shape.kind in ("capsule", "cylinder", "sphere"):
        radius = shape.size_mm[0]
        axis = np.array([0.0, 0.0, half[2] - (0.0 if shape.kind == "cylinder" else radius)])
    else:
        longest = int(half.argmax())
        axis = half * (np.arange(3) == longest)
        radius = float(np.linalg.norm(np.delete(half, longest)))
    return np.array([mapped(pose, s * axis) for s in (-1, 1)]), radius


def _solid(shape: Shape) -> int:
    flat = shape.kind in ("box", "mesh") and not 1 <= shape.link <= 6
    return CYLINDER if shape.kind == "cylinder" else BOX if flat else NONE


assert ON_TURNTABLE == 7  # the kernel's eighth motion; behind it what carries that


class CollisionScreen:
    """A cell's bodies, ready to be asked about many postures; the answers are `CollisionModel`'s.

    And which axes move the bodies of each pair against each other, and how far they must keep apart.
    """

    def __init__(self, cell: Cell) -> None:
        """Build once, ask often."""
        self.cell, self.model, self.volumes = cell, CollisionModel(cell), bounding_volumes(cell)
        pairs = np.array(self.model.pairs, int).reshape(-1, 2)
        link = np.array([max(shape.link, 0) for shape in cell.shapes] or [0])[pairs]
        arm = np.where(link >= ON_TURNTABLE, 0, link)
        low, high = arm.min(axis=1), arm.max(axis=1)
        self.outer = np.take_along_axis(pairs, arm.argmax(axis=1)[:, None], axis=1)[:, 0]
        self.joints = (np.arange(1, 7) > low[:, None]) & (np.arange(1, 7) <= high[:, None])  # (P, 6)
        # Many pairs come nearer by the same motion: that of one volume by the same joints.
        motions, self.by = np.unique(np.column_stack([self.outer, self.joints]), axis=0, return_inverse=True)
        self.carried, self.moves = motions[:, 0].astype(np.int64), motions[:, 1:].astype(bool)
        carriers = ON_TURNTABLE + np.arange(len(cell.axes))[::-1]  # from the base outwards
        carried = (link[:, :, None] >= ON_TURNTABLE) & (link[:, :, None] <= carriers)
        self.external = carried[:, 0] != carried[:, 1]  # (P, e) axes that move the two against each other
        self.least_mm = self.model.least_mm

    def __repr__(self) -> str:
        """What it asks."""
        return f"CollisionScreen({self.model!r})"

    def bound_mm(self, joints: Float, turntable: Float | float = 0.0, most_mm: float = FAR_MM) -> Float:
        """A distance (n,) that no pair of bodies falls below, at joint angles (n, 6) and external axes (n,), rad.

        Free without further look: more than SAFE_MM and what any pair must keep apart. Negative or small: ask
        `CollisionModel`. What is farther apart than `most_mm` need not be known, and takes less time.
        """
        q = with_externals(self.cell, np.asarray(joints, float).reshape(-1, 6), turntable)
        return np.asarray(bound_kernel(self.volumes, q, most_mm))

    def pair_bounds_mm(self, joints: Float, turntable: Float, most_mm: Float | None = None) -> tuple[Float, Float]:
        """A distance (n, P) that no pair falls below, and the volumes' middles (n, S, 3) in the base, at (n, 6), (n,).

        What is farther apart than `most_mm` (P,) need not be known, and takes less time.
        """
        most = np.full(len(self.volumes.pairs), FAR_MM) if most_mm is None else most_mm
        found, middles = pairs_kernel(self.volumes, with_externals(self.cell, joints, turntable), most)
        return np.asarray(found), np.asarray(middles)

    def moved_mm(self, joints: Float, turntable: Float, reach: Float, middles: Float) -> Float:
        """By how much each pair (n, P) may come nearer within reaches (n, 6 + e) of joints and external axes."""
        axes, points = joint_axes(self.cell.chain, joints)
        arm = middles[:, None, :, :] - points[:, :, None, :]  # (n, 6, S, 3)
        radius = np.linalg.norm(np.cross(axes[:, :, None, :], arm), axis=-1) + self.volumes.around_mm
        way = np.einsum("nip,pi,ni->np", radius[:, :, self.outer], self.joints.astype(float), reach[:, :6])
        external_mm, link = np.zeros_like(middles[..., 0]), self.volumes.link
        slack = 1 - reach.sum(axis=1, keepdims=True)
        for k, (axis, pose) in enumerate(zip(self.cell.axes[::-1], standing_poses(self.cell, turntable), strict=False)):
            by = reach[:, -1 - k, None]
            if axis.slides:
                lever = np.full_like(external_mm, 1 / DEG)
                slack += by  # what slides changes no lever
            else:
                arm = middles - pose[:, None, :3, 3]
                lever = np.linalg.norm(np.cross(arm, pose[:, None, :3, 2]), axis=-1) + self.volumes.around_mm
            external_mm += np.where((link >= ON_TURNTABLE) & (link <= ON_TURNTABLE + k), lever * by, 0.0)
        way += external_mm[:, self.volumes.pairs].sum(axis=2)
        return np.asarray(np.where(slack > 0, way / np.maximum(slack, 1e-9), np.inf))

    def swept(self, joints: Shaped[Float, "c s 6"], table: Shaped[Float, "c s ..."]) -> Bool:
        """Which places (c, s) of c ways of the joints are not proven free of collision with what lies around them.

        A stretch of a way is proven when every pair of bodies is farther apart in its middle than it must be, and what
        the joints may move it by on the whole stretch; else it is halved, down to half a step either side of a place.

        Args:
            joints: (c, s, 6) rad, s places one after the other, so near that a parabola through three tells the way.
            table: (c, s) rad, likewise.
        """
        externals = table if table.ndim > 2 else table[..., None]
        ways = np.ascontiguousarray(np.concatenate([joints, externals], axis=2), float)
        bodies, least = self.volumes, self.least_mm

        def some(first: int, last: int) -> Bool:
            chosen = slice(first, last)
            return np.asarray(swept_kernel(bodies, ways[chosen], self.carried, self.moves, self.by, least))

        return np.concatenate([np.zeros((0, ways.shape[1]), bool), *in_order(some, len(ways), WAYS_A_BLOCK)])

    def hits(self, joints: Float, turntable: Float) -> Int:
        """Index into `pairs` of a pair that is too near, or FREE (n,), at (n, 6) and (n,), rad."""
        found = np.full(len(joints), FREE)
        need = float(self.least_mm.max(initial=0.0)) + SAFE_MM
        open_ = np.flatnonzero(~(self.bound_mm(joints, turntable, need + SAFE_MM) > need))
        if not len(open_):
            return found
        most = self.least_mm + SAFE_MM
        near = self.pair_bounds_mm(joints[open_], turntable[open_], most + SAFE_MM)[0] <= most
        moved = motions(self.cell.chain, joints[open_])
        tables = standing_poses(self.cell, turntable[open_])
        for i, n in enumerate(open_.tolist()):
            found[n] = self.model.first_hit(moved[i], tables[:, i], np.flatnonzero(near[i]).tolist())
        return found

    def clearances_mm(self, joints: Float, turntable: Float) -> Float:
        """The smallest distance (n,) of bodies that must not touch, 0 where they do, at (n, 6) and (n,), rad.

        NaN: nothing can touch.
        """
        if not self.model.pairs:
            return np.full(len(joints), np.nan)
        bounds, _ = self.pair_bounds_mm(joints, turntable)
        moved, tables = motions(self.cell.chain, joints), standing_poses(self.cell, turntable)
        each = (slice(n, n + 1) for n in range(len(joints)))
        return np.array([self._least(bounds[n], moved[n], tables[:, n])[0] for n in each])

    def tightest(self, joints: Float, turntable: Float) -> tuple[float, int, int] | None:
        """The smallest distance of all postures (n, 6), (n,), its pair and its posture; None: nothing can touch."""
        if not self.model.pairs or not len(joints):
            return None
        bounds, _ = self.pair_bounds_mm(joints, turntable)
        least, n, pair = self._least(bounds, motions(self.cell.chain, joints), standing_poses(self.cell, turntable))
        return least, pair, n

    def _least(self, bounds: Float, moved: Float, tables: Float) -> tuple[float, int, int]:
        """The smallest distance of n postures, by their bounds (n, P), its posture and its pair.

        fcl is asked in the order of the bounds, until no other can be nearer.
        """
        best, at = np.inf, 0
        for one in np.argsort(bounds, axis=None).tolist():
            if bounds.flat[one] > best + SAFE_MM:
                break
            n, pair = divmod(one, bounds.shape[1])
            (distance,) = self.model.distances(moved[n], tables[:, n], [pair])
            if distance < best:
                best, at = distance, one
        return best, *divmod(at, bounds.shape[1])

    def always_near(self) -> tuple[str, str] | None:
        """Two bodies that are too near in every posture: one axis at most moves them, and nowhere far enough apart."""
        cell = self.cell
        limits = np.vstack([cell.chain.limits, *(axis.limits for axis in cell.axes)])
        by = np.column_stack([self.joints, self.external])
        for pair in np.flatnonzero(by.sum(axis=1) <= 1).tolist():
            axis = int(by[pair].argmax())  # 0 where none moves them: any does
            seven = np.zeros((LOOKS, len(limits)))
            seven[:, axis] = np.linspace(limits[axis, 0], limits[axis, 1], LOOKS)
            moved = motions(cell.chain, seven[:, :6])
            tables = standing_poses(cell, seven[:, 6:] if len(cell.axes) > 1 else seven[:, 6:].sum(axis=1))
            if all(self.model.first_hit(links, tables[:, i], [pair]) >= 0 for i, links in enumerate(moved)):
                return self.pair(pair)
        return None

    def pair(self, hit: int) -> tuple[str, str]:
        """Names of the bodies of a hit."""
        return self.model.names(hit)

    def which(self, pair: tuple[str, str] | None) -> int:
        """A hit of two bodies by their names; FREE: there is none."""
        return next((i for i in range(len(self.model.pairs)) if self.model.names(i) == pair), FREE)
