"""Kinematics of a six-axis robot over any number of postures, forward; proven equal to pin in the tests.

The chain is its axes in the base, all joints at zero. Lengths in mm, angles in rad. The Jacobian is the one that pin
calls LOCAL_WORLD_ALIGNED: velocity of a point of the flange and angular velocity, both in base axes. Rows 0 to 2 in
mm/rad, rows 3 to 5 in rad/rad.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from workbench.geometry.poses import cross, mapped
from workbench.kernels import kernel
from workbench.units import DEG, AnyArray, Float, Shaped

CONVENTIONAL = ("base", "base_link", "world", "tool0", "flange")  # frames of a URDF that mean the same in all (REP-199)
AngleConvention = Literal["abb", "dh", "dh_same_sense"]


@dataclass(frozen=True, slots=True, eq=False)
class Bodies:
    """Mass of the six moving links, in the base with all joints at 0."""

    mass_kg: Shaped[Float, " 6"]
    centre_mm: Shaped[Float, "6 3"]  # of gravity
    inertia_kg_m2: Shaped[Float, "6 3 3"]  # about the centre of gravity, base axes


@dataclass(frozen=True, slots=True, eq=False)
class Chain:
    """Six revolute joints by their axes at zero (product of exponentials; Brockett 1984).

    Turning joint i turns everything behind it about axis i. Angles are the controller's (for the shipped robot, ABB's).
    """

    name: str
    joint_names: tuple[str, ...]
    axes: Shaped[Float, "6 3"]  # unit, in the base, all joints at 0
    points_mm: Shaped[Float, "6 3"]  # a point on each axis, likewise
    base_from_flange_at_zero: Shaped[Float, "4 4"]
    limits: Shaped[Float, "6 2"]  # lower, upper
    speeds: Shaped[Float, " 6"]  # rad/s, largest
    frames: Mapping[str, Float] = field(default_factory=dict)  # base_from_frame (4, 4) at zero, of CONVENTIONAL names
    bodies: Bodies | None = None  # None: the URDF states no masses


def abb_angles(angles: Float, convention: AngleConvention) -> Float:
    """The controller's joint angles (..., 6) of an IRB 6700 from angles (..., 6) in another convention, rad.

    'abb': they are already. 'dh': standard Denavit-Hartenberg with twists 90 0 90 -90 90 0, where axes II, III and V
    count against the controller. 'dh_same_sense': only the zero of axis II differs. The paper's Table A1 holds angles
    beyond ABB's limits and fits either of the last two; 'dh' is the reading that this project takes.
    """
    q = np.array(angles, float)
    if convention == "dh":
        q = q * (1, -1, -1, 1, -1, 1) + np.array([0, 90, 0, 0, 0, 180]) * DEG
    elif convention == "dh_same_sense":
        q = q - np.array([0, 90, 0, 0, 0, 0]) * DEG
    return np.asarray(q)


def within_limits(chain: Chain, joints: Float, reference: Float | None = None) -> Float:
    """Each angle of `joints` (..., 6) plus the multiple of 360 deg that lies within limits, nearest to `reference`.

    NaN where none does. `reference` (..., 6), default 0: the branch of a turning wrist that one wants to stay on.
    """
    turn = 2 * np.pi
    q, wanted = np.asarray(joints, float), np.zeros(6) if reference is None else np.asarray(reference, float)
    low, high = chain.limits.T
    slack = 1e-9  # rad: an angle on its limit stays on it
    first, last = np.ceil((low - slack - q) / turn), np.floor((high + slack - q) / turn)
    chosen = q + turn * np.clip(np.round((wanted - q) / turn), first, last)
    return np.where(first <= last, chosen, np.nan)


def forward_kinematics(chain: Chain, joints: Float) -> Float:
    """`base_from_flange` (..., 4, 4) at joint angles (..., 6)."""
    return motions(chain, joints)[..., 6, :, :] @ chain.base_from_flange_at_zero


def motions(chain: Chain, joints: Float) -> Float:
    """How each link moved from where it is at zero: (..., 7, 4, 4), the fixed base first, in base coordinates."""
    q = np.ascontiguousarray(joints, float)
    moved = _motions(chain.axes, chain.points_mm, q.reshape(-1, 6))
    return np.asarray(moved.reshape(*q.shape[:-1], 7, 4, 4))


def joint_axes(chain: Chain, joints: Float) -> tuple[Float, Float]:
    """Unit axes (..., 6, 3) of the joints and points on them (..., 6, 3), in the base, at joint angles (..., 6)."""
    before = motions(chain, joints)[..., :6, :, :]
    axes = (before[..., :3, :3] @ chain.axes[:, :, None])[..., 0]
    points = mapped(before, chain.points_mm)
    return axes, points


def jacobian(chain: Chain, joints: Float, point_mm: Float | None = None) -> Float:
    """J (..., 6, 6) at joint angles (..., 6), of the point `point_mm` (3,) in the flange frame (None: its origin)."""
    axes, points = joint_axes(chain, joints)
    flange = forward_kinematics(chain, joints)
    tip = flange[..., :3, 3] if point_mm is None else mapped(flange, point_mm)
    return jacobian_at(axes, points, tip)


def jacobian_at(axes: Float, points_mm: Float, tip_mm: Float) -> Float:
    """J (..., 6, 6) of a point `tip_mm` (..., 3) of the last link, from the joints' axes and points (..., 6, 3)."""
    linear = cross(axes, tip_mm[..., None, :] - points_mm)
    return np.asarray(np.concatenate([linear, axes], axis=-1).mT)


def jacobian_derivative(jacobian: Float) -> Float:
    """D (..., 6, 6, 6) with D[..., :, i, j] = dJ[:, i]/dq_j, in closed form.

    A joint j before i carries axis i and the tip along: both halves of column i turn about axis j. A joint j behind i
    moves the tip only, by column j.
    """
    linear, turning = np.split(jacobian.mT, 2, axis=-1)
    i, j = np.indices((6, 6))
    outer, inner = np.minimum(i, j), np.maximum(i, j)
    by_tip = cross(turning[..., outer, :], linear[..., inner, :])
    by_axis = np.where((j < i)[..., None], cross(turning[..., j, :], turning[..., i, :]), 0.0)
    return np.moveaxis(np.concatenate([by_tip, by_axis], axis=-1), -1, -3)


@kernel
def _motions(axes: AnyArray, points: AnyArray, q: AnyArray) -> AnyArray:
    """Chained turns about the axes at zero, posture by posture."""
    moved, turn = np.zeros((len(q), 7, 4, 4)), np.zeros((1, 3, 4))
    for n in range(len(q)):
        for k in range(4):
            moved[n, 0, k, k] = 1.0
        for i in range(6):
            turn_about_axis(turn, 0, axes, points, i, q[n, i])
            moved[n, i + 1, 3, 3] = 1.0
            compose(moved[n], i + 1, moved[n], i, turn, 0)
    return moved


@kernel
def compose(out: AnyArray, o: int, a: AnyArray, i: int, b: AnyArray, j: int) -> None:
    """out[o] = a[i] b[j], of rigid motions in their first three rows."""
    for r in range(3):
        for c in range(4):
            out[o, r, c] = a[i, r, 0] * b[j, 0, c] + a[i, r, 1] * b[j, 1, c] + a[i, r, 2] * b[j, 2, c]
        out[o, r, 3] += a[i, r, 3]


@kernel
def turn_about_axis(turn: AnyArray, k: int, axes: AnyArray, points: AnyArray, i: int, angle: float) -> None:
    """The rigid motion turn[k] (3, 4) that turns by `angle` about axis i (Rodrigues)."""
    c, s = np.cos(angle), np.sin(angle)
    x, y, z, v = axes[i, 0], axes[i, 1], axes[i, 2], 1 - c
    turn[k, 0, 0], turn[k, 0, 1], turn[k, 0, 2] = c + x * x * v, x * y * v - z * s, x * z * v + y * s
    turn[k, 1, 0], turn[k, 1, 1], turn[k, 1, 2] = y * x * v + z * s, c + y * y * v, y * z * v - x * s
    turn[k, 2, 0], turn[k, 2, 1], turn[k, 2, 2] = z * x * v - y * s, z * y * v + x * s, c + z * z * v
    for r in range(3):
        a, b, d = turn[k, r, 0], turn[k, r, 1], turn[k, r, 2]
        turn[k, r, 3] = points[i, r] - a * points[i, 0] - b * points[i, 1] - d * points[i, 2]
