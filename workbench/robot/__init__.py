"""The robot cell: its file, the robot's kinematics, collision. Stages `robot.cell`, `robot.plate`.

Kinematics come from the URDF by pinocchio; the kernels here are vectorised over postures and proven equal to it in the
tests. Collision is python-fcl's.
"""

from workbench.artefacts.showing import shown_all
from workbench.robot.bounds import CollisionScreen
from workbench.robot.cell_file import LoadingSetup
from workbench.robot.cell_model import Cell, Margins, Shape, Turntable, dexterity, within_margins
from workbench.robot.cell_stage import cell, read_cell
from workbench.robot.collision import (
    Clearance,
    CollisionModel,
    base_from_targets,
    external_at,
    sliding,
    standing_poses,
    turn_about_z,
    turntable_pose,
)
from workbench.robot.drawing import cell_strokes
from workbench.robot.inverse import inverse_kinematics
from workbench.robot.kinematics import (
    AngleConvention,
    Bodies,
    Chain,
    abb_angles,
    forward_kinematics,
    jacobian,
    jacobian_at,
    jacobian_derivative,
    joint_axes,
    motions,
    within_limits,
)
from workbench.robot.plate_stage import plate
from workbench.robot.process import turntable_at_home
from workbench.robot.refusals import refusal
from workbench.robot.wrist import SIDES, Side, SphericalWrist, arm_sides, refuse_contradiction, spherical_wrist

__all__ = [
    "SIDES",
    "AngleConvention",
    "Bodies",
    "Cell",
    "Chain",
    "Clearance",
    "CollisionModel",
    "CollisionScreen",
    "LoadingSetup",
    "Margins",
    "Shape",
    "Side",
    "SphericalWrist",
    "Turntable",
    "abb_angles",
    "arm_sides",
    "base_from_targets",
    "cell",
    "cell_strokes",
    "dexterity",
    "external_at",
    "forward_kinematics",
    "inverse_kinematics",
    "jacobian",
    "jacobian_at",
    "jacobian_derivative",
    "joint_axes",
    "motions",
    "plate",
    "read_cell",
    "refusal",
    "refuse_contradiction",
    "sliding",
    "spherical_wrist",
    "standing_poses",
    "turn_about_z",
    "turntable_at_home",
    "turntable_pose",
    "within_limits",
    "within_margins",
]

shown_all(*(globals()[_name] for _name in __all__))
del shown_all
