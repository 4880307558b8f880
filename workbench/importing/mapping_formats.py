"""What a mapping file may say about height maps, arrays, joints and stamps."""

from __future__ import annotations

from typing import Annotated, Literal, Protocol

from pydantic import Field, model_validator

from workbench.importing.mapping_tables import Column, LengthUnit, TextPart, Three, TimeUnit
from workbench.importing.part import Part


class HeightMapPart(Part):
    """An image of heights, TIFF or PNG: a row a profile."""

    files: str | None = Field(default=None, description="file name pattern (*, ?) of the sources that this is about")
    length_unit: LengthUnit = Field(default="mm", description="of the pitches, of z_scale and z_offset")
    x_pitch: float = Field(description="from column to column")
    y_pitch: float = Field(description="from row to row: the way along the scan")
    z_scale: float = Field(default=1.0, description="length a count; 1 where the image holds lengths")
    z_offset: float = Field(default=0.0, description="z of the value 0")
    missing: list[float] = Field(default=[0.0], description="values of the image that mean no return, besides NaN")

    @model_validator(mode="after")
    def _steps(self) -> HeightMapPart:
        for name in ("x_pitch", "y_pitch", "z_scale"):
            if not getattr(self, name):
                raise ValueError(f"expected {name} other than 0")
        return self


class Robot(Protocol):
    """A part that names the robot whose joints it tells."""

    urdf: str | None
    base_frame: str | None
    flange_frame: str | None


def check_robot(part: Robot) -> None:
    """Refuse (ValueError) a robot that is told in part only."""
    if len({name is None for name in (part.urdf, part.base_frame, part.flange_frame)}) > 1:
        raise ValueError("expected urdf, base_frame and flange_frame together")


class ArraysPart(Part):
    """Arrays of a .npz or .mat file by name, where their own names do not tell what they are."""

    files: str | None = Field(default=None, description="file name pattern (*, ?) of the sources that this is about")
    length_unit: LengthUnit = Field(default="mm", description="of every length in the file")
    time_unit: TimeUnit = Field(default="s", description="of every time in the file")
    x: str | None = Field(default=None, description="(N, M) or (M,) lateral coordinates")
    z: str | None = Field(default=None, description="(N, M) ranges; NaN: no return")
    intensity: str | None = Field(default=None, description="(N, M) whole numbers from 0 to 65535")
    time: str | None = Field(default=None, description="(N,) of the frames")
    travel: str | None = Field(default=None, description="(N,) way along the scan")
    position: str | None = Field(default=None, description="(K, 3) of the flange in the base")
    quaternion_wxyz: str | None = Field(default=None, description="(K, 4) of the flange in the base")
    base_from_flange: str | None = Field(default=None, description="(K, 4, 4) instead of position and quaternion")
    pose_time: str | None = Field(default=None, description="(K,) of the poses")
    joints: str | None = Field(default=None, description="(K, n) instead of poses, in the URDF's order")
    angle_unit: Literal["deg", "rad"] | None = Field(default=None, description="of the joints")
    urdf: str | None = Field(default=None, description="the robot's URDF, relative to the mapping file")
    base_frame: str | None = Field(default=None, description="link of the URDF that is the base")
    flange_frame: str | None = Field(default=None, description="link of the URDF that is the flange")
    missing: list[float] = Field(default=[], description="values of z that mean no return, besides NaN")

    @model_validator(mode="after")
    def _whole_robot(self) -> ArraysPart:
        check_robot(self)
        if self.joints is not None and self.angle_unit is None:
            raise ValueError("expected angle_unit with joints")
        return self


class JointsPart(TextPart):
    """A table of joint positions: the flange's poses follow from the robot's URDF, where a recording needs them."""

    length_unit: LengthUnit = Field(default="mm", description="of linear joints")
    columns: Annotated[list[Column], Field(min_length=1, max_length=12)] = Field(
        description="of the joints between base and flange, in the URDF's order"
    )
    angle_unit: Literal["deg", "rad"] = Field(description="of the joints")
    time: Column | None = Field(default=None, description="on the robot's clock")
    number: Column | None = Field(default=None, description="number of the posture")
    urdf: str | None = Field(default=None, description="the robot's URDF, relative to the mapping file")
    base_frame: str | None = Field(default=None, description="link of the URDF that is the base")
    flange_frame: str | None = Field(default=None, description="link of the URDF that is the flange")

    @model_validator(mode="after")
    def _timed(self) -> JointsPart:
        if (self.time is None) != (self.time_unit is None):
            raise ValueError("expected time_unit with time and only there")
        check_robot(self)
        return self


class TrackerPart(TextPart):
    """Readings of a laser tracker, to be joined with the robot's joints or poses; no part of a recording."""

    length_unit: LengthUnit = Field(default="mm", description="of the places")
    targets: Annotated[list[Three], Field(min_length=1, max_length=50)] | None = Field(
        default=None, description="columns of x, y, z of each target, where a row is a posture of the robot"
    )
    number: Column | None = Field(default=None, description="number of the posture; default: the row")
    time: Column | None = Field(default=None, description="on the tracker's clock")
    pair: Literal["number", "time", "order"] | None = Field(
        default=None, description="how readings and postures go together; null: the first of these that both tell"
    )
    within_s: float = Field(default=0.5, gt=0, description="most from a reading to its posture, for 'time'")

    @model_validator(mode="after")
    def _of_a_table(self) -> TrackerPart:
        if self.targets is None and (self.number is not None or self.time is not None):
            raise ValueError("expected number and time with targets only: other forms tell them")
        if (self.time is None) != (self.time_unit is None):
            raise ValueError("expected time_unit with time and only there")
        return self


class StampsPart(TextPart):
    """Times in a file of their own: a row a frame, or a row a pose."""

    files: str = Field(description="file name pattern (*, ?) of the sources that this is about")
    length_unit: LengthUnit = Field(default="mm", description="not used")
    column: Column = Field(default=0, description="of the times")
    time_unit: TimeUnit = Field(description="of the times")
    of: Literal["profiles", "poses"] = Field(description="whose times they are")
