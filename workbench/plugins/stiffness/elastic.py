"""The elastic robot: rigid links, joints as torsion springs (Salisbury 1980; K_c after Chen and Kao 2000).

A wrench is six numbers: force in N, moment in Nm about the loaded point, both in base axes, constant while the robot
gives way. Jacobians are in mm/rad and rad/rad, so torques divide by 1000. J is never inverted.
"""

from __future__ import annotations

import numpy as np

from workbench.api import (
    Chain,
    Float,
    Shaped,
    forward_kinematics,
    jacobian,
    jacobian_at,
    jacobian_derivative,
    joint_axes,
    vector_from_rotation,
)

MM = 1e3  # mm per m
PER_M = np.repeat([MM, 1.0], 3)  # of the rows of a Jacobian, and of a wrench about a point


def torques(slope: Float, wrench: Float) -> Float:
    """Joint torques J^T F (..., 6) in Nm, of a wrench (..., 6) at the Jacobian's point."""
    scaled = np.asarray(wrench, float) / PER_M
    return np.asarray((slope.mT @ scaled[..., None])[..., 0])


def geometric_stiffness(derivative: Float, wrench: Float) -> Float:
    """K_c (..., 6, 6) in Nm/rad, eq. (16): K_c[i, j] = d(J^T F)_i / dq_j. Its moment part is not symmetric."""
    scaled = np.asarray(wrench, float) / PER_M
    return np.asarray(np.einsum("...rij,...r->...ij", derivative, scaled))


def give_way(
    chain: Chain,
    stiffness: Shaped[Float, " 6"],
    joints: Shaped[Float, "... 6"],
    point_mm: Shaped[Float, " 3"],
    wrench: Shaped[Float, "... 6"],
    *,
    with_kc: bool,
) -> tuple[Float, Float]:
    """Displacement (..., 6) of a flange point, mm and rotation vector in rad, and joint deflection (..., 6) in rad.

    To first order: J dq, eq. (22) put right as J K^-1 J^T F, with K_c in K where asked for.

    Args:
        chain: the robot.
        stiffness: (6,) Nm/rad.
        joints: (..., 6) rad, unloaded.
        point_mm: (3,) the loaded point, in the flange frame.
        wrench: (..., 6) acts on the robot at that point, base axes.
        with_kc: whether the load's own stiffness K_c counts.
    """
    slope, derivative = _slopes(chain, joints, point_mm)
    tangent = np.diag(stiffness) - with_kc * geometric_stiffness(derivative, wrench)
    dq = np.asarray(np.linalg.solve(tangent, torques(slope, wrench)[..., None])[..., 0])
    return np.asarray((slope @ dq[..., None])[..., 0]), dq


def pushed(chain: Chain, stiffness: Float, joints: Float, point_mm: Float, force_n: Float) -> Float:
    """J K^-1 J^T f (..., 3), mm, of points (..., 3) in the base under forces (..., 3) at joints (..., 6); base axes."""
    slope = jacobian_at(*joint_axes(chain, joints), point_mm)[..., :3, :]
    torque = np.einsum("...ri,...r->...i", slope, force_n) / MM
    return np.asarray(np.einsum("...ri,...i->...r", slope, torque / stiffness))


def balance(
    chain: Chain, compliance: Float, joints: Float, point_mm: Float, wrench: Float, most: int | None = None
) -> Float:
    """Joint deflection (..., 6) at which springs of a compliance (6,), rad/Nm, and loads are in balance, by Newton.

    To 1e-14 rad; `most`: or after so many steps, each of which doubles the order that is right.

    Raises:
        LinAlgError: the robot buckles under the load: there is no balance near its unloaded posture.
    """
    dq: Float = np.zeros(np.shape(joints))
    for _ in range(most or 50):
        slope, derivative = _slopes(chain, joints + dq, point_mm)
        tangent = np.eye(6) - compliance[:, None] * geometric_stiffness(derivative, wrench)
        step = np.linalg.solve(tangent, (compliance * torques(slope, wrench) - dq)[..., None])[..., 0]
        dq = np.asarray(dq + step)
        if np.abs(step).max() < 1e-14:
            return dq
    if most is None:
        raise np.linalg.LinAlgError("no balance")
    return dq


def _slopes(chain: Chain, joints: Float, point_mm: Float) -> tuple[Float, Float]:
    """Jacobian (..., 6, 6) of a flange point and its derivative by the joints (..., 6, 6, 6)."""
    slope = jacobian(chain, joints, point_mm)
    return slope, jacobian_derivative(slope)


def way(chain: Chain, joints: Float, dq: Float, point_mm: Float) -> Float:
    """Displacement (..., 6) of a flange point when the joints turn by dq, however far."""
    before, after = forward_kinematics(chain, joints), forward_kinematics(chain, joints + dq)
    way = ((after - before) @ [*point_mm, 1.0])[..., :3]
    rotation = vector_from_rotation(after[..., :3, :3] @ before[..., :3, :3].mT)
    return np.concatenate([way, rotation], axis=-1)


def tangent_stiffness(chain: Chain, stiffness: Float, joints: Float, point_mm: Float, wrench: Float) -> Float:
    """K_x (6, 6) of eq. (17) at a posture that is in balance with `wrench`: N and Nm per m and rad, base axes.

    Inverted from the compliance J (K - K_c)^-1 J^T, which exists at singular postures too; entries are infinite there.
    """
    slope, derivative = _slopes(chain, joints, point_mm)
    kc = geometric_stiffness(derivative, wrench)
    in_metres = slope / PER_M[:, None]
    compliance = in_metres @ np.linalg.solve(np.diag(stiffness) - kc, in_metres.T)
    if np.linalg.cond(compliance) > 1 / np.finfo(float).eps:
        return np.full((6, 6), np.inf)
    return np.linalg.inv(compliance)


def wrench_at(rotation: Float, lever_mm: Float, wrench: Float) -> Float:
    """A sensor's wrench (..., 6) as the wrench at another point: eqs. (27), (28) put right.

    f_e = R f, tau_e = R tau + p x (R f), with R (..., 3, 3) from the sensor's axes to the wanted ones and p the lever
    (..., 3) from the point to the sensor, mm, in the wanted axes. The paper's (28) drops the sensor's own torque.
    """
    force = (rotation @ wrench[..., :3, None])[..., 0]
    moment = (rotation @ wrench[..., 3:, None])[..., 0] + np.cross(lever_mm, force) / MM
    return np.concatenate([force, moment], axis=-1)
