"""What a mapping file may say about tables: how the text is written, what its columns are, and in which units."""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from pydantic import Field, model_validator

from workbench.errors import nearest
from workbench.geometry.orientations import CONVENTIONS, USUAL_ANGLE_UNIT, components
from workbench.geometry.poses import is_rigid
from workbench.importing.part import Part

LengthUnit = Literal["mm", "m", "um", "0.01um", "inch"]
TimeUnit = Literal["s", "ms", "us", "ns"]
LENGTH_MM: dict[str, float] = {"mm": 1.0, "m": 1000.0, "um": 1e-3, "0.01um": 1e-5, "inch": 25.4}
TIME_S: dict[str, float] = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
Column = Annotated[str, Field(min_length=1)] | Annotated[int, Field(ge=0)]  # a header's name, or a place from 0
Matrix = Annotated[list[Annotated[list[float], Field(min_length=4, max_length=4)]], Field(min_length=4, max_length=4)]
Three = tuple[Column, Column, Column]


class TextPart(Part):
    """How a text file is written."""

    files: str | None = Field(default=None, description="file name pattern (*, ?) of the sources that this is about")
    delimiter: Literal[",", ";", "\t", " "] = Field(default=",", description="between the cells; ' ': any white space")
    decimal: Literal[".", ","] = Field(default=".", description="decimal mark")
    skip_lines: int = Field(default=0, ge=0, le=1000, description="lines before the header, or before the numbers")
    header: bool = Field(default=True, description="whether a line of column names stands above the numbers")
    length_unit: LengthUnit = Field(description="of every length in the file")
    time_unit: TimeUnit | None = Field(default=None, description="of every time in the file, where it has any")

    @model_validator(mode="after")
    def _told_apart(self) -> TextPart:
        if self.delimiter == self.decimal:
            raise ValueError("expected a delimiter that is not the decimal mark")
        return self


class ProfileColumns(Part):
    """Which column of a table holds what: one row a point."""

    x: Column = Field(description="lateral coordinate")
    z: Column = Field(description="range")
    intensity: Column | None = Field(default=None, description="0 to 65535, whole numbers")
    frame: Column | None = Field(default=None, description="a number that changes from frame to frame")
    time: Column | None = Field(default=None, description="the frame's time, the same in all its rows")
    travel: Column | None = Field(default=None, description="way along the scan (encoder), the same in all its rows")


class ProfilesPart(TextPart):
    """A table of profile points, one row a point; or of ranges, one row a frame."""

    frames: Literal["column", "blank_lines", "restart", "one", "rows"] = Field(
        description="what tells frames apart: columns.frame, blank lines, x that starts anew, one frame a file, "
        "a frame a row of ranges"
    )
    columns: ProfileColumns | None = Field(default=None, description="for a row a point")
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


class RawPart(Part):
    """A Keyence file of raw uint16 heights, 0 = no return.

    z = (v - 32768) z_unit / 100 and x = (x_start + i x_pitch) / 100, in micrometres.
    """

    files: str = Field(description="file name pattern (*, ?) of the sources that this is about")
    columns: int = Field(ge=2, le=10_000, description="points a profile")
    x_start: int = Field(description="XStart of the profile information")
    x_pitch: int = Field(description="XPitch of the profile information")
    z_unit: int = Field(gt=0, le=65_535, description="ZUnit as the controller gives it")
    luminance: bool = Field(default=False, description="whether luminance of all profiles follows their heights")
    byte_order: Literal["little", "big"] = "little"


class PosesPart(TextPart):
    """A table of flange poses: one row a pose."""

    position: Three = Field(description="columns of x, y, z of the flange in the base")
    orientation: Annotated[list[Column], Field(min_length=3, max_length=4)] = Field(
        description="columns of the orientation, in the convention's own order"
    )
    convention: str = Field(description="what the orientation's columns are")
    angle_unit: Literal["deg", "rad"] | None = Field(default=None, description="of Euler angles and rotation vectors")
    time: Column | None = Field(default=None, description="on the robot's clock")
    scan_pass: Column | None = Field(default=None, description="number of the scanning pass")
    flange_from_tool: Matrix | None = Field(default=None, description="4x4: the poses are a tool's, not the flange's")
    base_from_frame: Matrix | None = Field(default=None, description="4x4: the poses are in a frame, not in the base")

    @model_validator(mode="after")
    def _complete(self) -> PosesPart:
        check_convention(self.convention, len(self.orientation), self.angle_unit, "orientation columns")
        for name in ("flange_from_tool", "base_from_frame"):
            pose = getattr(self, name)
            if pose is not None and not is_rigid(np.array(pose)):
                raise ValueError(f"expected {name} as a rigid motion: orthonormal to 1e-6, determinant +1, mm")
        if (self.time is None) != (self.time_unit is None):
            raise ValueError("expected time_unit with time and only there")
        return self


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
