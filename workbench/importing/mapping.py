"""The mapping file (MAP.json): what a stranger's files do not say about themselves (docs/importing.md)."""

from __future__ import annotations

import json
import re
from dataclasses import fields
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import Field, PrivateAttr, ValidationError, model_validator

from workbench.artefacts import PartNames
from workbench.errors import InputError
from workbench.geometry.poses import (
    USUAL_ANGLE_UNIT,
    components,
    pose_from,
    quaternions,
    rotation_from_quaternion,
)
from workbench.importing.mapping_parts import (
    LENGTH_MM,
    ArraysPart,
    FilesPart,
    JointsPart,
    LengthUnit,
    Part,
    PosesPart,
    ProfilesPart,
    ProgramPart,
    RigidMotion,
    TrackerPart,
    check_convention,
)
from workbench.parameters import Place, path_of, problems
from workbench.scan.checks import UNIT_TOLERANCE
from workbench.strict_json import read_json
from workbench.units import DEG, Float

MAX_BYTES = 1_000_000
READERS = {  # parts of the mapping about files, and the modules of workbench.importing that read them
    "profiles": "tables",
    "poses": "poses",
    "arrays": "arrays",
    "joints": "joints",
    "tracker": "tracker",
    "program": "programs",
}
Suspicion = Literal["length_unit", "angle_unit", "time_unit", "still", "direction"]


class TimesPart(Part):
    """When each frame was taken, and on whose clock."""

    source: Literal["file", "rate", "travel", "pose_each"] = Field(
        description="the file's times; a frame rate; way along the scan against the flange's; one pose per frame"
    )
    rate_hz: float | None = Field(default=None, gt=0, description="frames a second, for 'rate'")
    start_s: float | Literal["first_pose"] | None = Field(
        default=None, description="robot's time at each pass's first frame, for 'rate'"
    )
    start_mm: float | None = Field(default=None, description="travel reading at each pass's first pose, for 'travel'")
    pitch_mm: float | None = Field(default=None, gt=0, description="travel from frame to frame where the file has none")
    clock_offset_s: float = Field(default=0.0, description="profile time = robot time + offset, for 'file'")

    @model_validator(mode="after")
    def _complete(self) -> TimesPart:
        needed = {"rate": ("rate_hz", "start_s"), "travel": ("start_mm",)}.get(self.source, ())
        for name in needed:
            if getattr(self, name) is None:
                raise ValueError(f"expected {name} with source '{self.source}'")
        if self.clock_offset_s and self.source != "file":
            raise ValueError("expected clock_offset_s with source 'file' only")
        return self


class LinearAxisPart(Part):
    """No robot: the profiler, or the part, went along a straight axis."""

    direction: tuple[float, float, float] = Field(
        default=(0.0, 1.0, 0.0), description="of the profiler's motion, in the profiler frame"
    )
    speed_mm_s: float | None = Field(
        default=None, gt=0, description="of the axis; times follow from it. null: a mm counts as a second"
    )

    @model_validator(mode="after")
    def _somewhere(self) -> LinearAxisPart:
        if not any(self.direction):
            raise ValueError("expected a direction, found 0, 0, 0")
        return self


class HandEyePart(Part):
    """Pose of the profiler on the flange: a matrix, a file, or six or seven numbers as a teach pendant shows them."""

    flange_from_profiler: RigidMotion | None = Field(default=None, description="4x4, row-major, translation in mm")
    file: str | None = Field(default=None, description="a handeye.json, relative to the mapping file")
    position: tuple[float, float, float] | None = Field(default=None, description="X, Y, Z of the profiler's origin")
    length_unit: LengthUnit = Field(default="mm", description="of position")
    orientation: Annotated[list[float], Field(min_length=3, max_length=4)] | None = Field(
        default=None, description="the convention's numbers, in its own order"
    )
    convention: str | None = Field(default=None, description="what the numbers of orientation are")
    angle_unit: Literal["deg", "rad"] | None = Field(default=None, description="of Euler angles, rotation vectors")

    @model_validator(mode="after")
    def _one(self) -> HandEyePart:
        if sum(way is not None for way in (self.flange_from_profiler, self.file, self.position)) != 1:
            raise ValueError("expected one of flange_from_profiler, file, position (with orientation and convention)")
        given = (self.orientation is not None, self.convention is not None)
        if given != (self.position is not None,) * 2:
            raise ValueError("expected position, orientation and convention together")
        if self.orientation is not None and self.convention is not None:
            _check_turn(self.orientation, self.convention, self.angle_unit)
        return self

    def pose(self) -> Float:
        """`flange_from_profiler` (4, 4) of what stands in the mapping itself."""
        if self.flange_from_profiler is not None:
            return np.array(self.flange_from_profiler, float)
        assert self.position is not None
        assert self.orientation is not None
        assert self.convention is not None
        values = np.array([self.orientation], float)
        if components(self.convention) == 3:
            values *= DEG if (self.angle_unit or USUAL_ANGLE_UNIT[self.convention]) == "deg" else 1.0
        quaternion = quaternions(values, self.convention)[0]
        quaternion /= np.linalg.norm(quaternion)
        return pose_from(rotation_from_quaternion(quaternion), np.array(self.position) * LENGTH_MM[self.length_unit])


def _check_turn(values: list[float], convention: str, angle_unit: str | None) -> None:
    """Refuse numbers that are no orientation in the convention."""
    check_convention(convention, len(values), angle_unit, "numbers")
    if components(convention) == 4:
        norm = float(np.linalg.norm(values))
        if abs(norm - 1.0) > UNIT_TOLERANCE:
            raise ValueError(f"expected a quaternion of norm 1, found {norm:.4g}")
        return
    largest, unit = max(map(abs, values)), angle_unit or USUAL_ANGLE_UNIT[convention]
    if unit == "rad" and largest > 2 * np.pi + 1e-3:
        raise ValueError(f"an angle of {largest:g} rad is more than a turn: degrees declared as rad?")


class Mapping(Part):
    """The whole mapping file."""

    format: Literal["import-mapping"] = Field(description="says what this file is")
    version: Literal[1]
    part_id: str | None = Field(default=None, description="name of the part, for reports")
    drawing: str | None = Field(default=None, description="and its issue, for the certificate")
    operator: str | None = Field(default=None, description="who recorded it")
    recorded_at: str | None = Field(default=None, description="ISO 8601, as 2026-03-31T14:05")
    sensor: str | None = Field(default=None, description="maker and type")
    sensor_serial: str | None = Field(default=None, description="its serial number")
    sensor_calibrated_at: str | None = Field(default=None, description="ISO 8601")
    robot: str | None = Field(default=None, description="maker and type")
    robot_serial: str | None = Field(default=None, description="its serial number")
    profiles: ProfilesPart | None = Field(default=None, description="a table of profiles in a text file")
    poses: PosesPart | None = Field(default=None, description="a table of poses in a text file")
    program: ProgramPart | None = Field(default=None, description="a robot's program of taught positions")
    arrays: ArraysPart | None = Field(default=None, description="arrays of numpy")
    joints: JointsPart | None = Field(default=None, description="a table of joint positions, and the robot's URDF")
    tracker: TrackerPart | None = Field(default=None, description="readings of a laser tracker")
    times: TimesPart | None = Field(default=None, description="when each frame was taken")
    linear_axis: LinearAxisPart | None = Field(default=None, description="instead of poses: a straight axis")
    hand_eye: HandEyePart | None = Field(default=None, description="pose of the profiler on the flange")
    sphere_diameter_mm: float | None = Field(default=None, gt=0, description="it is a calibration recording")
    outside: Literal["refuse", "trim"] = Field(default="refuse", description="frames outside the poses' times")
    accept: list[Suspicion] = Field(default=[], description="what looks wrong, but is right")
    uncertain: list[str] = Field(default=[], description="of a draft: what to confirm before it is measured by")
    lacking: list[str] = Field(default=[], description="of a draft: what the sources do not hold")
    _base_dir: Path = PrivateAttr(Path())

    @model_validator(mode="after")
    def _dated(self) -> Mapping:
        self.names()
        return self

    def names(self) -> PartNames:
        """What it says of the part; ValueError of what is no date."""
        return PartNames(**{field.name: getattr(self, field.name) for field in fields(PartNames)})

    @property
    def of_files(self) -> dict[str, FilesPart]:
        """Its parts about some of the sources, by name."""
        return {name: part for name in READERS if (part := getattr(self, name)) is not None}

    @property
    def base_dir(self) -> Path:
        """Where the relative paths in it start: the mapping file's own folder."""
        return self._base_dir


def no_mapping() -> Mapping:
    """What holds where no mapping file is given."""
    return Mapping(format="import-mapping", version=1)


def mapping_of(tree: object) -> Mapping:
    """The mapping that a JSON object is; ValidationError where it is none."""
    return Mapping.model_validate_json(json.dumps(tree))


def read_mapping(path: Path) -> Mapping:
    """Read MAP.json. Raises InputError with all of its problems: line, JSON path, what was expected, nearest name."""
    tree = read_json(path, MAX_BYTES)
    if gone := {"keyence_raw", "height_map", "bag"} & tree.keys():
        expected = (
            "no such part any more: a few lines of Python make arrays or tables of it (docs/importing.md#other-forms)"
        )
        raise InputError(f"{path}: {min(gone)}", expected)
    arrays = tree["arrays"] if isinstance(tree.get("arrays"), dict) else {}
    if gone := {"joints", "angle_unit", "urdf", "base_frame", "flange_frame"} & arrays.keys():
        expected = "joints come as a table: part joints of the mapping (docs/importing.md)"
        raise InputError(f"{path}: arrays.{min(gone)}", expected)
    try:
        mapping = mapping_of(tree)
    except ValidationError as error:
        found = dict.fromkeys(problems(error, tree, Mapping))
        raise InputError(str(path), problem_text(list(found), path.read_text("utf-8-sig"))) from None
    mapping._base_dir = path.parent
    return mapping


# All problems of a mapping file at once, each with its line.

MOST = 8  # problems that are listed
BLANK = re.compile(r"[ \t\n\r]*")


def problem_text(found: list[tuple[Place, str]], text: str) -> str:
    """The problems in one line, in the order of the file."""
    lines = sorted(((line_of(text, place), place, what) for place, what in found), key=lambda each: each[0])
    shown = [f"line {line}: {path_of(place)}: {what}" for line, place, what in lines[:MOST]]
    if len(lines) == 1:
        return shown[0]
    more = f"; and {len(lines) - MOST} more" if len(lines) > MOST else ""
    return f"{len(lines)} problems: " + "; ".join(f"({k}) {one}" for k, one in enumerate(shown, 1)) + more


def line_of(text: str, place: Place) -> int:
    """The line of a place in a JSON text that parses; of the object that should hold it, where it is not there."""
    at = BLANK.match(text).end()  # type: ignore[union-attr]  # matches anything
    for key in place:
        found = _member(text, at, key)
        if found is None:
            break
        at = found
    return text.count("\n", 0, at) + 1


def _member(text: str, at: int, key: str | int) -> int | None:
    """Where the value of a member, or an element, of the object or list at `at` begins."""
    closing = {"{": "}", "[": "]"}.get(text[at])
    if closing is None or (closing == "}") != isinstance(key, str):
        return None
    at, number = _after_blanks(text, at + 1), 0
    while text[at] != closing:
        name: str | int = number
        if closing == "}":
            name, at = json.JSONDecoder().raw_decode(text, at)
            at = _after_blanks(text, _after_blanks(text, at) + 1)
        if name == key:
            return at
        at = _after_blanks(text, json.JSONDecoder().raw_decode(text, at)[1])
        if text[at] == ",":
            at = _after_blanks(text, at + 1)
        number += 1
    return None


def _after_blanks(text: str, at: int) -> int:
    match = BLANK.match(text, at)
    assert match is not None
    return match.end()


def claimed_by(path: Path, mapping: Mapping) -> list[str]:
    """Modules of workbench.importing whose part of the mapping names the file."""
    return [READERS[name] for name, part in mapping.of_files.items() if part.claims(path)]
