"""Which cells of the traversal's grid the robot can really mill in: one configuration all along, free of collision."""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np

from workbench.api import DEG, Bool, Cell, Chain, CollisionScreen, Float, Int, dexterity, forward_kinematics
from workbench.plugins.stiffness.arm import AnyArm, joint_angles
from workbench.plugins.stiffness.path_points import PathPoints
from workbench.plugins.stiffness.traversal import BRANCHES, flange_poses

MOST_STEP = 15 * DEG  # of a joint between neighbouring points: beyond it the wrist swings through its singularity
FREE, SINGULAR, LIMIT, UNREACHABLE, COLLISION = range(5)
SOLVED, SAMPLED, EVERY_POINT, PROVEN = range(4)
JUDGED = (
    "solved",
    "sampled",
    "every point",
    "proven",
)  # by joint angles alone; at some points; at all; between them too
NEAR_MM, LEVER_MM, MOST_MIDDLES = 12.0, 150.0, 60  # of points that are judged together; what a turn counts
CAUSES = (None, "singular", "limit", "unreachable", "collision")


@dataclass(frozen=True, slots=True)
class Configuration:
    """The branch of the inverse kinematics that is kept all along a path."""

    branch: int  # index into `traversal.BRANCHES`
    flip: int  # of the wrist

    def joints(self, arm: AnyArm, flange: Float) -> Float:
        """Joint angles (n, 6) in (-pi, pi]."""
        shoulder, elbow = BRANCHES[self.branch]
        return joint_angles(arm, flange, shoulder=shoulder, elbow=elbow, flip=self.flip)


@dataclass(frozen=True, slots=True, eq=False)
class Verdicts:
    """What was found out about c cells of the grid."""

    cause: Int  # (c,) index into CAUSES
    hit: Int  # (c,) pair of bodies that collides, or -1
    flip: Int  # (c,) of the wrist, where it is free
    how: Int  # (c,) index into JUDGED


class Examiner:
    """Asks whether a path can be milled with a constant cutter rotation and turntable angle."""

    def __init__(self, cell: Cell, arm: AnyArm, points: PathPoints) -> None:
        """Build once, ask often."""
        self.cell, self.arm, self.points = cell, arm, points
        self.screen = CollisionScreen(cell)

    def examine(self, branch: Int, rotation: Float, table: Float, at: Int) -> Verdicts:
        """Verdicts on cells (c,), judged at the points `at` (p,) of the path; each flip of the wrist is tried."""
        count = len(branch)
        cause, hit, flips = np.full(count, LIMIT), np.full(count, -1), np.zeros(count, int)
        flange = flange_poses(
            self.cell, self.points, np.tile(at, count), np.repeat(rotation, len(at)), np.repeat(table, len(at))
        )
        flange = flange.reshape(count, len(at), 4, 4)
        for flip in (0, 1):
            for which in range(len(BRANCHES)):
                todo = np.flatnonzero((branch == which) & (cause != FREE))
                if not len(todo):
                    continue
                joints = Configuration(which, flip).joints(self.arm, flange[todo].reshape(-1, 4, 4))
                joints, inside = followed(self.cell.chain, joints.reshape(len(todo), len(at), 6))
                poor = self.poor(joints)
                swings = (_swings(joints, np.diff(at) == 1) | (poor == SINGULAR).any(axis=1)) & inside
                inside &= ~(poor == LIMIT).any(axis=1)
                inside &= ~swings
                hits = np.full(len(todo), -1)
                hits[inside] = self._hits(joints[inside], table[todo[inside]])
                found = np.where(inside, np.where(hits >= 0, COLLISION, FREE), LIMIT)
                found[swings] = SINGULAR
                better = (found == FREE) | (found == COLLISION) | ((found == SINGULAR) & (cause[todo] == LIMIT))
                cause[todo[better]], hit[todo[better]], flips[todo[better]] = found[better], hits[better], flip
        hit[cause == FREE] = -1
        return Verdicts(cause, hit, flips, np.full(count, SAMPLED))

    def spread(self, count: int) -> Int:
        """At most `count` points of the path, in their order, that lie as far from each other as they can."""
        return np.sort(self._farthest[1][:count])

    @functools.cached_property
    def _farthest(self) -> tuple[Float, Int]:
        """Where the points lie (n, 12), turns in mm; and points of the path, each the farthest from those before."""
        poses = self.points.base_from_point
        there = np.hstack([poses[:, :3, 3], LEVER_MM * poses[:, :3, :3].reshape(-1, 9)])
        chosen, away = [0], np.linalg.norm(there - there[0], axis=1)
        while away.max() > NEAR_MM and len(chosen) < MOST_MIDDLES:
            chosen.append(int(away.argmax()))
            away = np.minimum(away, np.linalg.norm(there - there[chosen[-1]], axis=1))
        return there, np.array(chosen)

    @functools.cached_property
    def _middles(self) -> tuple[Int, float, float]:
        """Points of the path (k,) near which all its points lie, and how near: mm and rad."""
        poses, (there, chosen) = self.points.base_from_point, self._farthest
        nearest = np.argmin(np.linalg.norm(there[:, None] - there[chosen], axis=2), axis=1)
        middle = poses[chosen[nearest]]
        far = np.linalg.norm(poses[:, :3, 3] - middle[:, :3, 3], axis=1).max()
        cosine = (np.einsum("nij,nij->n", poses[:, :3, :3], middle[:, :3, :3]) - 1) / 2
        turn = float(np.arccos(np.clip(cosine, -1, 1)).max())
        reach = self.points.point_from_tip[:3, 3]
        return chosen, float(far + turn * np.linalg.norm(reach)), turn

    def confirm(self, branch: Int, flip: Int, rotation: Float, table: Float) -> Verdicts:
        """Verdicts on cells (c,) that are free where they were sampled: all points of the path, and what lies between.

        All points lie near some middle points. Where the bodies cannot meet for anything that the joints may do within
        that nearness, the cell is proven; else it is judged at every point.
        """
        at, far_mm, turn = self._middles
        count = len(branch)
        cause, hit, how = np.full(count, FREE), np.full(count, -1), np.full(count, PROVEN)
        flange = flange_poses(
            self.cell, self.points, np.tile(at, count), np.repeat(rotation, len(at)), np.repeat(table, len(at))
        ).reshape(count, len(at), 4, 4)
        joints = np.empty((count, len(at), 6))
        for which, wrist in {(int(b), int(f)) for b, f in zip(branch, flip, strict=True)}:
            some = (branch == which) & (flip == wrist)
            found = Configuration(which, wrist).joints(self.arm, flange[some].reshape(-1, 4, 4))
            joints[some] = found.reshape(-1, len(at), 6)
        flat = joints.reshape(-1, 6)
        tip = (flange.reshape(-1, 4, 4) @ self.cell.flange_from_cutter)[:, :3, 3]
        proven = self.screen.proven(flat, np.repeat(table, len(at)), tip, far_mm, turn).reshape(count, -1).all(axis=1)
        for i in np.flatnonzero(~proven).tolist():
            n = len(self.points.layer)
            _, cause[i], hit[i] = self.along(
                Configuration(int(branch[i]), int(flip[i])), np.full(n, rotation[i]), np.full(n, table[i])
            )
            how[i] = EVERY_POINT
        return Verdicts(cause, hit, flip, how)

    def along(self, configuration: Configuration, rotation: Float, table: Float) -> tuple[Float, int, int]:
        """Joint angles (n, 6) at all points for rotations and turntable angles (n,), the cause against it, the hit."""
        flange = flange_poses(self.cell, self.points, np.arange(len(rotation)), rotation, table)
        joints, inside = followed(self.cell.chain, configuration.joints(self.arm, flange)[None])
        if not inside[0]:
            return joints[0], LIMIT, -1
        poor = self.poor(joints)[0]
        if _swings(joints, np.ones(len(rotation) - 1, bool))[0] or (poor == SINGULAR).any():
            return joints[0], SINGULAR, -1
        if (poor == LIMIT).any():
            return joints[0], LIMIT, -1
        hits = self.screen.hits(joints[0], table)
        return joints[0], COLLISION if hits.max() >= 0 else FREE, int(hits.max())

    def poor(self, joints: Float) -> Int:
        """What the margins have against each posture (..., 6): SINGULAR, LIMIT, or FREE; limits are looked at before.

        LIMIT: the joints that stand within their limits could be asked to leave them by what tool and part are off.
        """
        margins, chain, flat = self.cell.margins, self.cell.chain, joints.reshape(-1, 6)
        tip = (forward_kinematics(chain, flat) @ self.cell.flange_from_cutter)[:, :3, 3]
        wrist, condition, asked = dexterity(chain, flat, tip, margins.twist, margins.condition)
        room = np.minimum(flat - chain.limits[:, 0], chain.limits[:, 1] - flat)
        said = np.where((asked > 0).any(axis=1) & (room < asked).any(axis=1), LIMIT, FREE)
        said[(wrist < margins.wrist) | (condition > margins.condition)] = SINGULAR
        return np.asarray(said.reshape(joints.shape[:-1]))

    def _hits(self, joints: Float, table: Float) -> Int:
        """The first hit of each path (c, p, 6), or -1; points one after the other, so that a hit spares the rest."""
        found = np.full(len(joints), -1)
        for at in order(joints.shape[1]):
            open_ = np.flatnonzero(found < 0)
            found[open_] = self.screen.hits(joints[open_, at], table[open_])
        return found


def _swings(joints: Float, neighbours: Bool) -> Bool:
    """Whether a joint moves too far between neighbouring points, on each path (c, p, 6)."""
    steps = np.abs(np.diff(joints, axis=1)).max(axis=2, initial=0.0)
    return np.asarray((steps[:, neighbours] > MOST_STEP).any(axis=1))


def order(count: int) -> list[int]:
    """Ends first, then the middle: where a path collides, it mostly does so there."""
    return sorted(range(count), key=lambda i: min(i, count - 1 - i))


def followed(chain: Chain, joints: Float) -> tuple[Float, Bool]:
    """Joint angles (c, p, 6) along paths without jumps of a turn, and whether they lie within limits (c,)."""
    turn, (low, high) = 2 * np.pi, chain.limits.T
    q = np.unwrap(joints, axis=1)
    least = np.ceil((low - 1e-9 - q.min(axis=1)) / turn)
    most = np.floor((high + 1e-9 - q.max(axis=1)) / turn)
    shift = np.clip(np.round(-q.mean(axis=1) / turn), least, most)
    return q + turn * shift[:, None], (least <= most).all(axis=1)
