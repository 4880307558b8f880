"""How far a robot keeps from its limits, from singular postures and from bodies; and how well its cell is known."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from workbench.kernels import kernel
from workbench.robot.kinematics import Chain, jacobian_at, joint_axes
from workbench.units import DEG, AnyArray, Float, Shaped

COVERAGE = 2.0  # times the stated standard uncertainties
DIGITS = 3  # of mm and deg behind the point, in the programs of the dialect that has the fewest: FANUC's
ROUNDED = 0.5 * 10.0**-DIGITS  # mm, deg: by which such a number may be off
# What a program may leave its path by: the tolerances of path.simplify, and three angles of each orientation rounded.
WRITTEN_MM, WRITTEN = 0.01 + ROUNDED, (0.05 + 3 * ROUNDED) * DEG
WRITTEN_JOINT = 2 * ROUNDED * DEG  # joint angles rounded; FANUC's joint 3 has the error of joint 2 besides
OFF_MM = 1.0  # of bodies, at most, between a way and what its places and its program tell of it
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

    @property
    def written(self) -> Float:
        """By how much a program may leave the postures that it was made from (6,): mm and rad, each axis."""
        return np.repeat([WRITTEN_MM, WRITTEN], 3)


def wrist_angles(axes: Float) -> Float:
    """Angle (n,), 0 to pi/2, between axes 4 and 6, of joint axes (n, 6, 3): 0 is the wrist's singularity."""
    a, b = axes[..., 3, :], axes[..., 5, :]
    return np.asarray(np.arctan2(np.linalg.norm(np.cross(a, b), axis=-1), np.abs((a * b).sum(axis=-1))))


def own_length_mm(chain: Chain) -> float:
    """Half the length of the chain from axis to axis to the flange, which makes the Jacobian's rows alike."""
    points = np.vstack([chain.points_mm, chain.base_from_flange_at_zero[:3, 3]])
    return float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum() / 2)


def dexterity(
    chain: Chain,
    joints: Shaped[Float, "n 6"],
    tip_mm: Shaped[Float, "n 3"],
    twist: Shaped[Float, "*k 6"],
    enough: float = 0.0,
) -> tuple[Float, Float, Float]:
    """Wrist angle (n,), condition number (n,) and what an error of the tool asks of the joints (*k, n, 6), at (n, 6).

    Args:
        chain: the robot.
        joints: (n, 6) rad.
        tip_mm: (n, 3) the tool centre point in the base.
        twist: (6,), or several (k, 6): how far the tool may be off, mm and rad, each axis.
        enough: condition number up to which an upper bound of it will do (by Frobenius norms: at most 6 times it).
    """
    axes, points = joint_axes(chain, joints)
    scale = np.array([own_length_mm(chain)] * 3 + [1.0] * 3)
    j = np.ascontiguousarray(jacobian_at(axes, points, tip_mm) / scale[:, None])
    back = _inverses(j)
    condition = np.sqrt((j * j).sum(axis=(1, 2)) * (back * back).sum(axis=(1, 2)))
    condition[~np.isfinite(condition)] = np.inf
    open_ = np.flatnonzero((condition > enough) & np.isfinite(j).all(axis=(1, 2)))
    sizes = np.linalg.svd(j[open_], compute_uv=False)
    with np.errstate(divide="ignore", over="ignore"):
        condition[open_] = sizes[:, 0] / sizes[:, 5]
    asked = np.zeros((*twist.shape[:-1], len(joints), 6))
    if twist.any():
        by_joint = np.einsum("nij,...j->...ni", np.abs(back), twist / scale)
        asked = np.where((condition < REGULAR)[:, None], by_joint, np.inf)
    return wrist_angles(axes), condition, asked


@kernel
def _inverses(matrices: AnyArray) -> AnyArray:
    """Inverses (n, 6, 6) by elimination with pivots; NaN where there is none."""
    found = np.empty_like(matrices)
    work = np.empty((6, 12))
    for n in range(len(matrices)):
        _put_beside_one(matrices[n], work)
        for c in range(6):
            best = c
            for r in range(c + 1, 6):
                if abs(work[r, c]) > abs(work[best, c]):
                    best = r
            size = work[best, c]
            if not abs(size) > 0.0:
                size = np.nan
            for k in range(12):
                held = work[best, k] / size
                work[best, k] = work[c, k]
                work[c, k] = held
            for r in range(6):
                if r != c:
                    factor = work[r, c]
                    for k in range(12):
                        work[r, k] -= factor * work[c, k]
        for r in range(6):
            for c in range(6):
                found[n, r, c] = work[r, 6 + c]
    return found


@kernel(inline="always")
def _put_beside_one(matrix: AnyArray, work: AnyArray) -> None:
    """Fill `work` (6, 12) with the matrix and, beside it, the identity."""
    for r in range(6):
        for c in range(6):
            work[r, c] = matrix[r, c]
            work[r, 6 + c] = 1.0 if r == c else 0.0
