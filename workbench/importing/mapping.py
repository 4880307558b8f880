"""The mapping file (MAP.json): what a stranger's files do not say about themselves (docs/importing.md)."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field

from workbench.errors import InputError, PipelineError
from workbench.importing.bags_mapping import BagPart
from workbench.importing.part import Part
from workbench.parameters import check_parameters
from workbench.pipeline.document import parse_json
from workbench.scan.hdf5 import regular_file

MAX_BYTES = 1_000_000
LengthUnit = Literal["mm", "m", "um", "0.01um", "inch"]
TimeUnit = Literal["s", "ms", "us", "ns"]
LENGTH_MM: dict[str, float] = {"mm": 1.0, "m": 1000.0, "um": 1e-3, "0.01um": 1e-5, "inch": 25.4}
TIME_S: dict[str, float] = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
Column = Annotated[str, Field(min_length=1)] | Annotated[int, Field(ge=0)]  # a header's name, or a place from 0
Three = tuple[Column, Column, Column]


class TextPart(Part):
    """How a text file is written."""

    files: str | None = Field(default=None, description="file name pattern (*, ?) of the sources that this is about")
    delimiter: Literal[",", ";", "\t", " "] = Field(default=",", description="between the cells; ' ': any white space")
    decimal: Literal[".", ","] = Field(default=".", description="decimal mark")
    skip_lines: int = Field(default=0, ge=0, le=1000, description="lines before the header, or before the numbers")
    header: bool = Field(default=True, description="whether a line of column names stands above the numbers")
    length_unit: LengthUnit = Field(description="of every length in the file")
    time_unit: TimeUnit = Field(default="s", description="of every time in the file")


class ProfileColumns(Part):
    """Which column of a table holds what: one row a point."""

    x: Column = Field(description="lateral coordinate")
    z: Column = Field(description="range")
    intensity: Column | None = None
    frame: Column | None = Field(default=None, description="a number that changes from frame to frame")
    time: Column | None = Field(default=None, description="the frame's time, the same in all its rows")
    travel: Column | None = Field(default=None, description="way along the scan (encoder), the same in all its rows")


class ProfilesPart(TextPart):
    """A table of profile points."""

    columns: ProfileColumns
    frames: Literal["column", "blank_lines", "one"] = Field(
        default="column", description="what tells frames apart: columns.frame, blank lines, or one frame a file"
    )
    missing: list[float] = Field(default=[], description="values of z or x that mean no return, besides an empty cell")


class RawPart(Part):
    """A Keyence file of raw uint16 heights: z = (v - 32768) z_unit / 100, x = (x_start + i x_pitch) / 100, micrometres."""

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
    orientation: Annotated[list[Column], Field(min_length=3, max_length=4)]
    convention: str = Field(description="what the orientation's columns are: see docs/importing.md")
    angle_unit: Literal["deg", "rad"] | None = Field(default=None, description="needed by Euler and rotation vectors")
    time: Column | None = None
    pass_column: Column | None = Field(default=None, alias="pass", description="scanning pass")


class TimesPart(Part):
    """When each frame was taken, and on whose clock."""

    source: Literal["file", "rate", "travel", "pose_each"] = Field(
        description="the file's times; a frame rate; way along the scan against the flange's; one pose a frame"
    )
    rate_hz: float | None = Field(default=None, gt=0, description="frames a second, for 'rate'")
    start_s: float | None = Field(default=None, description="time of each pass's first frame on the robot's clock")
    start_mm: float = Field(default=0.0, description="travel at the pass's first pose, for 'travel'")
    pitch_mm: float | None = Field(default=None, gt=0, description="travel from frame to frame where the file has none")
    clock_offset_s: float = Field(default=0.0, description="profile time = robot time + offset")
    outside: Literal["refuse", "trim"] = Field(default="refuse", description="frames outside the poses' times")


class LinearAxisPart(Part):
    """No robot: the profiler, or the part, went along a straight axis."""

    direction: tuple[float, float, float] = Field(description="of the profiler's motion, in the profiler frame")
    speed_mm_s: float = Field(gt=0)


class HandEyePart(Part):
    """Pose of the profiler on the flange."""

    flange_from_profiler: list[list[float]] | None = None
    file: str | None = Field(default=None, description="a handeye.json, relative to the mapping file")


class Mapping(Part):
    """The whole mapping file."""

    format: Literal["import-mapping"] = "import-mapping"
    version: Literal[1] = 1
    part_id: str | None = None
    sensor: str | None = None
    robot: str | None = None
    profiles: ProfilesPart | None = None
    keyence_raw: RawPart | None = None
    poses: PosesPart | None = None
    times: TimesPart | None = None
    linear_axis: LinearAxisPart | None = None
    hand_eye: HandEyePart | None = None
    bag: BagPart | None = None
    base_dir: Path = Field(default=Path(), exclude=True, description="where its relative paths start")


def read_mapping(path: Path) -> Mapping:
    """Read MAP.json. Raises InputError with its JSON path, what was expected and the nearest known name."""
    if regular_file(path).st_size > MAX_BYTES:
        raise InputError(str(path), f"expected a mapping file of at most {MAX_BYTES} bytes")
    tree = parse_json(path.read_bytes(), str(path))
    if not isinstance(tree, dict):
        raise InputError(str(path), "expected an object")
    try:
        return Mapping(**check_parameters(Mapping, tree, f"{path}: $")).model_copy(update={"base_dir": path.parent})
    except PipelineError as error:
        raise InputError(error.where, error.expected) from None
