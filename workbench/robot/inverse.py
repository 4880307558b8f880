"""Inverse kinematics, all branches over any number of poses: in closed form for a robot with a spherical wrist.

The wrist's centre depends on the first three joints only. They are solved first, then the wrist's turn that is left.
"""

from __future__ import annotations

import numpy as np

from workbench.errors import InputError
from workbench.kernels import kernel
from workbench.robot.inverse_offset import MOST, offset_inverse
from workbench.robot.kinematics import Chain
from workbench.robot.position import angle_about, general_position, parallel_position, rotation_about, wrapped
from workbench.robot.wrist import SphericalWrist, offset_wrist, spherical_wrist
from workbench.units import AnyArray, Float

BRANCHES = 8  # two for each of the up to four places of the first three joints
SINGULAR = 1e-13  # sine below which an angle is free and set to 0


def inverse_kinematics(chain: Chain, base_from_flange: Float) -> Float:
    """Joint angles (..., b, 6) in (-pi, pi] that put the flange at poses (..., 4, 4); NaN: no such branch.

    b is 8 for a spherical wrist, in closed form; 16 for one that is offset along axis 5 (`workbench.robot.
    inverse_offset`), numerically, in no particular order. What follows holds for spherical ones.

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
