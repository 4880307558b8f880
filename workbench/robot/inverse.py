"""Inverse kinematics in closed form: all eight branches of a robot with a spherical wrist, over any number of poses.

Subproblems after Paden and Kahan (Murray, Li, Sastry 1994, section 3.3): shoulder from the wrist centre's distance
along axis 2, elbow by the law of cosines, wrist from the turn that is left. Angles come from atan2 of both their sine
and cosine, so nothing is lost near a singular posture.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from workbench.robot.chain import Chain
from workbench.robot.wrist import spherical_wrist
from workbench.units import AnyArray, Float

BRANCHES = 8  # 4 * shoulder + 2 * elbow + wrist
SINGULAR = 1e-13  # sine, or distance from an axis in m, below which an angle is free and set to 0


def inverse_kinematics(chain: Chain, base_from_flange: Float) -> Float:
    """Joint angles (..., 8, 6) in (-pi, pi] that put the flange at poses (..., 4, 4); NaN: no such branch.

    Joint limits are not looked at (`workbench.robot.chain.within_limits`). In a singular posture the free angle is 0:
    joint 4 of a stretched wrist, joint 1 of a wrist above axis 1. Branches may then coincide.

    Raises:
        InputError: the robot has no spherical wrist behind two parallel axes.
    """
    wrist = spherical_wrist(chain)
    poses = np.ascontiguousarray(base_from_flange, float)
    at_zero = chain.base_from_flange_at_zero
    zero_from_flange = np.ascontiguousarray(at_zero[:3, :3].T)
    in_flange = zero_from_flange @ (wrist.centre_mm - at_zero[:3, 3]) / 1e3
    solved = _inverse(
        chain.axes, chain.points_mm / 1e3, wrist.centre_mm / 1e3, in_flange, zero_from_flange, poses.reshape(-1, 4, 4)
    )
    return np.asarray(solved.reshape(*poses.shape[:-2], BRANCHES, 6))


@njit(cache=True)
def _inverse(h: AnyArray, o: AnyArray, centre: AnyArray, in_flange: AnyArray, zero_from_flange: AnyArray,
             poses: AnyArray) -> AnyArray:  # fmt: skip
    """Lengths in m, except in the poses. The wrist's `centre` is in the base at zero, `in_flange` in the flange."""
    out = np.full((len(poses), 8, 6), np.nan)
    upper, fore = o[2] - o[1], centre - o[2]
    upper, fore = upper - (upper @ h[1]) * h[1], fore - (fore @ h[1]) * h[1]
    for n in range(len(poses)):
        rotation = np.ascontiguousarray(poses[n, :3, :3])
        turn, w = rotation @ zero_from_flange, rotation @ in_flange + poses[n, :3, 3] / 1e3
        shoulder, reaches = _on_circle(h[1], h[0], w - o[0], h[1] @ (centre - o[0]), -1.0)
        if not reaches:
            continue
        for a in range(2):
            r1 = _rotation(h[0], shoulder[a])
            u = r1.T @ (w - o[0]) + o[0] - o[1]
            u = u - (u @ h[1]) * h[1]
            elbow, reaches = _on_circle(upper, h[2], fore, (u @ u - upper @ upper - fore @ fore) / 2, 1.0)
            if not reaches:
                continue
            for b in range(2):
                r3 = _rotation(h[2], elbow[b])
                q2 = _angle(h[1], upper + r3 @ fore, u)
                left = (r1 @ _rotation(h[1], q2) @ r3).T @ turn
                for c in range(2):
                    q4, q5, q6 = _wrist(h, left, c)
                    row = out[n, 4 * a + 2 * b + c]
                    row[0], row[1], row[2], row[3], row[4], row[5] = shoulder[a], q2, elbow[b], q4, q5, q6
    return out


@njit(cache=True)
def _wrist(h: AnyArray, left: AnyArray, flipped: int) -> tuple[float, float, float]:
    """Angles of joints 4, 5, 6 whose turns make the rotation `left`."""
    k = left @ h[5]
    side = np.cross(h[4], h[3])
    sine = np.linalg.norm(np.cross(h[3], k))
    bend = np.arctan2(-sine if flipped else sine, h[3] @ k)
    q5 = _wrapped(bend - np.arctan2(side @ h[5], h[3] @ h[5]))
    q4 = 0.0 if sine < SINGULAR else _angle(h[3], (-side if flipped else side), k)
    r6 = (_rotation(h[3], q4) @ _rotation(h[4], q5)).T @ left
    return q4, q5, _angle(h[5], h[4], r6 @ h[4])


@njit(cache=True)
def _on_circle(d: AnyArray, axis: AnyArray, p: AnyArray, wanted: float, sense: float) -> tuple[AnyArray, bool]:
    """Both angles t with d . Rot(axis, sense t) p = wanted, and whether there are any."""
    along = (d @ axis) * (p @ axis)
    a, b = d @ p - along, sense * (d @ np.cross(axis, p))
    c, r = wanted - along, np.hypot(d @ p - along, d @ np.cross(axis, p))
    angles = np.zeros(2)
    if abs(c) > r * (1 + 1e-13) + 1e-14:
        return angles, False
    if r > SINGULAR:
        middle, half = np.arctan2(b, a), np.arctan2(np.sqrt(max(r * r - c * c, 0.0)), c)
        angles[0], angles[1] = _wrapped(middle + half), _wrapped(middle - half)
    return angles, True


@njit(cache=True)
def _angle(axis: AnyArray, start: AnyArray, end: AnyArray) -> float:
    """The angle about `axis` that turns `start` to `end`, as seen along it; 0 where either lies on it."""
    across, along = axis @ np.cross(start, end), start @ end - (axis @ start) * (axis @ end)
    return float(np.arctan2(across, along)) if across != 0.0 or along != 0.0 else 0.0


@njit(cache=True)
def _wrapped(angle: float) -> float:
    return float(np.pi - (np.pi - angle) % (2 * np.pi))


@njit(cache=True)
def _rotation(axis: AnyArray, angle: float) -> AnyArray:
    """Rodrigues."""
    c, s = np.cos(angle), np.sin(angle)
    x, y, z = axis
    return np.array([
        [c + x * x * (1 - c), x * y * (1 - c) - z * s, x * z * (1 - c) + y * s],
        [y * x * (1 - c) + z * s, c + y * y * (1 - c), y * z * (1 - c) - x * s],
        [z * x * (1 - c) - y * s, z * y * (1 - c) + x * s, c + z * z * (1 - c)],
    ])  # fmt: skip
