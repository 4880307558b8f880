"""How far a robot keeps from its limits, from singular postures and from bodies; and how well its cell is known."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from workbench.robot.chain import Chain
from workbench.robot.kinematics import jacobian_at, joint_axes
from workbench.units import DEG, Float

COVERAGE = 2.0  # times the stated standard uncertainties
REGULAR = 1e9  # condition number up to which a Jacobian is inverted


@dataclass(frozen=True, slots=True)
class Margins:
    """What a posture must keep. The defaults are a cell engineer's; the cell file may say otherwise."""

    limit: float = 2.0 * DEG  # of every joint and the turntable from its limits
    wrist: float = 5.0 * DEG  # of axis 6 from the line of axis 4
    condition: float = 50.0  # of the Jacobian, lengths in units of half the robot's own
    flange_mm: float = 0.0  # standard uncertainty of the tool, each axis
    flange_rad: float = 0.0
    part_mm: float = 0.0  # of what stands on the base or the turntable, as the robot sees it: hand-eye, base, turntable
    part_rad: float = 0.0

    @property
    def twist(self) -> Float:
        """By how much the tool may be off its target (6,): mm and rad, coverage 2, each axis."""
        size = np.hypot([self.flange_mm, self.flange_rad], [self.part_mm, self.part_rad])
        return np.asarray(COVERAGE * np.repeat(size, 3))


def wrist_angles(axes: Float) -> Float:
    """Angle (n,), 0 to pi/2, between axes 4 and 6, of joint axes (n, 6, 3): 0 is the wrist's singularity."""
    a, b = axes[..., 3, :], axes[..., 5, :]
    return np.asarray(np.arctan2(np.linalg.norm(np.cross(a, b), axis=-1), np.abs((a * b).sum(axis=-1))))


def own_length_mm(chain: Chain) -> float:
    """Half the length of the chain from axis to axis to the flange, which makes the Jacobian's rows alike."""
    points = np.vstack([chain.points_mm, chain.base_from_flange_at_zero[:3, 3]])
    return float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum() / 2)


def dexterity(chain: Chain, joints: Float, tip_mm: Float, twist: Float) -> tuple[Float, Float, Float]:
    """Wrist angle (n,), condition number (n,) and what an error of the tool asks of the joints (n, 6), at (n, 6) rad.

    Args:
        chain: the robot.
        joints: (n, 6).
        tip_mm: (n, 3) the tool centre point in the base.
        twist: (6,) how far the tool may be off, mm and rad, each axis.
    """
    axes, points = joint_axes(chain, joints)
    scale = np.array([own_length_mm(chain)] * 3 + [1.0] * 3)
    j = jacobian_at(axes, points, tip_mm) / scale[:, None]
    condition, asked = np.full(len(joints), np.inf), np.zeros((len(joints), 6))
    finite = np.isfinite(j).all(axis=(1, 2))
    sizes = np.linalg.svd(j[finite], compute_uv=False)
    with np.errstate(divide="ignore", over="ignore"):
        condition[finite] = sizes[:, 0] / sizes[:, 5]
    if twist.any():
        asked[:] = np.inf
        regular = np.flatnonzero(condition < REGULAR)
        asked[regular] = np.abs(np.linalg.inv(j[regular])) @ (twist / scale)
    return wrist_angles(axes), condition, asked


def joint_reach(chain: Chain, joints: Float, tip_mm: Float, far_mm: float, turn: float) -> Float:
    """How far each joint (n, 6) turns, to first order, while the tip (n, 3) moves by `far_mm`, the tool by `turn`."""
    axes, points = joint_axes(chain, joints)
    scale = np.array([own_length_mm(chain)] * 3 + [1.0] * 3)
    j = jacobian_at(axes, points, tip_mm) / scale[:, None]
    found = np.full((len(joints), 6), np.inf)
    regular = np.isfinite(j).all(axis=(1, 2))
    regular[regular] = np.abs(np.linalg.det(j[regular])) > 1.0 / REGULAR
    inverse = np.linalg.inv(j[regular])
    by_place, by_turn = (np.linalg.norm(part, axis=2) for part in (inverse[..., :3], inverse[..., 3:]))
    found[regular] = by_place * far_mm / scale[0] + by_turn * turn
    return found
