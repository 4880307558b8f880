"""What a mapping file may say of tables, arrays and joints: known keys, finite numbers."""

from __future__ import annotations

from collections.abc import Mapping
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Annotated, Literal, Self

import numpy as np
from pydantic import AfterValidator, BaseModel, ConfigDict, Field, model_validator

from workbench.errors import nearest
from workbench.geometry.poses import CONVENTIONS, USUAL_ANGLE_UNIT, components, is_rigid


class Part(BaseModel):
    """An object of the mapping file."""

    model_config = ConfigDict(strict=True, extra="forbid", allow_inf_nan=False, frozen=True)


LengthUnit = Literal["mm", "m", "um", "0.01um", "inch"]
TimeUnit = Literal["s", "ms", "us", "ns"]
LENGTH_MM: dict[str, float] = {"mm": 1.0, "m": 1000.0, "um": 1e-3, "inch": 25.4, "0.01um": 1e-5}
TIME_S: dict[str, float] = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
UNITS = {unit: unit for unit in ("mm", "m", "um", "inch", "s", "ms", "us", "ns", "deg", "rad")} | {
    **{"µm": "um", "μm": "um", "in": "inch", "sec": "s", "µs": "us", "°": "deg"},
}
Column = Annotated[str, Field(min_length=1)] | Annotated[int, Field(ge=0)]  # a header's name, or a place from 0
Matrix = Annotated[list[Annotated[list[float], Field(min_length=4, max_length=4)]], Field(min_length=4, max_length=4)]
Three = tuple[Column, Column, Column]


def _rigid(pose: Matrix) -> Matrix:
    if not is_rigid(np.array(pose)):
        raise ValueError("expected a rigid motion: orthonormal to 1e-6, determinant +1, mm")
    return pose


RigidMotion = Annotated[Matrix, AfterValidator(_rigid)]


class FramesPart(Part):
    """Whose poses they are, and in which frame."""

    flange_from_tool: RigidMotion | None = Field(default=None, description="4x4 of the poses' tool; null: the flange")
    base_from_frame: RigidMotion | None = Field(default=None, description="4x4 of the poses' frame; null: the base")


class FilesPart(Part):
    """What may be about some of the sources alone."""

    files: str | None = Field(default=None, description="file name pattern (*, ?) of the sources that this is about")

    def claims(self, path: Path) -> bool:
        """Whether it names the file by its pattern."""
        return self.files is not None and fnmatchcase(path.name, self.files)


class TextPart(FilesPart):
    """How a text file is written."""

    delimiter: Literal[",", ";", "\t", " "] = Field(default=",", description="between the cells; ' ': any white space")
    decimal: Literal[".", ","] = Field(default=".", description="decimal mark")
    skip_lines: int = Field(default=0, ge=0, le=1000, description="lines before the header, or before the numbers")
    header: bool = Field(default=True, description="whether a line of column names stands above the numbers")
    length_unit: LengthUnit = Field(description="of every length in the file")
    time_unit: TimeUnit | None = Field(default=None, description="of every time in the file, where it has any")

    @model_validator(mode="after")
    def _distinct_marks(self) -> TextPart:
        if self.delimiter == self.decimal:
            raise ValueError("expected a delimiter that is not the decimal mark")
        return self

    @property
    def wanted(self) -> dict[str, Column]:
        """The columns by role; of a table without, a row is a frame of ranges."""
        return {}


# They tell rows apart, and may be read off a column that stands for something else too.
MARKS = ("frame", "index", "valid", "scan_pass", "number", "pose_time")


def named_twice(found: Mapping[str, object]) -> str:
    """What to say where two roles, none of them a mark, have one column or array; '' where none do."""
    taken: dict[object, str] = {}
    for role, what in found.items():
        if role not in MARKS and taken.setdefault(what, role) != role:
            return f"expected two columns or arrays for '{taken[what]}' and '{role}', the mapping names one for both"
    return ""


class TimedPart(TextPart):
    """A table that may tell times."""

    time: Column | None = Field(default=None, description="on the robot's clock, or the tracker's")

    @model_validator(mode="after")
    def _timed(self) -> Self:
        if (self.time is None) != (self.time_unit is None):
            raise ValueError("expected time_unit with time and only there")
        return self

    def _with_time(self, columns: dict[str, Column], **optional: Column | None) -> dict[str, Column]:
        """Columns by role, and of the others those that are named."""
        return columns | {role: one for role, one in {"time": self.time, **optional}.items() if one is not None}


class ProfileColumns(Part):
    """Which column of a table holds what: one row per point."""

    x: Column = Field(description="lateral coordinate")
    z: Column = Field(description="range")
    intensity: Column | None = Field(default=None, description="0 to 65535, whole numbers")
    frame: Column | None = Field(default=None, description="a number that changes from frame to frame")
    time: Column | None = Field(default=None, description="the frame's time, the same in all its rows")
    travel: Column | None = Field(default=None, description="way along the scan (encoder), the same in all its rows")
    valid: Column | None = Field(default=None, description="0 where the point means no return")
    index: Column | None = Field(default=None, description="a number that rises within a frame")
    scan_pass: Column | None = Field(default=None, description="number of the scanning pass, as in the table of poses")


class ProfilesPart(TextPart):
    """A table of profile points, one row per point; or of ranges, one row per frame."""

    frames: Literal["column", "blank_lines", "restart", "one", "rows"] = Field(
        description="how frames are separated: columns.frame, blank lines, x that starts anew, one frame per file, "
        "one frame per row of ranges"
    )
    columns: ProfileColumns | None = Field(default=None, description="for one row per point")
    x_first: float | None = Field(default=None, description="x of the first range in a row, for 'rows'")
    x_pitch: float | None = Field(default=None, description="x from one range to the next, for 'rows'")
    missing: list[float] = Field(default=[], description="values of x or z that mean no return, besides an empty cell")
    ragged: Literal["spacing", "count"] = Field(
        default="spacing", description="columns of frames with fewer points: by gaps in x, or simply counted from 0"
    )

    @model_validator(mode="after")
    def _whole(self) -> ProfilesPart:
        if self.frames == "rows":
            if self.x_first is None or not self.x_pitch or self.columns is not None:
                raise ValueError("expected x_first, x_pitch (not 0) and no columns with frames 'rows'")
        elif self.columns is None or self.x_first is not None or self.x_pitch is not None:
            raise ValueError(f"expected columns, no x_first and no x_pitch with frames '{self.frames}'")
        if self.columns is None:
            if self.time_unit is not None:
                raise ValueError("expected no time_unit with frames 'rows'")
            return self
        if (self.columns.frame is not None) != (self.frames == "column"):
            raise ValueError("expected columns.frame with frames 'column' and only there")
        if (self.columns.time is not None) != (self.time_unit is not None):
            raise ValueError("expected time_unit with columns.time and only there")
        return self

    @property
    def wanted(self) -> dict[str, Column]:
        return self.columns.model_dump(exclude_none=True) if self.columns else {}


class PosesPart(TimedPart, FramesPart):
    """A table of flange poses: one row a pose."""

    position: Three = Field(description="columns of x, y, z of the flange in the base")
    orientation: Annotated[list[Column], Field(min_length=3, max_length=4)] = Field(
        description="columns of the orientation, in the convention's own order"
    )
    convention: str = Field(description="what the orientation's columns are")
    angle_unit: Literal["deg", "rad"] | None = Field(default=None, description="of Euler angles and rotation vectors")
    scan_pass: Column | None = Field(default=None, description="number of the scanning pass")

    @model_validator(mode="after")
    def _complete(self) -> PosesPart:
        check_convention(self.convention, len(self.orientation), self.angle_unit, "orientation columns")
        return self

    @property
    def wanted(self) -> dict[str, Column]:
        columns = {f"position {i}": column for i, column in enumerate(self.position)}
        turn = {f"orientation {i}": column for i, column in enumerate(self.orientation)}
        return self._with_time(columns | turn, scan_pass=self.scan_pass)


def check_convention(convention: str, count: int, angle_unit: str | None, what: str) -> None:
    """Refuse (ValueError) an unknown convention, another count of numbers than it has, an angle unit out of place."""
    if convention not in CONVENTIONS:
        raise ValueError(f"unknown convention '{convention}'{nearest(convention, CONVENTIONS)}")
    expected = components(convention)
    if count != expected:
        raise ValueError(f"expected {expected} {what} for {convention}, got {count}")
    if expected == 4 and angle_unit is not None:
        raise ValueError(f"expected no angle_unit for {convention}")
    if expected == 3 and angle_unit is None and convention not in USUAL_ANGLE_UNIT:
        raise ValueError(f"expected angle_unit for {convention}")


class ArraysPart(FilesPart):
    """Arrays of a .npz file by name, where their own names do not tell what they are."""

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
    missing: list[float] = Field(default=[], description="values of z that mean no return, besides NaN")


class ProgramPart(FilesPart, FramesPart):
    """A robot's program of which the taught positions are the poses: what its tool and its frame are."""

    files: str = Field(description="file name pattern (*, ?) of the sources that this is about")


class JointsPart(TimedPart):
    """A table of joint positions: the flange's poses follow from the robot's URDF, where a recording needs them."""

    length_unit: LengthUnit = Field(default="mm", description="of linear joints")
    columns: Annotated[list[Column], Field(min_length=1, max_length=12)] = Field(
        description="of the joints between base and flange, in the URDF's order"
    )
    angle_unit: Literal["deg", "rad"] = Field(description="of the joints")
    number: Column | None = Field(default=None, description="number of the posture")
    urdf: str | None = Field(default=None, description="the robot's URDF, relative to the mapping file")
    base_frame: str | None = Field(default=None, description="link of the URDF that is the base")
    flange_frame: str | None = Field(default=None, description="link of the URDF that is the flange")

    @model_validator(mode="after")
    def _whole_robot(self) -> Self:
        if len({name is None for name in (self.urdf, self.base_frame, self.flange_frame)}) > 1:
            raise ValueError("expected urdf, base_frame and flange_frame together")
        return self

    @property
    def wanted(self) -> dict[str, Column]:
        return self._with_time({f"joint {k}": one for k, one in enumerate(self.columns)}, number=self.number)


class TrackerPart(TimedPart):
    """Readings of a laser tracker, to be joined with the robot's joints or poses; no part of a recording."""

    length_unit: LengthUnit = Field(default="mm", description="of the places")
    targets: Annotated[list[Three], Field(min_length=1, max_length=50)] | None = Field(
        default=None, description="columns of x, y, z of each target, where a row is a posture of the robot"
    )
    number: Column | None = Field(default=None, description="number of the posture; default: the row")
    pair: Literal["number", "time", "order"] = Field(
        default="number", description="how readings and postures go together"
    )
    within_s: float = Field(default=0.5, gt=0, description="most from a reading to its posture, for 'time'")

    @model_validator(mode="after")
    def _of_a_table(self) -> TrackerPart:
        if self.targets is None and (self.number is not None or self.time is not None):
            raise ValueError("expected number and time with targets only: other forms state them")
        return self

    @property
    def wanted(self) -> dict[str, Column]:
        targets = enumerate(self.targets or ())
        places = {f"{k} {axis}": one for k, three in targets for axis, one in zip("xyz", three, strict=True)}
        return self._with_time(places, number=self.number)
