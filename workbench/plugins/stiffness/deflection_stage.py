"""`stiffness.deflection`: how far the cutter gives way under a wrench at a posture."""

from __future__ import annotations

from typing import Literal

import numpy as np

from workbench.api import (
    DEG,
    AngleConvention,
    Cell,
    Document,
    InputError,
    abb_angles,
    forward_kinematics,
    result_file,
    stage,
)
from workbench.plugins.stiffness.elastic import balance, give_way, tangent_stiffness, way, wrench_at
from workbench.plugins.stiffness.values import Deflection, JointStiffness, Six

Vector = tuple[float, float, float]
Method = Literal["balance", "linear_kc", "linear"]


@stage("stiffness.deflection")
def deflection(
    cell: Cell,
    stiffness: JointStiffness,
    *,
    joints_deg: Six = (0, -3, 5, 45, -45, 225),
    angle_convention: AngleConvention = "abb",
    force_n: Vector = (0, 0, -200),
    torque_nm: Vector = (0, 0, 0),
    axes: Literal["base", "cutter"] = "base",
    method: Method = "balance",
) -> tuple[Deflection, Document]:
    """Displacement of the cutter's tip under a wrench, and the tangent stiffness (17) there (the paper's section 5.1).

    Args:
        cell: the robot cell.
        stiffness: of the joints.
        joints_deg: the posture, unloaded; default: the first of the paper's Table A1.
        angle_convention: of the joint angles: the controller's (abb), or one of two Denavit-Hartenberg readings.
        force_n: acts on the cutter's tip.
        torque_nm: acts there as well.
        axes: of force and torque, which keep their direction in space.
        method: `balance` of springs and load; `linear_kc`: J (K - K_c)^-1 J^T F; `linear`: J K^-1 J^T F, eq. (22)
            corrected.

    Raises:
        InputError: the load is so large that the robot finds no balance.

    Example:
        >>> from workbench import robot
        >>> from workbench.plugins import stiffness
        >>> cell = robot.cell(cell="data/robot/cell.json")
        >>> found, document = stiffness.deflection(cell, stiffness.read(cell), force_n=[0, 0, -200])
        >>> found.displacement_mm.round(2).tolist()
        [0.31, -0.02, -0.96]
    """
    joints = abb_angles(np.array(joints_deg, float) * DEG, angle_convention)
    tip = cell.flange_from_cutter[:3, 3]
    wrench = np.array([*force_n, *torque_nm], float)
    if axes == "cutter":
        rotation = (forward_kinematics(cell.chain, joints) @ cell.flange_from_cutter)[:3, :3]
        wrench = wrench_at(rotation, np.zeros(3), wrench)
    k = stiffness.nm_per_rad
    if method == "balance":
        try:
            dq = balance(cell.chain, 1 / k, joints, tip, wrench)
        except np.linalg.LinAlgError:
            size, moment = np.linalg.norm(wrench[:3]), np.linalg.norm(wrench[3:])
            raise InputError(
                "stiffness.deflection",
                f"no balance under {size:.4g} N and {moment:.4g} Nm: the robot buckles; expected a smaller load",
            ) from None
        moved = way(cell.chain, joints, dq, tip)
    else:
        moved, dq = give_way(cell.chain, k, joints, tip, wrench, with_kc=method != "linear")
    loaded = np.zeros(6) if method == "linear" else wrench
    found = Deflection(moved[:3], moved[3:], dq, tangent_stiffness(cell.chain, k, joints + dq, tip, loaded))
    content = {
        "frame": "base",
        "displacement_mm": found.displacement_mm,
        "rotation_deg": found.rotation / DEG,
        "joint_deflection_deg": found.joints / DEG,
        "tangent_stiffness_n_per_m_nm_per_rad": found.tangent_stiffness,
    }
    return found, result_file("deflection.json", content)
