"""Inverse kinematics, all branches over any number of poses.

In closed form for a robot with a spherical wrist: its centre depends on the first three joints only. They are solved
first, then the wrist's turn that is left.

Numerically for arms whose wrist is offset along axis 5 (UR, CRX). Axis 4 meets axis 5 in one point, axis 6 meets it in
another. For a given angle of joint 6 the second point and the direction of axis 5 are known, so the first point is, and
joints 1 to 3 bring it there in up to four ways, in closed form. Each way holds where axes 4 and 5 have the angle to
each other that they have: one equation in one unknown on the circle, whose sign changes are bracketed on a grid, its
double roots by its extremes, and its ends where the arm is stretched; ways that live between two places of the grid
alone, by the extremes of how far they are from ending. (1D searches of this kind: Elias and Wen 2022.) Newton's steps
on all six joints take away what is left.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from workbench.errors import InputError
from workbench.kernels import kernel
from workbench.robot.kinematics import Chain, forward_kinematics, jacobian
from workbench.robot.wrist import (
    OffsetWrist,
    SphericalWrist,
    angle_about,
    general_position,
    offset_wrist,
    parallel_position,
    rotation_about,
    spherical_wrist,
    wrapped,
)
from workbench.units import AnyArray, Bool, Float, Int, Shaped

BRANCHES = 8  # two for each of the up to four places of the first three joints
SINGULAR = 1e-13  # sine below which an angle is free and set to 0
MOST = 16  # solutions of any six revolute joints (Primrose 1986)
STEPS = 180  # of the grid on joint 6
FINER = 8  # parts of a step that is looked at again
STEEP = 61  # places on a piece in which joints 1 or 2 turn at once, evenly by how far they turn
HALVINGS = 24  # of a bracket: 2e-9 rad or less are left for Newton
GOLDEN = 0.6180339887498949
BENT, NEAR = 0.03, 0.05  # second differences of the error from step to step, and extremes, that are looked at again
SAME = 1e-6  # rad: nearer than this, two solutions are one
REACHED = 1e-9  # m and 1: what may be missing of a pose
Brackets = tuple[Float, Float, Int, Int]  # lower and upper angle, pose, way: (m,) each


def inverse_kinematics(chain: Chain, base_from_flange: Float) -> Float:
    """Joint angles (..., b, 6) in (-pi, pi] that put the flange at poses (..., 4, 4); NaN: no such branch.

    b is 8 for a spherical wrist, in closed form; 16 for one that is offset along axis 5, numerically, in no particular
    order. What follows holds for spherical ones.

    Rows are 4 * shoulder + 2 * elbow + wrist where axes 2 and 3 are parallel; else 2 * place + wrist, places in no
    particular order. Joint limits are not looked at (`workbench.robot.kinematics.within_limits`). In a singular posture
    the free angle is 0: joint 4 of a stretched wrist, joint 1 of a wrist above axis 1. Branches may then coincide.

    Raises:
        InputError: the robot has neither wrist, or one that the first three joints cannot move everywhere.
    """
    poses = np.ascontiguousarray(base_from_flange, float)
    flat = poses.reshape(-1, 4, 4)
    try:
        wrist = spherical_wrist(chain)
    except InputError:
        offset = offset_wrist(chain)
        if offset is None:
            raise
        return offset_inverse(chain, offset, flat).reshape(*poses.shape[:-2], MOST, 6)
    at_zero = chain.base_from_flange_at_zero
    in_flange = at_zero[:3, :3].T @ (wrist.centre_mm - at_zero[:3, 3])
    first = _first_three(chain, wrist, flat[:, :3, :3] @ in_flange + flat[:, :3, 3])
    solved = _with_wrist(chain.axes, np.ascontiguousarray(at_zero[:3, :3].T), first, flat)
    return np.asarray(solved.reshape(*poses.shape[:-2], BRANCHES, 6))


def _first_three(chain: Chain, wrist: SphericalWrist, centre_mm: Float) -> Float:
    """Angles (n, 4, 3) that bring the wrist's centre to places (n, 3)."""
    if wrist.behind_parallel_axes:
        return np.asarray(
            parallel_position(chain.axes, chain.points_mm / 1e3, wrist.centre_mm / 1e3, centre_mm / 1e3)[0]
        )
    return general_position(chain, wrist.centre_mm, centre_mm)


@kernel
def _with_wrist(h: AnyArray, zero_from_flange: AnyArray, first: AnyArray, poses: AnyArray) -> AnyArray:
    """All six angles (n, 8, 6) from the first three (n, 4, 3) and the poses."""
    out = np.full((len(poses), 8, 6), np.nan)
    sides = _between(h[3], h[4]), _between(h[4], h[5]), angle_about(h[4], h[3], h[5])
    for n in range(len(poses)):
        turn = np.ascontiguousarray(poses[n, :3, :3]) @ zero_from_flange
        for place in range(4):
            q1, q2, q3 = first[n, place]
            if np.isnan(q1):
                continue
            left = (rotation_about(h[0], q1) @ rotation_about(h[1], q2) @ rotation_about(h[2], q3)).T @ turn
            for flipped in range(2):
                q4, q5, q6 = _wrist(h, sides, left, 1.0 - 2.0 * flipped)
                row = out[n, 2 * place + flipped]
                if not np.isnan(q5):
                    row[0], row[1], row[2], row[3], row[4], row[5] = (
                        wrapped(q1),
                        wrapped(q2),
                        wrapped(q3),
                        q4,
                        q5,
                        q6,
                    )
    return out


@kernel
def _wrist(h: AnyArray, sides: tuple[float, float, float], left: AnyArray, sense: float) -> tuple[float, float, float]:
    """Angles of joints 4, 5, 6 whose turns make the rotation `left`; NaN: they cannot, their axes being oblique.

    Axes 4, 5 and 6 are corners of a spherical triangle. Joint 5 is its angle at axis 5, by the half-angle formula,
    which loses nothing near a stretched wrist. `sides`: of axis 5 to axes 4 and 6, and its angle with joints at zero.
    """
    k = left @ h[5]
    (a, b, start), c = sides, _between(h[3], k)
    near, far = np.sin((c + a - b) / 2) * np.sin((c - a + b) / 2), np.sin((a + b + c) / 2) * np.sin((a + b - c) / 2)
    if min(near, far) < -SINGULAR:
        return np.nan, np.nan, np.nan
    bend = 2 * np.arctan2(np.sqrt(max(near, 0.0)), np.sqrt(max(far, 0.0)))
    q5 = wrapped(sense * bend - start)
    r5 = rotation_about(h[4], q5)
    bent = r5 @ h[5]
    across = bent - (h[3] @ bent) * h[3]  # first, so that little is lost where it is short
    q4 = 0.0 if np.sin(c) < SINGULAR else angle_about(h[3], across, k)
    r6 = (rotation_about(h[3], q4) @ r5).T @ left
    return q4, q5, angle_about(h[5], h[4], r6 @ h[4])


@kernel
def _between(u: AnyArray, v: AnyArray) -> float:
    """Angle of two unit vectors, 0 to pi."""
    return float(np.arctan2(np.linalg.norm(np.cross(u, v)), u @ v))


def offset_inverse(chain: Chain, wrist: OffsetWrist, poses: Float) -> Float:
    """Joint angles (n, MOST, 6) in (-pi, pi] at poses (n, 4, 4), NaN: fewer; in no particular order.

    Where a solution is singular (double) to some 1e-6 rad, it may be missing.
    """
    found = np.full((len(poses), MOST, 6), np.nan)
    left, _, right = np.linalg.svd(poses[:, :3, :3])  # what is rounded is no rotation, and nothing would reach it
    poses = poses.copy()
    poses[:, :3, :3] = left @ right
    for begin in range(0, len(poses), 500):
        part = slice(begin, begin + 500)
        search = _Search(chain, wrist, poses[part])
        which, q = search.solutions()
        for n in range(len(poses[part])):
            one = _different(_wrapped(q[which == n]))[:MOST]
            found[begin + n, : len(one)] = one
    return found


class OffsetArm(NamedTuple):
    """An arm with an offset wrist as the kernel takes it, all joints at zero in the base; lengths in m."""

    axes: Shaped[Float, "6 3"]
    points: Shaped[Float, "6 3"]  # on the axes
    on_4: Shaped[Float, " 3"]  # where axes 4 and 5 meet
    on_6: Shaped[Float, " 3"]  # where axes 5 and 6 meet
    offset: float  # from the one to the other, along axis 5
    turning: Shaped[Float, "3 3"]  # axis 5 as joint 6 turns it: what stays, what goes with the cosine and the sine


class _Search:
    """The error of axis 4's angle to axis 5, over joint 6, for n poses and the four ways of joints 1 to 3."""

    def __init__(self, chain: Chain, wrist: OffsetWrist, poses: Float) -> None:
        self.chain, self.wrist, self.poses = chain, wrist, poses
        self.moved = np.ascontiguousarray(poses @ np.linalg.inv(chain.base_from_flange_at_zero))  # of link 6, from zero
        h = chain.axes
        along = h[5] * (h[5] @ h[4])  # of axis 5, about axis 6
        turning = np.array([along, h[4] - along, np.cross(h[5], h[4])])
        on_4, on_6, offset = wrist.on_4_mm / 1e3, wrist.on_6_mm / 1e3, wrist.offset_mm / 1e3
        self.arm = OffsetArm(h, chain.points_mm / 1e3, on_4, on_6, offset, turning)

    def ways(self, pose: Int, angle: Float) -> tuple[Float, Float, Float, Float]:
        """Angles of joints 1 to 3 (m, 4, 3), error (m, 4), room (m, 4, 2), direction of axis 5 (m, 3), joint 6 at (m,).

        The room is that of `parallel_position`.
        """
        found: tuple[Float, Float, Float, Float] = ways_kernel(
            self.arm, self.moved, np.ascontiguousarray(pose), np.ascontiguousarray(angle)
        )
        return found

    def solutions(self) -> tuple[Int, Float]:
        """Index of the pose (k,) and joint angles (k, 6)."""
        step, count = 2 * np.pi / STEPS, len(self.poses)
        grid = 0.0123 + step * np.arange(-1, STEPS + 2)  # no special angle; the ends lie over each other
        pose, at = np.arange(count), np.tile(grid, (count, 1))
        error, room = self._errors(pose, at)
        again, where = np.nonzero(_doubtful(error, room))
        finer = at[again, where][:, None] + step / FINER * np.arange(-1, FINER + 2)
        parts = [self._changes(error, pose, at), *self._closely(pose[again], finer), *self._unseen(pose[again], finer)]
        low, high, pose, way = (np.concatenate(column) for column in zip(*parts, strict=True))
        below = np.sign(self._at(pose, way, low))
        for _ in range(HALVINGS):
            middle = (low + high) / 2
            left = np.sign(self._at(pose, way, middle)) == below
            low, high = np.where(left, middle, low), np.where(left, high, middle)
        first, _, _, direction = self.ways(pose, (low + high) / 2)
        first = first[np.arange(len(pose)), way]
        there = np.isfinite(first).all(axis=1)
        q = self._wrist(pose[there], first[there], direction[there], (low + high)[there] / 2)
        q, missing = _polished(self.chain, self.poses[pose[there]], q)
        return pose[there][missing < REACHED], q[missing < REACHED]

    def _at(self, pose: Int, way: Int, angle: Float) -> Float:
        return np.asarray(self.ways(pose, angle)[1][np.arange(len(pose)), way])

    def _room(self, pose: Int, way: Int, which: Int, angle: Float) -> Float:
        return np.asarray(self.ways(pose, angle)[2][np.arange(len(pose)), way, which])

    def _errors(self, pose: Int, angle: Float) -> tuple[Float, Float]:
        """Errors (p, k, 4) and room (p, k, 4, 2) on pieces of the circle, angles (p, k)."""
        count, steps = angle.shape
        _, error, room, _ = self.ways(np.repeat(pose, steps), angle.reshape(-1))
        return error.reshape(count, steps, 4), room.reshape(count, steps, 4, 2)

    def _changes(self, error: Float, pose: Int, angle: Float) -> Brackets:
        """Where the sign changes from angle to angle."""
        piece, at, way = np.nonzero(error[:, :-1] * error[:, 1:] < 0)
        return angle[piece, at], angle[piece, at + 1], pose[piece], way

    def _closely(self, pose: Int, angle: Float) -> list[Brackets]:
        """Sign changes on pieces, those at ends and about extremes too."""
        error, _ = self._errors(pose, angle)
        solved = np.isfinite(error)
        piece, at, way = np.nonzero(solved[:, :-1] != solved[:, 1:])
        inner, outer = np.where(solved[piece, at, way], (at, at + 1), (at + 1, at))
        ends = self._at_end(pose[piece], way, angle[piece, inner], angle[piece, outer])
        piece, at, way = np.nonzero(_extreme(error))
        low, middle, high = (angle[piece, at + k] for k in range(3))
        extremes = self._at_extreme(pose[piece], way, low, middle, high)
        return [self._changes(error, pose, angle), *ends, *extremes]

    def _unseen(self, pose: Int, angle: Float) -> list[Brackets]:
        """What happens between the places of pieces, where the room comes near zero.

        A way begins and ends, or ends and begins again; or joints 1 or 2 turn at once, and the error with them.
        """
        room = self._errors(pose, angle)[1]
        both = self._where_both_end(pose, angle, room)
        piece, at, way, which = np.nonzero(_hidden(room))
        pose, low, middle, high = pose[piece], angle[piece, at], angle[piece, at + 1], angle[piece, at + 2]
        sign = np.sign(self._room(pose, way, which, middle))
        there = _golden(lambda at: sign * self._room(pose, way, which, at), low, high)
        least, ends = self._room(pose, way, which, there), np.stack([low, high])
        island, hole, near = (sign < 0) & (least > 0), (sign > 0) & (least < 0), (sign > 0) & (least > 0)
        found = [*both, *self._on_island(pose[island], way[island], there[island], ends[:, island])]
        for end in ends:
            found += self._at_end(pose[hole], way[hole], end[hole], there[hole])
        pose, way, which = pose[near], way[near], which[near]
        least, there, ends = least[near], there[near], ends[:, near]
        rise = [(self._room(pose, way, which, end) - least) / (end - there) ** 2 for end in ends]
        width = np.sqrt(least / np.maximum(np.max(rise, axis=0), 1e-12))  # in which the room doubles
        most = np.arcsinh((ends[1] - ends[0]) / width)
        evenly = there[:, None] + width[:, None] * np.sinh(most[:, None] * np.linspace(-1, 1, STEEP))
        return [*found, *self._closely(pose, evenly)]

    def _where_both_end(self, pose: Int, angle: Float, room: Float) -> list[Brackets]:
        """Ways that live between two neighbours: at the one end the shoulder's room ends, at the other the elbow's."""
        changed = (room[:, :-1] * room[:, 1:] < 0).all(axis=3)
        piece, at, way = np.nonzero(changed & (room[:, :-1].min(axis=3) < 0) & (room[:, 1:].min(axis=3) < 0))
        pose, ends = pose[piece], np.stack([angle[piece, at], angle[piece, at + 1]])
        zeros = []
        for which in (np.zeros(len(pose), int), np.ones(len(pose), int)):
            (low, high), below = ends, np.sign(self._room(pose, way, which, ends[0]))
            for _ in range(2 * HALVINGS):
                middle = (low + high) / 2
                left = np.sign(self._room(pose, way, which, middle)) == below
                low, high = np.where(left, middle, low), np.where(left, high, middle)
            zeros.append(low)
        there = (zeros[0] + zeros[1]) / 2
        lives = np.isfinite(self._at(pose, way, there))
        return self._on_island(pose[lives], way[lives], there[lives], ends[:, lives])

    def _on_island(self, pose: Int, way: Int, there: Float, ends: Float) -> list[Brackets]:
        """On ways that live about `there` (m,) and end before `ends` (2, m)."""
        first, last = (self._last(pose, way, there, end) for end in ends)
        sides = (one for end in ends for one in self._at_end(pose, way, there, end))
        return [*sides, *self._at_extreme(pose, way, first, there, last)]

    def _at_end(self, pose: Int, way: Int, inner: Float, outer: Float) -> list[Brackets]:
        """Where a way ends, the arm is stretched: up to the last angle that it reaches, and back over an extreme."""
        last = self._last(pose, way, inner, outer)
        return [
            self._if_changed(pose, way, inner, last),
            self._if_near(pose, way, last),
            *self._at_extreme(pose, way, 2 * inner - outer, inner, last),
        ]

    def _last(self, pose: Int, way: Int, inner: Float, outer: Float) -> Float:
        """The last angle that a way reaches from an inner one to one beyond."""
        last, beyond = inner.copy(), outer.copy()
        for _ in range(2 * HALVINGS):
            middle = (last + beyond) / 2
            reached = np.isfinite(self._at(pose, way, middle))
            last, beyond = np.where(reached, middle, last), np.where(reached, beyond, middle)
        return last

    def _at_extreme(self, pose: Int, way: Int, low: Float, middle: Float, high: Float) -> list[Brackets]:
        """Both sides of where the error comes nearest to zero, if it crosses it."""
        sign = np.sign(self._at(pose, way, middle))
        least = _golden(lambda at: sign * self._at(pose, way, at), low, high)
        tries = [least + share * (high - low) for share in (-0.02, 0.0, 0.02)]
        return [
            *(self._if_changed(pose, way, side, least) for side in (low, high)),
            *(self._if_near(pose, way, one) for one in tries),
        ]

    def _if_changed(self, pose: Int, way: Int, low: Float, high: Float) -> Brackets:
        """Those brackets between whose ends the sign changes."""
        changed = self._at(pose, way, low) * self._at(pose, way, high) < 0
        return low[changed], high[changed], pose[changed], way[changed]

    def _if_near(self, pose: Int, way: Int, angle: Float) -> Brackets:
        """Those angles where the error is nearly zero, as brackets without width, for Newton to try."""
        near = np.abs(self._at(pose, way, angle)) < NEAR
        return angle[near], angle[near], pose[near], way[near]

    def _wrist(self, pose: Int, first: Float, direction: Float, angle: Float) -> Float:
        """All six angles (m, 6) from the first three, axis 5 and joint 6."""
        h = self.chain.axes
        back = _turns(h, first)
        fourth = _angle(h[3], h[4], np.einsum("mji,mj->mi", back, direction))
        back = back @ _rotation(h[3], fourth)
        axis_6 = np.einsum("mij,j->mi", self.moved[pose, :3, :3], h[5])
        fifth = _angle(h[4], h[5], np.einsum("mji,mj->mi", back, axis_6))
        return np.column_stack([first, fourth, fifth, angle])


def _golden(value: Callable[[Float], Float], low: Float, high: Float) -> Float:
    """Where values are least between angles (m,), by golden section."""
    left, right = (low + (high - low) * share for share in (1 - GOLDEN, GOLDEN))
    of_left, of_right = value(left), value(right)
    for _ in range(HALVINGS):
        closer = of_left < of_right
        low, high = np.where(closer, low, left), np.where(closer, right, high)
        fresh = np.where(closer, high - GOLDEN * (high - low), low + GOLDEN * (high - low))
        of_fresh = value(fresh)
        left, right = np.where(closer, fresh, right), np.where(closer, left, fresh)
        of_left, of_right = np.where(closer, of_fresh, of_right), np.where(closer, of_left, of_fresh)
    return (low + high) / 2


def _hidden(room: Float) -> Bool:
    """Where room (p, k, 4, 2) is nearest to zero and may cross it between neighbours, of all angles but the outer ones.

    From its least place a smooth room goes on by less than by what it changed towards either neighbour.
    """
    size, step = np.abs(room), np.abs(np.diff(room, axis=1))
    here = size[:, 1:-1]
    nearest = (here <= size[:, :-2]) & (here <= size[:, 2:]) & (here <= np.maximum(step[:, :-1], step[:, 1:]))
    same = (room[:, 1:-1] * room[:, :-2] > 0) & (room[:, 1:-1] * room[:, 2:] > 0)
    return np.asarray(nearest & same)


def _extreme(error: Float) -> Bool:
    """Where errors (p, k, 4) come nearest to zero without crossing it, of all angles but the outer ones."""
    size, here = np.abs(error), error[:, 1:-1]
    nearest = (size[:, 1:-1] < size[:, :-2]) & (size[:, 1:-1] < size[:, 2:])
    return np.asarray(nearest & (here * error[:, 2:] > 0) & (here * error[:, :-2] > 0))


def _doubtful(error: Float, room: Float) -> Bool:
    """Steps (p, k - 1) in which more may happen than a change of sign: an end, an extreme near zero, a bend."""
    solved = np.isfinite(error)
    bent = np.abs(np.diff(error, 2, axis=1)) > BENT
    around = (bent | _hidden(room).any(axis=3) | (_extreme(error) & (np.abs(error[:, 1:-1]) < NEAR))).any(axis=2)
    ends = ((solved[:, :-1] != solved[:, 1:]) | (room[:, :-1] * room[:, 1:] < 0).all(axis=3)).any(axis=2)
    steps = ends.copy()
    steps[:, :-1] |= around | ends[:, 1:]
    steps[:, 1:] |= around | ends[:, :-1]
    return np.asarray(steps)


def _polished(chain: Chain, poses: Float, q: Float) -> tuple[Float, Float]:
    """Newton's steps on all six joints; the best of them and what it misses, m and 1."""
    best, missing = q, np.full(len(q), np.inf)
    for _ in range(8):
        here = forward_kinematics(chain, q)
        miss = np.concatenate([(poses[:, :3, 3] - here[:, :3, 3]) / 1e3, _small_turn(here, poses)], axis=1)
        now = np.linalg.norm(miss, axis=1)
        better = now < missing
        best, missing = np.where(better[:, None], q, best), np.where(better, now, missing)
        slope = jacobian(chain, q)
        slope[:, :3] /= 1e3
        square = np.swapaxes(slope, 1, 2) @ slope + 1e-14 * np.eye(6)
        q = q + np.linalg.solve(square, np.swapaxes(slope, 1, 2) @ miss[..., None])[..., 0]
    return best, missing


def _small_turn(here: Float, there: Float) -> Float:
    """Rotation vectors (m, 3) from poses to near ones, to first order, in the base."""
    r = there[:, :3, :3] @ np.swapaxes(here[:, :3, :3], 1, 2)
    return np.stack([r[:, 2, 1] - r[:, 1, 2], r[:, 0, 2] - r[:, 2, 0], r[:, 1, 0] - r[:, 0, 1]], axis=1) / 2


def _different(q: Float) -> Float:
    """Without solutions that repeat an earlier one."""
    if len(q) < 2:
        return q
    apart = np.abs(_wrapped(q[:, None] - q[None])).max(axis=2)
    return np.asarray(q[~(np.tril(apart < SAME, -1)).any(axis=1)])


def _wrapped(angle: Float) -> Float:
    return np.pi - (np.pi - angle) % (2 * np.pi)


@kernel
def ways_kernel(
    arm: OffsetArm, moved: AnyArray, pose: AnyArray, angle: AnyArray
) -> tuple[AnyArray, AnyArray, AnyArray, AnyArray]:
    """See `_Search.ways`; lengths in m, but `moved`."""
    h, turning, on_6 = arm.axes, arm.turning, arm.on_6
    direction, at = np.empty((len(pose), 3)), np.empty((len(pose), 3))
    for m in range(len(pose)):
        c, s = np.cos(angle[m]), np.sin(angle[m])
        for i in range(3):
            direction[m, i], at[m, i] = 0.0, moved[pose[m], i, 3] / 1e3
            for j in range(3):
                turn = moved[pose[m], i, j]
                direction[m, i] += turn * (turning[0, j] + c * turning[1, j] - s * turning[2, j])
                at[m, i] += turn * on_6[j]
        for i in range(3):
            at[m, i] -= arm.offset * direction[m, i]
    first, room = parallel_position(h, arm.points, arm.on_4, at)
    error = np.empty((len(pose), 4))
    wanted = h[3, 0] * h[4, 0] + h[3, 1] * h[4, 1] + h[3, 2] * h[4, 2]
    for m in range(len(pose)):
        for k in range(4):
            x, y, z = h[3, 0], h[3, 1], h[3, 2]
            for joint in range(2, -1, -1):
                c, s = np.cos(first[m, k, joint]), np.sin(first[m, k, joint])
                a, b, d = h[joint, 0], h[joint, 1], h[joint, 2]
                along = (1 - c) * (a * x + b * y + d * z)
                x, y, z = (
                    c * x + s * (b * z - d * y) + along * a,
                    c * y + s * (d * x - a * z) + along * b,
                    c * z + s * (a * y - b * x) + along * d,
                )
            error[m, k] = x * direction[m, 0] + y * direction[m, 1] + z * direction[m, 2] - wanted
    return first, error, room, direction


def _turns(h: Float, first: Float) -> Float:
    """Rotations (m, 3, 3) of link 3 by joints 1 to 3 at angles (m, 3)."""
    return _rotation(h[0], first[:, 0]) @ _rotation(h[1], first[:, 1]) @ _rotation(h[2], first[:, 2])


def _rotation(axis: Float, angle: Float) -> Float:
    """Rotations (m, 3, 3) about an axis (Rodrigues)."""
    x = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    c, s = np.cos(angle)[:, None, None], np.sin(angle)[:, None, None]
    return np.asarray(np.eye(3) + s * x + (1 - c) * (x @ x))


def _angle(axis: Float, start: Float, end: Float) -> Float:
    """Angles (m,) about an axis that turn `start` (3,) to `end` (m, 3), as seen along it."""
    across = np.cross(start, end) @ axis
    return np.asarray(np.arctan2(across, end @ start - (end @ axis) * (start @ axis)))
