"""The kinematic chain of a six-axis robot: its axes in the base, all joints at zero. Lengths in mm, angles in rad."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from workbench.units import DEG, Float, Shaped

AngleConvention = Literal["abb", "dh", "dh_same_sense"]


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
