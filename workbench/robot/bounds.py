"""Collision of very many postures: a lower bound of the clearance; what it calls free is free, fcl decides the rest.

Every shape is put into a capsule, and where it does not hang on the robot into a box besides: exact for capsules,
spheres, boxes, and cylinders beside capsules; wider for meshes, and for one of two cylinders or boxes. Bounding volumes
that keep apart prove that the shapes do.

The bodies of a cell may move against each other while its joints stay within a reach of where they are: a point of a
body moves by at most its distance from each axis times that joint's reach; the distances themselves change by no more
than the point moves, hence the division (Schwarzer, Saha, Latombe, IEEE Trans. Robotics 21 (2005) 338).
"""

from __future__ import annotations

import numpy as np

from workbench.geometry.blocks import in_order
from workbench.robot.bound_kernels import BOX, CYLINDER, NONE, BoundingVolumes, Standing, pairs_kernel, placed_kernel
from workbench.robot.cell import ON_TURNTABLE, Cell, Shape
from workbench.robot.collision import LOOKS, CollisionModel, checked_pairs, standing_poses
from workbench.robot.kinematics import joint_axes, motions
from workbench.units import DEG, Bool, Float, Int, Shaped

SAFE_MM = 1e-3  # a posture counts as free only beyond this, so that rounding decides nothing
MOST_SWEPT = 0.6  # rad, of all joints together: beyond it the levers change too much for a bound to be of use
FREE = -1
FAR_MM = 1e9  # farther apart than anything
A_BLOCK = 2048  # postures


def bounding_volumes(cell: Cell) -> BoundingVolumes:
    """The cell's shapes in volumes whose distances are quick."""
    made = [_volume(shape) for shape in cell.shapes]
    count = len(made)  # 0: nothing is known of any body
    ends = np.array([one for one, _, _ in made]).reshape(count, 2, 3)
    radius, half = np.array([one for _, one, _ in made]), np.array([one for _, _, one in made]).reshape(count, 3)
    solid = np.array([_solid(shape) for shape in cell.shapes], np.int64)
    around = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1) / 2 + radius
    return BoundingVolumes(
        link=np.array([max(shape.link, 0) for shape in cell.shapes], np.int64),
        solid=solid,
        ends_mm=ends,
        radius_mm=radius,
        pose=np.array([_centred(shape) for shape in cell.shapes]).reshape(count, 4, 4),
        half_mm=half,
        around_mm=np.where(solid == BOX, np.linalg.norm(half, axis=1), around),
        pairs=np.array(checked_pairs(cell), np.int64).reshape(-1, 2),
    )


def _volume(shape: Shape) -> tuple[Float, float, Float]:
    """Ends of a capsule's axis and its radius, half lengths of the box."""
    half = _half_lengths(shape)
    if shape.kind in ("capsule", "cylinder", "sphere"):
        radius = shape.size_mm[0]
        length = shape.size_mm[1] / 2 if len(shape.size_mm) > 1 else 0.0
        axis = np.array([0.0, 0.0, length])
    else:
        longest = int(np.argmax(half))
        axis = half * (np.arange(3) == longest)
        radius = float(np.linalg.norm(np.delete(half, longest)))
    pose = _centred(shape)
    return np.array([pose[:3, :3] @ (s * axis) + pose[:3, 3] for s in (-1, 1)]), radius, half


def _solid(shape: Shape) -> int:
    flat = shape.kind in ("box", "mesh") and not 1 <= shape.link <= 6
    return CYLINDER if shape.kind == "cylinder" else BOX if flat else NONE


def _half_lengths(shape: Shape) -> Float:
    if shape.vertices_mm is not None:
        return np.asarray(np.ptp(shape.vertices_mm, axis=0) / 2)
    if shape.kind == "cylinder":
        radius, length = shape.size_mm
        return np.array([radius, radius, length / 2])
    return np.array(shape.size_mm) / 2 if shape.kind == "box" else np.zeros(3)


def _centred(shape: Shape) -> Float:
    """The shape's pose, for a mesh moved to the middle of the box around it."""
    if shape.vertices_mm is None:
        return shape.pose
    middle = np.eye(4)
    middle[:3, 3] = (shape.vertices_mm.min(axis=0) + shape.vertices_mm.max(axis=0)) / 2
    return np.asarray(shape.pose @ middle)


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
        carriers = ON_TURNTABLE + np.arange(len(cell.axes))[::-1]  # from the base outwards
        carried = (link[:, :, None] >= ON_TURNTABLE) & (link[:, :, None] <= carriers)
        self.external = carried[:, 0] != carried[:, 1]  # (P, e) axes that move the two against each other
        self.least_mm = self.model.least_mm

    def __repr__(self) -> str:
        """What it asks."""
        return f"CollisionScreen({self.model!r})"

    def pair_bounds_mm(self, joints: Float, turntable: Float, most_mm: Float | None = None) -> tuple[Float, Float]:
        """A distance (n, P) that no pair falls below, and the volumes' middles (n, S, 3) in the base, at (n, 6), (n,).

        What is farther apart than `most_mm`, (P,) or (n, P), need not be known, and takes less time.
        """
        most = np.empty((len(joints), len(self.least_mm)))
        most[:] = FAR_MM if most_mm is None else most_mm

        def some(first: int, last: int) -> tuple[Float, Float]:
            standing = self._standing(joints[first:last], turntable[first:last])
            return pairs_kernel(self.volumes, standing, most[first:last]), standing.middle

        blocks = list(in_order(some, len(joints), A_BLOCK)) or [some(0, 0)]
        found, middles = (np.concatenate(part) for part in zip(*blocks, strict=True))
        return found, middles

    def _standing(self, joints: Float, turntable: Float) -> Standing:
        """The volumes where joint angles (n, 6) and external axes, (n,) or (n, e), carry them."""
        external = np.moveaxis(standing_poses(self.cell, turntable), 0, 1)
        return placed_kernel(self.volumes, np.concatenate([motions(self.cell.chain, joints), external], axis=1))

    def moved_mm(self, joints: Float, turntable: Float, reach: Float, middles: Float) -> Float:
        """By how much each pair (n, P) may come nearer within reaches (n, 6 + e) of joints and external axes."""
        axes, points = joint_axes(self.cell.chain, joints)
        arm = middles[:, None, :, :] - points[:, :, None, :]  # (n, 6, S, 3)
        radius = np.linalg.norm(np.cross(axes[:, :, None, :], arm), axis=-1) + self.volumes.around_mm
        way = np.einsum("nip,pi,ni->np", radius[:, :, self.outer], self.joints.astype(float), reach[:, :6])
        beside, link = np.zeros_like(middles[..., 0]), self.volumes.link
        slack = 1 - reach.sum(axis=1, keepdims=True)
        for k, (axis, pose) in enumerate(zip(self.cell.axes[::-1], standing_poses(self.cell, turntable), strict=False)):
            by = reach[:, -1 - k, None]
            if axis.slides:
                lever = np.full_like(beside, 1 / DEG)
                slack += by  # what slides changes no lever
            else:
                arm = middles - pose[:, None, :3, 3]
                lever = np.linalg.norm(np.cross(arm, pose[:, None, :3, 2]), axis=-1) + self.volumes.around_mm
            beside += np.where((link >= ON_TURNTABLE) & (link <= ON_TURNTABLE + k), lever * by, 0.0)
        way += beside[:, self.volumes.pairs].sum(axis=2)
        return np.asarray(np.where(slack > 0, way / np.maximum(slack, 1e-9), np.inf))

    def swept(self, joints: Shaped[Float, "c s 6"], table: Shaped[Float, "c s ..."]) -> Bool:
        """Which places (c, s) of c ways of the joints are not proven free of collision with what lies around them.

        A stretch of a way is proven when every pair of bodies is farther apart in its middle than it must be, and what
        the joints may move it by on the whole stretch; else it is halved, down to half a step either side of a place.

        Args:
            joints: (c, s, 6) rad, s places one after the other, so near that a parabola through three tells the way.
            table: (c, s) rad, likewise.
        """
        ways = np.concatenate([joints, table if table.ndim > 2 else table[..., None]], axis=2)
        step, open_, way = _half_steps(ways), np.zeros(ways.shape[:2], bool), np.arange(len(ways))
        first, last = np.zeros_like(way), np.full_like(way, ways.shape[1] - 1)
        asked = np.ones((len(ways), len(self.least_mm)), bool)
        while len(way):
            middle = (first + last) // 2
            proven = ~asked | self._apart(ways[way, middle], _reach(ways, step, way, first, last), asked)
            # A pair that is proven on a stretch is on its halves: these ask from the first one on that was not.
            asked &= ~np.logical_and.accumulate(proven, axis=1)
            left = asked.any(axis=1)
            open_[way, first] |= left & (first == last)
            halved = np.flatnonzero(left & (first < last))
            way, asked = np.tile(way[halved], 2), np.tile(asked[halved], (2, 1))
            first, last = np.append(first[halved], middle[halved] + 1), np.append(middle[halved], last[halved])
        return open_

    def _apart(self, q: Float, reach: Float, asked: Bool) -> Bool:
        """Whether pairs `asked` (n, P) stay apart within reaches (n, 6 + e) of places `q` (n, 6 + e)."""
        found = np.zeros(asked.shape, bool)
        slides = [k for k, axis in enumerate(self.cell.axes, 6) if axis.slides]  # which change no lever
        some = np.flatnonzero(reach.sum(axis=1) - reach[:, slides].sum(axis=1) < MOST_SWEPT)
        joints, external = q[some, :6], q[some, 6:] if len(self.cell.axes) > 1 else q[some, 6]
        bodies, pairs = self.volumes, np.flatnonzero(asked[some].any(axis=0))
        standing = self._standing(joints, external)
        need = (self.moved_mm(joints, external, reach[some], standing.middle) + self.least_mm)[:, pairs]
        most = np.where(asked[np.ix_(some, pairs)], need + SAFE_MM, 0.0)
        found[np.ix_(some, pairs)] = pairs_kernel(bodies._replace(pairs=bodies.pairs[pairs]), standing, most) > need
        return found

    def hits(self, joints: Float, turntable: Float) -> Int:
        """Index into `pairs` of a pair that is too near, or FREE (n,), at (n, 6) and (n,), rad."""
        found = np.full(len(joints), FREE)
        most = self.least_mm + SAFE_MM
        near = self.pair_bounds_mm(joints, turntable, most + SAFE_MM)[0] <= most
        open_ = np.flatnonzero(near.any(axis=1))
        near = near[open_]
        moved = motions(self.cell.chain, joints[open_])
        tables = standing_poses(self.cell, turntable[open_])
        for i, n in enumerate(open_.tolist()):
            found[n] = self.model.first_hit(moved[i], tables[:, i], np.flatnonzero(near[i]).tolist())
        return found

    def clearances_mm(self, joints: Float, turntable: Float) -> Float:
        """The smallest distance (n,) of bodies that must not touch, 0 where they do, at (n, 6) and (n,), rad.

        fcl is asked about the pairs in the order of their bounds, until no other can be nearer. NaN: nothing can touch.
        """
        if not self.model.pairs:
            return np.full(len(joints), np.nan)
        bounds, _ = self.pair_bounds_mm(joints, turntable)
        moved, out = motions(self.cell.chain, joints), np.full(len(joints), np.inf)
        tables = standing_poses(self.cell, turntable)
        for n in range(len(joints)):
            for pair in np.argsort(bounds[n]).tolist():
                if bounds[n, pair] > out[n] + SAFE_MM:
                    break
                out[n] = min(out[n], *self.model.distances(moved[n], tables[:, n], [pair]))
        return out

    def tightest(self, joints: Float, turntable: Float) -> tuple[float, int, int] | None:
        """The smallest distance of all postures (n, 6), (n,), its pair and its posture; None: nothing can touch.

        fcl is asked in the order of the bounds, until no other can be nearer.
        """
        if not self.model.pairs or not len(joints):
            return None
        bounds, _ = self.pair_bounds_mm(joints, turntable)
        moved, count = motions(self.cell.chain, joints), len(self.model.pairs)
        tables = standing_poses(self.cell, turntable)
        best, at = np.inf, (FREE, FREE)
        for one in np.argsort(bounds, axis=None).tolist():
            if bounds.flat[one] > best + SAFE_MM:
                break
            n, pair = divmod(one, count)
            (distance,) = self.model.distances(moved[n], tables[:, n], [pair])
            if distance < best:
                best, at = distance, (pair, n)
        return best, *at

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
        return self.model.names(*self.model.pairs[hit])

    def which(self, pair: tuple[str, str] | None) -> int:
        """A hit of two bodies by their names; FREE: there is none."""
        names = (self.model.names(*two) for two in self.model.pairs)
        return next((i for i, one in enumerate(names) if one == pair), FREE)


def _half_steps(ways: Float) -> Float:
    """How far axes go (c, s, 6 + e) from each place halfway to its neighbours, with what they bulge out in between.

    A parabola through three places lies off their chords by an eighth of the second difference; a quarter is taken.
    """
    apart = np.pad(np.abs(np.diff(ways, axis=1)), ((0, 0), (1, 1), (0, 0)))
    bulge = np.pad(np.abs(np.diff(ways, 2, axis=1)), ((0, 0), (2, 2), (0, 0)))
    widest = np.maximum(np.maximum(bulge[:, :-2], bulge[:, 1:-1]), bulge[:, 2:])
    return np.asarray(np.maximum(apart[:, :-1], apart[:, 1:]) / 2 + widest / 4)


def _reach(ways: Float, step: Float, way: Int, first: Int, last: Int) -> Float:
    """How far axes go (n, 6 + e) from the middle place of stretches to half a step before and behind them."""
    count = last - first + 1
    row, begin = np.repeat(np.arange(len(way)), count), np.cumsum(count) - count
    place = np.arange(len(row)) - begin[row] + first[row]
    off = np.abs(ways[way[row], place] - ways[way, (first + last) // 2][row]) + step[way[row], place]
    return np.asarray(np.maximum.reduceat(off, begin))
