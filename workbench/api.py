"""All that a plug-in imports: the stage decorator, its special parameters, artefacts, errors, poses, array types.

A plug-in is a distribution with an entry point in the group `workbench.stages`: the name is its family, the value the
module that defines its stages (docs/pipelines.md).
"""

from typing import TYPE_CHECKING, Any

from workbench.artefacts import (
    Chapter,
    Cloud,
    Cutter,
    Document,
    Edge,
    EdgeFrames,
    EdgeProfile,
    Engagement,
    Gate,
    HandEye,
    Inspection,
    Layer,
    LayerEngagement,
    Moves,
    Postures,
    Provenance,
    Recording,
    Requirements,
    Rework,
    Section,
    Stretch,
    Toolpath,
    Travel,
    Verdict,
    frozen,
)
from workbench.dialect import Dialect, MillingTool, ProgramJob, write_program
from workbench.errors import InputError, OutputError, PipelineError, WorkbenchError
from workbench.geometry.faces import FaceLines
from workbench.geometry.poses import (
    interpolate_poses,
    inverse,
    pose_from,
    quaternion_from_rotation,
    rotation_from_quaternion,
    rotation_from_rpy,
    rotation_from_vector,
    rpy_from_rotation,
    vector_from_rotation,
)
from workbench.stage import InputFile, Progress, Seed, stage
from workbench.units import DEG, AnyArray, Bool, Float, Float32, Int

if TYPE_CHECKING:  # the cell's libraries are heavy: they are loaded on first use
    from workbench.robot import (
        AngleConvention,
        BoundingVolumes,
        Cell,
        Chain,
        Clearance,
        CollisionModel,
        CollisionScreen,
        LoadingSetup,
        Turntable,
        abb_angles,
        bounding_volumes,
        clearance_bound_mm,
        forward_kinematics,
        inverse_kinematics,
        jacobian,
        jacobian_at,
        jacobian_derivative,
        joint_axes,
        read_cell,
        read_json,
        spherical_wrist,
        turntable_pose,
        within_limits,
    )

__all__ = [  # noqa: RUF022  (as Python sorts)
    "AngleConvention",
    "AnyArray",
    "Bool",
    "BoundingVolumes",
    "Cell",
    "Chain",
    "Chapter",
    "Clearance",
    "Cloud",
    "CollisionModel",
    "CollisionScreen",
    "Cutter",
    "DEG",
    "Dialect",
    "Document",
    "Edge",
    "EdgeFrames",
    "EdgeProfile",
    "Engagement",
    "FaceLines",
    "Float",
    "Float32",
    "Gate",
    "HandEye",
    "InputError",
    "InputFile",
    "Inspection",
    "Int",
    "Layer",
    "LayerEngagement",
    "LoadingSetup",
    "MillingTool",
    "Moves",
    "OutputError",
    "PipelineError",
    "Postures",
    "ProgramJob",
    "Progress",
    "Provenance",
    "Recording",
    "Requirements",
    "Rework",
    "Section",
    "Seed",
    "Stretch",
    "Toolpath",
    "Travel",
    "Turntable",
    "Verdict",
    "WorkbenchError",
    "abb_angles",
    "bounding_volumes",
    "clearance_bound_mm",
    "forward_kinematics",
    "frozen",
    "interpolate_poses",
    "inverse",
    "inverse_kinematics",
    "jacobian",
    "jacobian_at",
    "jacobian_derivative",
    "joint_axes",
    "pose_from",
    "quaternion_from_rotation",
    "read_cell",
    "read_json",
    "rotation_from_quaternion",
    "rotation_from_rpy",
    "rotation_from_vector",
    "rpy_from_rotation",
    "spherical_wrist",
    "stage",
    "turntable_pose",
    "vector_from_rotation",
    "within_limits",
    "write_program",
]


def __getattr__(name: str) -> Any:
    """Import the robot cell's names on first use."""
    if name in __all__:
        from workbench import robot

        return getattr(robot, name)
    raise AttributeError(f"module 'workbench.api' has no attribute {name!r}")
