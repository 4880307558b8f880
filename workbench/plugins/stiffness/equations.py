"""The equations of identification, eq. (24): what each load says about the joints' compliance.

One *observation* is one load's displacement: its equations y = A c, c the compliance of the joints in rad/Nm. Rows are
mm and rad of the tool frame, or mm of the tracked points that were seen.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from workbench.api import (
    Chain,
    Float,
    LoadingSetup,
    Shaped,
    forward_kinematics,
    jacobian_at,
    jacobian_derivative,
    joint_axes,
)
from workbench.plugins.stiffness.elastic import MM, geometric_stiffness, torques, wrench_at
from workbench.plugins.stiffness.values import LoadingTests


@dataclass(frozen=True, slots=True, eq=False)
class Equations:
    """L loads with r rows each; rows of points that were not seen have weight 0 (`seen`)."""

    y: Shaped[Float, "L r"]  # mm, rad
    a: Shaped[Float, "L r 6"]  # with c in rad/Nm: first order
    curved: Shaped[Float, "L r 6 6"]  # second derivative of y by joint deflection: mm/rad^2, 1/rad
    torque: Shaped[Float, "L 6"]  # Nm, of each load about the joints
    by_wrench: Shaped[Float, "L 6 6"]  # torque = by_wrench @ the sensor's wrench
    jacobian: Shaped[Float, "L r 6"]  # of the rows: mm/rad, rad/rad
    kc: Shaped[Float, "L 6 6"]  # Nm/rad, of the load at its own posture
    noise: Shaped[Float, " r"]  # standard deviation of a row
    wrench_noise: Shaped[Float, " 6"]  # N, Nm
    seen: Shaped[Float, "L r"]  # 1 or 0


def equations(chain: Chain, setup: LoadingSetup, tests: LoadingTests) -> Equations:
    """Equations of all loads; `tests.joints` in the controller's convention."""
    axes, points = joint_axes(chain, tests.joints)
    flange = forward_kinematics(chain, tests.joints)
    sensor = flange @ setup.flange_from_sensor
    at_sensor = jacobian_at(axes, points, sensor[:, :3, 3])
    tip = (flange @ setup.flange_from_tool)[:, :3, 3]
    at_tip = jacobian_at(axes, points, tip)
    wrench = wrench_at(sensor[:, :3, :3], sensor[:, :3, 3] - tip, tests.wrench)
    torque = torques(at_tip, wrench)
    derivative = jacobian_derivative(axes, at_tip)
    jacobian, curved, y, noise = _rows(tests, setup, axes, points, flange, at_tip, derivative)
    seen = np.isfinite(y)
    return Equations(
        y=np.where(seen, y, 0.0),
        a=jacobian * torque[:, None, :],
        curved=curved,
        torque=torque,
        by_wrench=_by_wrench(at_sensor, sensor),
        jacobian=jacobian,
        kc=_kc(axes, at_sensor, sensor, tests.wrench),
        noise=noise,
        seen=seen.astype(float),
        wrench_noise=np.array([setup.force_noise_n] * 3 + [setup.torque_noise_nm] * 3),
    )


def _rows(
    tests: LoadingTests,
    setup: LoadingSetup,
    axes: Float,
    points: Float,
    flange: Float,
    at_tip: Float,
    derivative: Float,
) -> tuple[Float, Float, Float, Float]:
    """Jacobian, second derivative, measured displacement and noise of the rows of every load."""
    if tests.targets_mm is None:
        noise = np.array([setup.displacement_noise_mm] * 3 + [setup.rotation_noise] * 3)
        assert tests.displacement is not None
        return at_tip, derivative, tests.displacement, noise
    count, k = tests.targets_mm.shape[:2]
    at = (flange[:, None] @ np.column_stack([setup.targets_mm[:k], np.ones(k)])[:, :, None])[..., :3, 0]
    of_points = [jacobian_at(axes, points, at[:, i]) for i in range(k)]
    jacobian = np.concatenate([j[:, :3] for j in of_points], axis=1)
    curved = np.concatenate([jacobian_derivative(axes, j)[:, :3] for j in of_points], axis=1)
    return jacobian, curved, tests.targets_mm.reshape(count, 3 * k), np.full(3 * k, setup.target_noise_mm)


def _by_wrench(at_sensor: Float, sensor: Float) -> Float:
    """Joint torques of the unit wrenches in the sensor's axes."""
    turn = np.zeros((len(sensor), 6, 6))
    turn[:, :3, :3], turn[:, 3:, 3:] = sensor[:, :3, :3] / MM, sensor[:, :3, :3]
    return np.asarray(np.swapaxes(at_sensor, -1, -2) @ turn)


def _kc(axes: Float, at_sensor: Float, sensor: Float, wrench: Float) -> Float:
    """K_c of the load where it acts: the sensor keeps its point, the force its direction."""
    in_base = wrench_at(sensor[:, :3, :3], np.zeros(3), wrench)
    return geometric_stiffness(jacobian_derivative(axes, at_sensor), in_base)


def curvature(eq: Equations, compliance: Float) -> Float:
    """What the second order adds to y (L, r): K_c in the joints' deflection and the curvature of the way."""
    dq = eq.torque * compliance
    by_kc = np.einsum("lri,i,lij,lj->lr", eq.jacobian, compliance, eq.kc, dq)
    return np.asarray(by_kc + 0.5 * np.einsum("lrij,li,lj->lr", eq.curved, dq, dq))


def covariances(eq: Equations, compliance: Float) -> Float:
    """Covariance (L, r, r) of each load's rows: noise of the displacement, and of the wrench through the robot."""
    through = (eq.jacobian * compliance) @ eq.by_wrench * eq.wrench_noise
    return through @ np.swapaxes(through, -1, -2) + np.diag(eq.noise**2)
