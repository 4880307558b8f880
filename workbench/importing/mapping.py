"""The mapping file (MAP.json): what a stranger's files do not say about themselves (docs/importing.md)."""

from __future__ import annotations

from pathlib import Path
from typing import Literal, TypeGuard, get_args

import numpy as np
from pydantic import Field, PrivateAttr, model_validator

from workbench.errors import InputError, PipelineError, nearest
from workbench.geometry.poses import is_rigid
from workbench.importing.bags_mapping import BagPart
from workbench.importing.mapping_tables import Matrix, PosesPart, ProfilesPart, RawPart
from workbench.importing.part import Part
from workbench.parameters import check_parameters
from workbench.strict_json import read_json

MAX_BYTES = 1_000_000
Suspicion = Literal["length_unit", "angle_unit", "time_unit", "still", "direction"]


class TimesPart(Part):
    """When each frame was taken, and on whose clock."""

    source: Literal["file", "rate", "travel", "pose_each"] = Field(
        description="the file's times; a frame rate; way along the scan against the flange's; one pose a frame"
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

    direction: tuple[float, float, float] = Field(description="of the profiler's motion, in the profiler frame")
    speed_mm_s: float = Field(gt=0, description="of the axis; times follow from it")

    @model_validator(mode="after")
    def _somewhere(self) -> LinearAxisPart:
        if not any(self.direction):
            raise ValueError("expected a direction, found 0, 0, 0")
        return self


class HandEyePart(Part):
    """Pose of the profiler on the flange: one of the two."""

    flange_from_profiler: Matrix | None = Field(default=None, description="4x4, row-major, translation in mm")
    file: str | None = Field(default=None, description="a handeye.json, relative to the mapping file")

    @model_validator(mode="after")
    def _one(self) -> HandEyePart:
        if (self.flange_from_profiler is None) == (self.file is None):
            raise ValueError("expected one of flange_from_profiler, file")
        if self.flange_from_profiler is not None and not is_rigid(np.array(self.flange_from_profiler)):
            raise ValueError("expected flange_from_profiler as a rigid motion: orthonormal to 1e-6, determinant +1, mm")
        return self


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
    keyence_raw: RawPart | None = Field(default=None, description="a Keyence file of raw heights")
    poses: PosesPart | None = Field(default=None, description="a table of poses in a text file")
    times: TimesPart | None = Field(default=None, description="when each frame was taken")
    linear_axis: LinearAxisPart | None = Field(default=None, description="instead of poses: a straight axis")
    hand_eye: HandEyePart | None = Field(default=None, description="pose of the profiler on the flange")
    bag: BagPart | None = Field(default=None, description="topics, frames and clock of a bag")
    sphere_diameter_mm: float | None = Field(default=None, gt=0, description="it is a calibration recording")
    outside: Literal["refuse", "trim"] = Field(default="refuse", description="frames outside the poses' times")
    accept: list[Suspicion] = Field(default=[], description="what looks wrong, but is right")
    _base_dir: Path = PrivateAttr(Path())

    @property
    def base_dir(self) -> Path:
        """Where the relative paths in it start: the mapping file's own folder."""
        return self._base_dir


def no_mapping() -> Mapping:
    """What holds where no mapping file is given."""
    return Mapping(format="import-mapping", version=1)


def read_mapping(path: Path) -> Mapping:
    """Read MAP.json. Raises InputError with its JSON path, what was expected and the nearest known name."""
    tree = read_json(path, MAX_BYTES)
    try:
        _check_names(tree, Mapping, f"{path}: $")
        mapping = Mapping(**check_parameters(Mapping, tree, f"{path}: $"))
    except PipelineError as error:
        raise InputError(error.where, error.expected.split(", got {")[0]) from None  # not the whole object again
    mapping._base_dir = path.parent
    return mapping


def _check_names(tree: dict[str, object], model: type[Part], where: str) -> None:
    """Every key of every object is known; the nearest known name is told."""
    for key, value in tree.items():
        if key not in model.model_fields:
            raise PipelineError(f"{where}.{key}", f"unknown key{nearest(key, model.model_fields)}")
        parts = [hint for hint in get_args(model.model_fields[key].annotation) if is_part(hint)]
        if parts and isinstance(value, dict):
            _check_names(value, parts[0], f"{where}.{key}")


def is_part(hint: object) -> TypeGuard[type[Part]]:
    """Whether an annotation is an object of the mapping file."""
    return isinstance(hint, type) and issubclass(hint, Part)
