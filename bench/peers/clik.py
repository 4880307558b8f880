"""One posture at a time with pinocchio: inverse kinematics, then J K^-1 J^T f. What one would write without kernels.

Inverse kinematics by pin's own closed-loop algorithm (its example `inverse-kinematics.py`: steps of 0.1, damping
1e-12, until the error is below 1e-4), by EAIK (Ostermeier, Kuelz, Althoff 2025), which solves all branches of a pose
at once, or by this project's closed form, called once a posture.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from workbench.robot import Chain, inverse_kinematics
from workbench.units import Float

EPS, STEP, DAMPING, MOST = 1e-4, 0.1, 1e-12, 1000


class OneByOne:
    """The robot as pinocchio has it; lengths in m inside."""

    def __init__(self, urdf: Path, chain: Chain, stiffness: Float) -> None:
        """`chain`: the same robot, for the closed form."""
        self.model = pin.buildModelFromUrdf(str(urdf))
        self.data = self.model.createData()
        self.flange = self.model.getFrameId("tool0")
        self.chain, self.compliance = chain, 1 / stiffness
        self.eaik = _eaik(chain)

    def clik(self, base_from_flange: Float, start: Float) -> Float | None:
        """Joint angles (6,) by closed-loop inverse kinematics; None: it did not converge."""
        wanted = pin.SE3(base_from_flange[:3, :3], base_from_flange[:3, 3] / 1e3)
        q = start.copy()
        for _ in range(MOST):
            pin.forwardKinematics(self.model, self.data, q)
            at = pin.updateFramePlacement(self.model, self.data, self.flange)
            error = pin.log6(at.actInv(wanted)).vector
            if np.linalg.norm(error) < EPS:
                return q
            jacobian = pin.computeFrameJacobian(self.model, self.data, q, self.flange)  # local axes
            moved = jacobian.T @ np.linalg.solve(jacobian @ jacobian.T + DAMPING * np.eye(6), error)
            q = pin.integrate(self.model, q, STEP * moved)
        return None

    def closed_form(self, base_from_flange: Float, branch: int) -> Float:
        """Joint angles (6,) of one branch."""
        return np.asarray(inverse_kinematics(self.chain, base_from_flange)[branch])

    def all_branches(self, base_from_flange: Float) -> list[Float]:
        """Joint angles (6,) of each branch that EAIK finds; its least-squares answers left out."""
        pose = base_from_flange.copy()
        pose[:3, 3] /= 1e3
        found = self.eaik.calculate_IK(pose)
        return [q for q, approximate in zip(found.Q, found.is_LS, strict=True) if not approximate]

    def displacement_mm(self, q: Float, point_in_flange_mm: Float, force_n: Float) -> float:
        """Length of J K^-1 J^T f of a flange point; the force in base axes."""
        jacobian = pin.computeFrameJacobian(self.model, self.data, q, self.flange, pin.LOCAL_WORLD_ALIGNED)
        at = pin.updateFramePlacement(self.model, self.data, self.flange)
        lever = at.rotation @ (point_in_flange_mm / 1e3)
        linear = jacobian[:3] - pin.skew(lever) @ jacobian[3:]
        return float(1e3 * np.linalg.norm(linear @ (self.compliance * (linear.T @ force_n))))


def _eaik(chain: Chain) -> Any:
    """The robot as EAIK has it, in m; None where there is no EAIK."""
    try:
        from eaik.pybindings.EAIK import Robot
    except ImportError:
        return None
    points = np.vstack([np.zeros(3), chain.points_mm, chain.base_from_flange_at_zero[:3, 3]]) / 1e3
    return Robot(chain.axes.T, np.diff(points, axis=0).T, chain.base_from_flange_at_zero[:3, :3], [], True)
