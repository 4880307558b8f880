"""What a mapping file may say about a bag: topics, frames, clock."""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from pydantic import AfterValidator, Field

from workbench.geometry.poses import is_rigid
from workbench.importing.mapping_tables import Matrix
from workbench.importing.part import Part

Axis = Literal["x", "-x", "y", "-y", "z", "-z"]
NoReturn = Literal["nan", "zero", "inf"]
LENGTH_MM = {"m": 1e3, "mm": 1.0}


def _rigid(pose: Matrix) -> Matrix:
    if not is_rigid(np.array(pose)):
        raise ValueError("expected a rigid motion: orthonormal to 1e-6, determinant +1, mm")
    return pose


RigidMotion = Annotated[Matrix, AfterValidator(_rigid)]


class BagPart(Part):
    """Object `bag` of a mapping file (MCAP, rosbag2, rosbag1); optional where the bag leaves no doubt."""

    profiles: list[str] | None = Field(
        default=None, min_length=1, description="topics of the profiles; several: one scanning pass each, in this order"
    )
    poses: str | None = Field(default=None, description="topic of the poses; 'tf': /tf and /tf_static together")
    time: Literal["header", "message"] = Field(
        default="header", description="the header's stamp, or when the message was recorded"
    )
    length_unit: Literal["m", "mm"] = Field(default="m", description="of profiles; REP 103 says m")
    pose_length_unit: Literal["m", "mm"] = Field(default="m", description="of poses; REP 103 says m")
    lateral: Axis | None = Field(default=None, description="axis that is x of the profiler; PointCloud2 x, LaserScan y")
    range: Axis | None = Field(default=None, description="axis that is z of the profiler; PointCloud2 z, LaserScan x")
    no_return: list[NoReturn] | None = Field(
        default=None, description="points that mean no return, besides NaN: all coordinates 0, an infinite one"
    )
    ragged: Literal["spacing", "count"] = Field(
        default="spacing", description="columns of profiles with fewer points: by gaps in x, or simply counted from 0"
    )
    row_period_s: float | None = Field(
        default=None, gt=0, description="time from row to row of a cloud of several rows; its time is the first row's"
    )
    pass_gap_s: float | None = Field(default=None, gt=0, description="a longer time without profile begins a new pass")
    base_frame: str | None = Field(default=None, description="the robot's base, in /tf or the URDF")
    flange_frame: str | None = Field(default=None, description="the mounting flange, in /tf or the URDF")
    profiler_frame: str | None = Field(
        default=None, description="the profiles' frame, fixed to the flange in /tf: the hand-eye pose"
    )
    flange_from_tool: RigidMotion | None = Field(default=None, description="4x4: the poses are a tool's")
    base_from_frame: RigidMotion | None = Field(default=None, description="4x4: the poses are in a frame, not the base")
    urdf: str | None = Field(default=None, description="the robot's URDF for JointState, relative to the mapping file")
