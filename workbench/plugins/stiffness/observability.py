"""Which joints the loads cannot determine, and why, in words."""

from __future__ import annotations

import numpy as np

from workbench.api import Chain, Float, LoadingSetup, forward_kinematics, joint_axes
from workbench.plugins.stiffness.equations import Equations
from workbench.plugins.stiffness.estimate import Estimate
from workbench.plugins.stiffness.values import LoadingTests

ALIKE = 0.9  # correlation above which two joints count as not told apart
SURE = 3.0  # standard uncertainties by which a compliance counts as negative
LITTLE = 0.02  # torque over force times reach below which a load does not turn a joint


def unobserved(found: Estimate, largest_relative_u: float) -> list[int]:
    """Joints (from 0) whose compliance has a relative uncertainty above the limit, the worst first."""
    relative = np.full(6, np.inf)
    np.divide(
        found.u * np.sqrt(max(found.scale2, 1.0)), found.compliance, out=relative, where=found.compliance > 1e-300
    )
    return [int(j) for j in np.argsort(-relative) if relative[j] > largest_relative_u]


def reason(joint: int, found: Estimate, eq: Equations, chain: Chain, setup: LoadingSetup, tests: LoadingTests) -> str:
    """Why the loads say too little about a joint."""
    axes, points = joint_axes(chain, tests.joints)
    sensor = forward_kinematics(chain, tests.joints) @ setup.flange_from_sensor
    force = (sensor[:, :3, :3] @ tests.wrench[:, :3, None])[..., 0]
    size = np.linalg.norm(force, axis=1)
    torque = np.abs(eq.torque[:, joint])
    reach_mm = np.linalg.norm(sensor[:, :3, 3] - points[:, joint], axis=1)
    little = torque <= LITTLE * size * np.maximum(reach_mm, 100.0) / 1e3 + 3 * _torque_noise(eq, joint)
    if little.all():
        across = np.linalg.norm(np.cross(axes[:, joint], force), axis=1)
        if (across <= LITTLE * np.maximum(size, 1e-12)).all():
            return "all forces are parallel to its axis: load in other directions too"
        return (
            f"every force acts through its axis or nearly so, as with an in-line tool (largest torque about it "
            f"{torque.max():.3g} Nm): load it through a lever beside its axis"
        )
    partners = _alike(joint, found.covariance)
    if partners:
        names = " and ".join(str(j + 1) for j in partners)
        return f"its share cannot be told from that of joint {names}: use postures and directions that part them"
    u = found.u[joint] * np.sqrt(max(found.scale2, 1.0))
    if found.compliance[joint] < -SURE * u:
        return (
            f"it would give way against its load, compliance {found.compliance[joint]:.2g} ± {u:.2g} rad/Nm: the axes "
            "of wrench and displacement do not belong together"
        )
    return (
        f"its loads are too small for the noise: torques up to {torque.max():.3g} Nm, compliance "
        f"{found.compliance[joint]:.2g} ± {u:.2g} rad/Nm"
    )


def _torque_noise(eq: Equations, joint: int) -> Float:
    return np.asarray(np.linalg.norm(eq.by_wrench[:, joint] * eq.wrench_noise, axis=1))


def _alike(joint: int, covariance: Float) -> list[int]:
    u = np.sqrt(np.diag(covariance))
    correlation = np.abs(covariance[joint] / (u * u[joint]))
    return [int(j) for j in np.flatnonzero(correlation > ALIKE) if j != joint]
