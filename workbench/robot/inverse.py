"""Inverse kinematics, all branches over any number of poses.

In closed form for a robot with a spherical wrist behind parallel axes 2 and 3: its centre depends on the first three
joints only. They are solved first, with Newton's steps where the axes are not quite parallel (a calibrated arm, rounded
figures), then the wrist's turn that is left.

Numerically for arms whose wrist is offset along axis 5 (UR, CRX). Axis 4 meets axis 5 in one point, axis 6 meets it in
another. For a given angle of joint 6 the second point and the direction of axis 5 are known, so the first point is, and
joint 1 brings it to its height along axis 2 in two ways. Then two equations are linear in the cosine and the sine of
the forearm's turn about axes 2 and 3: the upper arm has its length, and axes 4 and 5 have the angle to each other that
they have. Both hold where their resultant is zero. Its product over the two ways is a trigonometric polynomial of
degree 8 in joint 6, known from its values around the circle; its 16 roots, of which the real ones count, are
eigenvalues of a companion matrix. Newton's steps on all six joints take away what rounding leaves.
"""

from __future__ import annotations

import functools

import numpy as np

from workbench.errors import InputError
from workbench.geometry.poses import mapped, rotation_from_vector, vector_from_rotation
from workbench.kernels import kernel
from workbench.robot.kinematics import Chain, forward_kinematics, jacobian
from workbench.robot.wrist import (
    SINGULAR,
    OffsetWrist,
    SphericalWrist,
    angle_about,
    arm_size_mm,
    centre_at,
    newton,
    offset_wrist,
    on_circle,
    parallel_position,
    rotation_about,
    spherical_wrist,
    turn_about,
    wrapped,
)
from workbench.units import AnyArray, Float, Int

BRANCHES = 8  # two for each of the up to four places of the first three joints
MOST = 16  # solutions of any six revolute joints (Primrose 1986)
DEGREE, SAMPLES = 8, 32  # of the polynomial in joint 6, and places around the circle where it is computed
BEGIN = 0.0123  # rad, of these places: no special angle
REAL, NEAR = 0.02, 0.05  # off the unit circle; of axis 4 off its angle, and out of reach: tried all the same
STEPS = 16  # of Newton's; where two solutions are near each other each halves what is missing
SAME = 1e-6  # rad: nearer than this, two solutions are one
REACHED = 1e-9  # m and 1: what may be missing of a pose, or be between what is the same


def inverse_kinematics(chain: Chain, base_from_flange: Float) -> Float:
    """Joint angles (..., b, 6) in (-pi, pi] that put the flange at poses (..., 4, 4); NaN: no such branch.

    b is 8 for a spherical wrist, in closed form; 16 for one that is offset along axis 5, numerically, in no particular
    order. What follows holds for spherical ones.

    Rows are 4 * shoulder + 2 * elbow + wrist. Joint limits are not looked at
    (`workbench.robot.kinematics.within_limits`). In a singular posture the free angle is 0: joint 4 of a stretched
    wrist, joint 1 of a wrist above axis 1. Branches may then coincide.

    Raises:
        InputError: the robot has neither wrist, or one that the first three joints cannot move everywhere; axes 2 and 3
            are not parallel.
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
    first = _first_three(chain, wrist, mapped(flat, in_flange))
    solved = _with_wrist(chain.axes, np.ascontiguousarray(at_zero[:3, :3].T), first, flat)
    return np.asarray(solved.reshape(*poses.shape[:-2], BRANCHES, 6))


def _first_three(chain: Chain, wrist: SphericalWrist, centre_mm: Float) -> Float:
    """Angles (n, 4, 3) that bring the wrist's centre to places (n, 3); where axes 2 and 3 are tilted by Newton."""
    arm = chain.axes, chain.points_mm / 1e3, wrist.centre_mm / 1e3, centre_mm / 1e3
    if wrist.parallel_axes:
        return np.asarray(parallel_position(*arm, 1e-13))
    size, start = arm_size_mm(chain, wrist.centre_mm), parallel_position(*arm, NEAR)

    def missing(here: Float) -> tuple[Float, Float]:
        at, slope = centre_at(chain, wrist.centre_mm, here, size)
        return centre_mm[:, None] / size - at, slope

    found, left = newton(missing, np.nan_to_num(start), STEPS)
    there = np.isfinite(start[..., 0]) & (left < 1e-12)
    return np.where(there[..., None], found, np.nan)


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

    Where solutions are singular (double) to some 1e-5 rad they may be missing, as where axes 4 and 5 meet on axis 1,
    and with the arm folded, so that they meet on axis 2, to 1e-2 rad.
    """
    found = np.full((len(poses), MOST, 6), np.nan)
    left, _, right = np.linalg.svd(poses[:, :3, :3])  # what is rounded is no rotation, and nothing would reach it
    poses = poses.copy()
    poses[:, :3, :3] = left @ right
    for begin in range(0, len(poses), 500):
        some = poses[begin : begin + 500]
        moved = some @ np.linalg.inv(chain.base_from_flange_at_zero)  # of link 6, from zero
        which, starts = _starts(chain, wrist, moved)
        q, missing = newton(functools.partial(_missing, chain, some[which]), starts, STEPS)
        for n in range(len(some)):
            one = _different(_wrapped(q[(which == n) & (missing < REACHED)]))[:MOST]
            found[begin + n, : len(one)] = one
    return found


def _starts(chain: Chain, wrist: OffsetWrist, moved: Float) -> tuple[Int, Float]:
    """Index of the pose (m,) and joint angles (m, 6) near its solutions."""
    h = chain.axes
    pose, last = _joint_6(chain, wrist, moved)
    direction, at = _before_joint_6(chain, wrist, moved[pose], last)
    first = parallel_position(h, chain.points_mm / 1e3, wrist.on_4_mm / 1e3, at / 1e3, NEAR).reshape(-1, 3)
    pose, last, direction = np.repeat(pose, 4), np.repeat(last, 4), np.repeat(direction, 4, axis=0)
    back = (
        rotation_from_vector(first[:, 0, None] * h[0])
        @ rotation_from_vector(first[:, 1, None] * h[1])
        @ rotation_from_vector(first[:, 2, None] * h[2])
    )
    off = np.einsum("mij,j,mi->m", back, h[3], direction) - h[3] @ h[4]
    near = np.flatnonzero(np.abs(off) < NEAR)  # not where nothing is reached
    pose, last, direction, first, back = pose[near], last[near], direction[near], first[near], back[near]
    fourth = turn_about(h[3], h[4], np.einsum("mji,mj->mi", back, direction))
    back = back @ rotation_from_vector(fourth[:, None] * h[3])
    axis_6 = np.einsum("mij,j->mi", moved[pose, :3, :3], h[5])
    return pose, np.column_stack([first, fourth, turn_about(h[4], h[5], np.einsum("mji,mj->mi", back, axis_6)), last])


def _before_joint_6(chain: Chain, wrist: OffsetWrist, moved: Float, angle: Float) -> tuple[Float, Float]:
    """Direction of axis 5 and where axis 4 meets it, mm (m, 3), with link 6 moved from zero (m, 4, 4) and its angle."""
    turn = moved[:, :3, :3]
    direction = (turn @ rotation_from_vector(-angle[:, None] * chain.axes[5])) @ chain.axes[4]
    return direction, turn @ wrist.on_6_mm + moved[:, :3, 3] - wrist.offset_mm * direction


def _joint_6(chain: Chain, wrist: OffsetWrist, moved: Float) -> tuple[Int, Float]:
    """Index of the pose (m,) and the angle of joint 6 at the roots that are real, or nearly so."""
    places, count = BEGIN + 2 * np.pi / SAMPLES * np.arange(SAMPLES), len(moved)
    at = _before_joint_6(chain, wrist, np.repeat(moved, SAMPLES, axis=0), np.tile(places, count))
    one, other = _resultants(chain, wrist, *at)
    if np.abs(one - other).max(initial=0.0) > REACHED * np.abs(one).max(initial=0.0):
        one = one * other  # else each solution comes twice, the shoulder turned over: the product is a square
    wave = np.fft.fft(one.real.reshape(count, SAMPLES), axis=1)
    rising = np.concatenate([wave[:, -DEGREE:], wave[:, : DEGREE + 1]], axis=1)
    root = on_circle(rising, REAL)
    real = np.isfinite(root)
    return np.nonzero(real)[0], root[real] + BEGIN


def _resultants(chain: Chain, wrist: OffsetWrist, direction: Float, at: Float) -> tuple[AnyArray, AnyArray]:
    """Of the two equations for the forearm's turn, by both ways of joint 1 (m,), times the square of its radius.

    Complex where joint 1 does not reach: the product of both is real. Lengths in units of the arm's own.
    """
    h, size = chain.axes, arm_size_mm(chain, wrist.on_4_mm)
    o, on_4 = chain.points_mm / size, wrist.on_4_mm / size
    upper, fore, axis_4 = (one - (one @ h[1]) * h[1] for one in (o[2] - o[1], on_4 - o[2], h[3]))
    arm = at / size - o[0]
    along = (h[1] @ h[0]) * (arm @ h[0])
    a, b, c = arm @ h[1] - along, -np.cross(h[0], arm) @ h[1], h[1] @ (on_4 - o[0]) - along  # a cos + b sin = c
    square = a * a + b * b
    rest = np.sqrt(square - c * c + 0j)

    def resultant(rest: AnyArray) -> AnyArray:
        cosine, sine = (a * c - b * rest) / square, (b * c + a * rest) / square

        def back(vectors: Float) -> AnyArray:
            along_axis = np.outer((1 - cosine) * (vectors @ h[0]), h[0])
            return np.asarray(vectors * cosine[:, None] - np.cross(h[0], vectors) * sine[:, None] + along_axis)

        wanted, axis_5 = back(arm) + o[0] - o[1], back(direction)
        p, q, f, g = (
            2 * wanted @ fore,
            2 * wanted @ np.cross(h[1], fore),
            axis_5 @ axis_4,
            axis_5 @ np.cross(h[1], axis_4),
        )
        r = (wanted * wanted).sum(axis=1) - (wanted @ h[1]) ** 2 + fore @ fore - upper @ upper
        s = h[3] @ h[4] - (h[3] @ h[1]) * (axis_5 @ h[1])
        return np.asarray(((r * g - q * s) ** 2 + (p * s - r * f) ** 2 - (p * g - q * f) ** 2) * square)

    return resultant(rest), resultant(-rest)


def _missing(chain: Chain, poses: Float, q: Float) -> tuple[Float, Float]:
    """What postures (m, 6) miss of poses (m, 4, 4), m and 1 (m, 6), and its slopes (m, 6, 6)."""
    here = forward_kinematics(chain, q)
    turn = vector_from_rotation(poses[:, :3, :3] @ here[:, :3, :3].mT)
    miss = np.concatenate([(poses[:, :3, 3] - here[:, :3, 3]) / 1e3, turn], axis=1)
    slope = jacobian(chain, q)
    slope[:, :3] /= 1e3
    return miss, slope


def _different(q: Float) -> Float:
    """Without solutions that repeat an earlier one."""
    apart = np.abs(_wrapped(q[:, None] - q[None])).max(axis=2)
    return np.asarray(q[~(np.tril(apart < SAME, -1)).any(axis=1)])


def _wrapped(angle: Float) -> Float:
    return np.pi - (np.pi - angle) % (2 * np.pi)
