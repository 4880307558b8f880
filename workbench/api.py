"""All that a plug-in imports: the stage decorator, its special parameters, artefacts, errors, poses, array types.

A plug-in is a distribution with an entry point in the group `workbench.stages`: the name is its family, the value the
module that defines its stages (docs/pipelines.md).
"""

from typing import TYPE_CHECKING, Any

from workbench import artefacts, pieces, plot
from workbench.artefacts import *  # noqa: F403
from workbench.dialect import Dialect, MillingTool, ProgramJob, write_program
from workbench.errors import InputError, OutputError, PipelineError, WorkbenchError, nearest
from workbench.geometry import estimator
from workbench.geometry.chains import FaceLines
from workbench.geometry.moves import chords_mm
from workbench.geometry.poses import (
    frame_about,
    interpolate_poses,
    inverse,
    mapped,
    pose_from,
    quaternion_from_rotation,
    rotation_from_quaternion,
    rotation_from_rpy,
    rotation_from_vector,
    rpy_from_rotation,
    vector_from_rotation,
)
from workbench.kernels import kernel
from workbench.language import Language
from workbench.parameters import parsed
from workbench.stage import InputFile, Progress, Seed, stage
from workbench.storage import csv_table, finite_number, numbered_lines, read_text
from workbench.strict_json import read_json, strict_json
from workbench.units import COVERAGE, DEG, TO_SD, AnyArray, Bool, Float, Float32, Int, Shaped

if TYPE_CHECKING:  # loaded on first use
    from workbench.certificate import Certified, certified_length
    from workbench.checks import Limits, known_conventions, known_profile_readings, refuse_unsound
    from workbench.force_file import Forces, read_forces
    from workbench.result_files import (
        ChatterFile,
        CoefficientsFile,
        HandEyeFile,
        ModesFile,
        PostureFile,
        RobotFile,
        StiffnessFile,
        ToolFile,
        TurntableFile,
        result_file,
    )
    from workbench.robot import (
        SIDES,
        AngleConvention,
        Bodies,
        Cell,
        Chain,
        Clearance,
        CollisionModel,
        CollisionScreen,
        LoadingSetup,
        Shape,
        Side,
        Turntable,
        abb_angles,
        arm_sides,
        base_from_targets,
        cell_strokes,
        dexterity,
        external_at,
        forward_kinematics,
        inverse_kinematics,
        jacobian,
        jacobian_at,
        jacobian_derivative,
        joint_axes,
        motions,
        read_cell,
        refusal,
        refuse_contradiction,
        sliding,
        spherical_wrist,
        turn_about_z,
        turntable_at_home,
        turntable_pose,
        within_limits,
        within_margins,
    )

__all__ = [  # noqa: RUF022  (as Python sorts)
    "AngleConvention",
    "AnyArray",
    "Bodies",
    "Bool",
    "Cell",
    "Certified",
    "Chain",
    "ChatterFile",
    "Clearance",
    "CoefficientsFile",
    "CollisionModel",
    "CollisionScreen",
    "COVERAGE",
    "DEG",
    "Dialect",
    "FaceLines",
    "Float",
    "Float32",
    "Forces",
    "HandEyeFile",
    "InputError",
    "InputFile",
    "Int",
    "Language",
    "Limits",
    "LoadingSetup",
    "MillingTool",
    "ModesFile",
    "OutputError",
    "PipelineError",
    "PostureFile",
    "ProgramJob",
    "Progress",
    "RobotFile",
    "SIDES",
    "Seed",
    "Shape",
    "Shaped",
    "Side",
    "StiffnessFile",
    "TO_SD",
    "ToolFile",
    "Turntable",
    "TurntableFile",
    "WorkbenchError",
    "abb_angles",
    "arm_sides",
    "base_from_targets",
    "cell_strokes",
    "certified_length",
    "chords_mm",
    "csv_table",
    "dexterity",
    "estimator",
    "external_at",
    "finite_number",
    "forward_kinematics",
    "frame_about",
    "interpolate_poses",
    "inverse",
    "inverse_kinematics",
    "jacobian",
    "jacobian_at",
    "jacobian_derivative",
    "joint_axes",
    "kernel",
    "known_conventions",
    "known_profile_readings",
    "mapped",
    "motions",
    "nearest",
    "numbered_lines",
    "parsed",
    "pieces",
    "plot",
    "pose_from",
    "quaternion_from_rotation",
    "read_cell",
    "read_forces",
    "read_json",
    "read_text",
    "refusal",
    "refuse_contradiction",
    "refuse_unsound",
    "result_file",
    "rotation_from_quaternion",
    "rotation_from_rpy",
    "rotation_from_vector",
    "rpy_from_rotation",
    "sliding",
    "spherical_wrist",
    "stage",
    "strict_json",
    "turn_about_z",
    "turntable_at_home",
    "turntable_pose",
    "vector_from_rotation",
    "within_limits",
    "within_margins",
    "write_program",
]
__all__ += artefacts.__all__


def __getattr__(name: str) -> Any:
    """Import the robot cell's names and the models of result files on first use."""
    if name in __all__ and name.endswith(("File", "result_file")):
        from workbench import result_files

        return getattr(result_files, name)
    if name in ("Forces", "read_forces"):
        from workbench import force_file

        return getattr(force_file, name)
    if name in ("Certified", "certified_length"):
        from workbench import certificate

        return getattr(certificate, name)
    if name in ("Limits", "known_conventions", "known_profile_readings", "refuse_unsound"):
        from workbench import checks

        return getattr(checks, name)
    if name in __all__:
        from workbench import robot

        return getattr(robot, name)
    raise AttributeError(f"module 'workbench.api' has no attribute {name!r}")
