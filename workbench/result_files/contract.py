"""What result files share, those of the contract (docs/pipelines.md), and what else a run writes of parts and paths."""

from __future__ import annotations

import difflib
import json
import math
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, Self, get_args

import numpy as np
from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    Field,
    PrivateAttr,
    ValidationError,
    model_validator,
    with_config,
)

from workbench.artefacts import UNKNOWN_PART, ChainU, Check, HandEye, MeasuredAxis, Part, Verdict
from workbench.errors import InputError, nearest
from workbench.geometry.poses import RIGID, is_rigid, rotation_from_rpy, vector_from_rotation
from workbench.parameters import path_of, problems
from workbench.strict_json import MAX_BYTES, read_json, strict_json
from workbench.units import Float

Number = Annotated[float, Field(allow_inf_nan=False)]
Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
NotNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]
Vector = tuple[Number, Number, Number]
Quaternion = tuple[Number, Number, Number, Number]
Matrix = tuple[Quaternion, Quaternion, Quaternion, Quaternion]
Six = tuple[Number, Number, Number, Number, Number, Number]
Matrix6 = tuple[Six, Six, Six, Six, Six, Six]


def _rigid(pose: Matrix) -> Matrix:
    if not is_rigid(np.array(pose)):
        raise ValueError(RIGID)
    return pose


def _covariance(matrix: Matrix6) -> Matrix6:
    values, variance = np.array(matrix), np.diag(matrix)
    scale = np.sqrt(np.where(variance > 0, variance, 1.0))  # mm^2 and rad^2 differ by many powers of ten
    correlation = values / np.outer(scale, scale)
    plausible = variance.min() >= 0 and np.abs(correlation - correlation.T).max() <= 1e-6
    if not plausible or np.linalg.eigvalsh((correlation + correlation.T) / 2).min() < -1e-6:
        raise ValueError("expected a covariance: symmetric, no negative eigenvalue")
    return matrix


RigidMotion = Annotated[Matrix, AfterValidator(_rigid)]
Covariance6 = Annotated[Matrix6, AfterValidator(_covariance)]
Unknown = Number | None
UnknownU = NotNegative | None


HEAD = ("format", "version")


class Row(BaseModel):
    """A part of a file; further keys are kept."""

    model_config = ConfigDict(extra="allow", frozen=True, defer_build=True)  # built when it is first used


class ResultFile(Row):
    """A result file."""

    NAME: ClassVar[str]
    ANOTHER: ClassVar[dict[str, str]] = {}  # by format: what is easily taken for this file, and what to give instead
    _document: dict[str, Any] = PrivateAttr(default_factory=dict)

    @property
    def document(self) -> dict[str, Any]:
        """All that the file that was read holds, keys of others included."""
        return self._document

    @classmethod
    def written(cls, content: Mapping[str, Any]) -> bytes:
        """The file's bytes: strict JSON that this model accepts, its format and version first.

        Raises:
            ValidationError: a defect of the caller.
        """
        named = {name: get_args(cls.model_fields[name].annotation) for name in HEAD if name in cls.model_fields}
        made = strict_json({**{name: value for name, (value,) in named.items()}, **content})
        cls.model_validate_json(made)
        return made

    @classmethod
    def read(cls, path: Path, max_bytes: int = MAX_BYTES) -> Self:
        """What a file says.

        Raises:
            InputError: it is no such file: the place in it and what was expected.
        """
        document = read_json(path, max_bytes)
        if another := cls.ANOTHER.get(str(document.get("format"))):
            raise InputError(f"{path}: $.format", f"expected a {cls.NAME}, found {another}")
        try:
            made = cls.model_validate_json(json.dumps(document), strict=True)
        except ValidationError as error:
            raise _refusal(error, document, path, cls) from None
        made._document = document
        return made


class PartFile(ResultFile):
    """A result file that says whose result it is; of a robot, a tool or a table: by which robot, when, by whom."""

    part: Part = Field(default=UNKNOWN_PART, description="null: unknown; absent in files of earlier versions")

    @classmethod
    def read_for(cls, path: Path, part: Part) -> Self:
        """What a file says of the sensor and the robot that made a part's recording.

        Raises:
            InputError: as `read`, or both say which theirs is, and it is another.
        """
        found = cls.read(path)
        for what, own, other in (
            ("sensor", part.sensor_serial, found.part.sensor_serial),
            ("robot", part.robot_serial, found.part.robot_serial),
        ):
            if own and other and own != other:
                raise InputError(
                    f"{path}: $.part.{what}_serial",
                    f"expected the recording's {what}, '{own}', found '{other}': the {cls.NAME} of another cell, from "
                    "before an exchange, or a serial number mistyped?",
                )
        return found


def _refusal(error: ValidationError, document: Mapping[str, Any], path: Path, model: type[ResultFile]) -> InputError:
    """The first thing that is wrong: its place, what was expected, and the nearest known name."""
    found_wrong = error.errors(include_url=False)
    first = found_wrong[0]
    if first["type"] == "missing":
        *above, last = first["loc"]
        holder: Any = document
        for key in above:
            holder = holder[key]
        place = "$" + "".join(f"[{key}]" if isinstance(key, int) else f".{key}" for key in above)
        if isinstance(last, int):
            alike = (e["loc"][-1] for e in found_wrong if e["loc"][:-1] == first["loc"][:-1])
            most = max([last, *(k for k in alike if isinstance(k, int))])
            return InputError(f"{path}: {place}", f"expected {most + 1} entries, found {len(holder)}")
        near = difflib.get_close_matches(str(last), holder, n=1)
        hint = f", found '{near[0]}'" if near else f", as {model.NAME} has it" if place == "$" else ""
        return InputError(f"{path}: {place}", f"expected '{last}'{hint}")
    wrong, expected = problems(error, document, model)[0]
    return InputError(f"{path}: {path_of(wrong)}", expected)


for artefact in (ChainU, Check, MeasuredAxis, Part):  # they have no place for further keys: `document` has
    with_config(ConfigDict(extra="ignore"))(artefact)


class SourceRow(Row):
    """One contribution to the combined standard uncertainty; to each size, in its worst section, in further keys."""

    name: str
    kind: Literal["A", "B"]


class UncertaintyRow(Row):
    """The uncertainty budget: the squares of the sources add to the square of the largest section's u."""

    coverage_factor: Positive
    sources: list[SourceRow]
    not_included: list[str]
    correlations: str = Field(default="", description="why the squares do not add up, where they do not")


class UnseenRow(Row):
    """What a recording does not show of itself, and what it may cost; null: not known."""

    name: str
    sentence: str
    root_mm: UnknownU
    bevel_deg: UnknownU
    gap_mm: UnknownU = None
    depth_mm: UnknownU = None


class QuantityRow(Row):
    """A size in a section."""

    name: str
    value: Unknown
    u: UnknownU
    unit: Literal["mm", "deg"]
    verdict: Verdict | None = Field(description="null: nothing is required, or it was not measured")


class RequirementsRow(Row):
    """What the part must satisfy: nominal values and deviations from them, lower <= 0 <= upper."""

    root_nominal_mm: Number
    root_tolerance_mm: tuple[Number, Number]
    bevel_nominal_deg: Number
    bevel_tolerance_deg: tuple[Number, Number]


class JointSection(Row):
    """A section of a joint: its plane in the base. Sizes stand in further keys, each with its standard uncertainty."""

    index: Annotated[int, Field(ge=1)]
    arc_length_mm: Number
    origin_mm: Vector
    tangent: Vector
    normal: Vector | None = None
    across: Vector | None = None
    quantities: list[QuantityRow] = Field(default_factory=list)
    verdict: Verdict
    reason: str = ""


class SectionRow(JointSection):
    """A section of a bevel: the values in it, their standard uncertainties."""

    root_mm: Unknown
    root_u_mm: UnknownU
    bevel_deg: Unknown
    bevel_u_deg: UnknownU


class ProfileColumns(Row):
    """Values along the whole edge, a column each."""

    arc_length_mm: list[Number]
    position_mm: list[tuple[Unknown, Unknown, Unknown]]
    root_mm: list[Unknown]
    root_u_mm: list[UnknownU]
    bevel_deg: list[Unknown]
    bevel_u_deg: list[UnknownU] | None = None
    root_u_by_source_mm: dict[str, list[UnknownU]] | None = None
    bevel_u_by_source_deg: dict[str, list[UnknownU]] | None = None


def _each_once(rows: list[Any]) -> list[Any]:
    """Rows whose indices differ."""
    if len({row.index for row in rows}) < len(rows):
        raise ValueError("expected indices of their own")
    return rows


class InspectionFile(ResultFile):
    """`inspection.json`: a milled bevel as measured, against its requirements."""

    NAME: ClassVar[str] = "inspection.json"
    format: Literal["bevel-inspection"]
    version: Literal[1]
    frame: Literal["base"]
    verdict: Verdict
    reason: str
    guard_factor: NotNegative
    part: Part | None = None
    requirements: RequirementsRow
    uncertainty: UncertaintyRow | None = None
    not_included: list[UnseenRow] = Field(default_factory=list, description="with what each may cost this part")
    conditions: list[UnseenRow] = Field(default_factory=list, description="on which a pass rests; not accepted")
    checks: list[Check] = Field(default_factory=list)
    warnings: list[str] = Field(default_factory=list)
    sections: Annotated[list[SectionRow], Field(min_length=1), AfterValidator(_each_once)]
    profile: ProfileColumns


def _unit(quaternion: Quaternion) -> Quaternion:
    if abs(math.hypot(*quaternion) - 1.0) > 1e-3:
        raise ValueError("expected a quaternion of norm 1 within 1e-3")
    return quaternion


UnitQuaternion = Annotated[Quaternion, AfterValidator(_unit)]
Texts = Annotated[list[Annotated[str, Field(max_length=2000)]], Field(max_length=10)]  # a program repeats them


class CutterRow(Row):
    """The milling tool."""

    diameter_mm: Positive
    flutes: Annotated[int, Field(ge=1, le=100)]
    flute_length_mm: Positive | None = None
    ball_end: bool = Field(default=False, description="its end is half a sphere of its radius")


class TravelPoint(Row):
    """A point of a move between layers."""

    position_mm: Vector
    quaternion_wxyz: UnitQuaternion
    feed_mm_s: Positive


class PathPoint(TravelPoint):
    """A point of a layer; its frame as in docs/conventions.md."""

    arc_length_mm: Number
    cutting: bool
    measured: bool
    width_mm: NotNegative | None = Field(default=None, description="of the face cut there; absent: the depth of cut")

    @model_validator(mode="after")
    def _nothing_unseen_is_cut(self) -> Self:
        if self.cutting and not self.measured:
            raise ValueError("expected no cutting where nothing was measured")
        return self


class LayerRow(Row):
    """A layer, in cutting order."""

    index: Annotated[int, Field(ge=1)]
    height_mm: NotNegative | None = Field(default=None, description="absent: by the depth of cut")
    points: Annotated[list[PathPoint], Field(min_length=2)]


class TravelRow(Row):
    """The moves before a layer, or after the last one."""

    points: Annotated[list[TravelPoint], Field(min_length=1)]


class PathRequirements(Row):
    """What the path was planned for; the paper's values where a file is silent."""

    root_mm: Positive = 1.5
    bevel_deg: Positive = 40.0
    depth_of_cut_mm: Positive = 1.0
    root_radius_mm: NotNegative = Field(default=0.0, description="of a J preparation; 0: a bevel")


class PathClaim(Row):
    """What the check of the path said, with the digest of all the rest of the file."""

    passed: bool
    reason: Annotated[str, Field(max_length=2000)]
    loosened: Texts
    unchecked: Texts
    placed: bool = Field(
        default=False, description="whether something showed where the part stands; absent: a shape only"
    )
    sha256: str | None = Field(default=None, description="absent: the path counts as changed")


class ToolpathFile(ResultFile):
    """`toolpath.json`: a milling path in layers."""

    NAME: ClassVar[str] = "toolpath.json"
    format: Literal["bevel-toolpath"]
    version: Literal[1]
    frame: Literal["base", "workobject"]
    base_from_workobject: Matrix | None = None
    part: Part | None = None
    cutter: CutterRow
    requirements: PathRequirements = PathRequirements()
    edge_length_mm: Positive | None = None
    chain: ChainU | None = None
    refused: list[str] = Field(default_factory=list)
    warnings: list[str] = Field(default_factory=list)
    evidence: list[Check] = Field(default_factory=list, max_length=1000)
    layers: Annotated[list[LayerRow], Field(min_length=1), AfterValidator(_each_once)]
    travels: list[TravelRow] = Field(default_factory=list)
    check: PathClaim | None = None


Scale = Annotated[float, Field(gt=0.5, lt=2)]
ROUNDED_POSE = 0.1  # mm, deg: a pose written with one decimal is less off


class HandEyeFile(PartFile):
    """`handeye.json`: the pose of the profiler on the flange. Other programs may give the pose alone.

    `part` has sensor, robot and date of the recording of the sphere.
    """

    NAME: ClassVar[str] = "handeye.json"
    ANOTHER: ClassVar[dict[str, str]] = {
        "robot-calibration": "a robot.json: give the handeye.json that calibrate.robot writes beside it"
    }
    flange_from_profiler: RigidMotion
    translation_mm: Vector | None = None
    rotation_rpy_deg: Vector | None = None
    covariance: Covariance6 | None = Field(default=None, description="tx ty tz in mm, then a rotation vector in rad")
    sensor_scale: tuple[Scale, Scale] | None = Field(
        default=None, description="of the profiler's x and z, measured over true: taken out of scans"
    )
    sensor_middle_mm: tuple[Number, Number] | None = Field(default=None, description="about which: what stays")
    sensor_scale_u: tuple[NotNegative, NotNegative] | None = None
    sphere_center_mm: Vector | None = None
    sphere_diameter_mm: Positive | None = None
    time_offset_s: Unknown = None
    time_offset_u_s: Unknown = None
    volume_u_mm: Annotated[float, Field(ge=0, lt=1e3)] | None = Field(
        default=None, description="predicted RMS error of a point over the field of view"
    )
    residual_rms_mm: NotNegative | None = None
    method: str | None = None
    frames_used: list[int] = Field(default_factory=list)
    frames_rejected: list[dict[str, Any]] = Field(default_factory=list)
    good_enough: bool | None = Field(default=None, description="for the tolerance that was given")
    verdict: str | None = None
    not_included: list[str] = Field(default_factory=list, description="errors that no posture shows, with their size")
    warnings: list[str] = Field(default_factory=list)

    @classmethod
    def hand_eye(cls, path: Path, part: Part = UNKNOWN_PART) -> HandEye:
        """The pose of a file, its covariance where it gives one, and the profiler's scales, for a part's recording.

        Raises:
            InputError: it is no such file, of another sensor or robot, has a key that may be a known one misspelt, or
                its translation or angles are not those of its pose.
        """
        found, keys = cls.read_for(path, part), set(cls.model_fields)
        for key in found.model_extra or {}:  # a covariance must not be lost without a word; other keys are free
            if difflib.get_close_matches(key, keys, n=1, cutoff=0.8):
                raise InputError(f"{path}: $.{key}", f"unknown key{nearest(key, keys)}")
        covariance = None if found.covariance is None else np.array(found.covariance)
        scale, middle = found.sensor_scale or (1.0, 1.0), found.sensor_middle_mm or (0.0, 0.0)
        pose = np.array(found.flange_from_profiler)
        found._check_same_pose(path, pose)
        for said in found.warnings:
            warnings.warn(f"{path}: {said}", stacklevel=1)
        return HandEye(pose, covariance, str(path), found.part.recorded_at, found.volume_u_mm, scale, middle)

    def _check_same_pose(self, path: Path, pose: Float) -> None:
        """A file that was edited in one place only says two poses."""
        angles = self.rotation_rpy_deg
        turn = np.eye(3) if angles is None else pose[:3, :3].T @ rotation_from_rpy(*np.radians(angles))
        stated = pose[:3, 3] if self.translation_mm is None else self.translation_mm
        for key, off in (
            ("translation_mm", np.linalg.norm(stated - pose[:3, 3])),
            ("rotation_rpy_deg", np.degrees(np.linalg.norm(vector_from_rotation(turn)))),
        ):
            if off > ROUNDED_POSE:
                raise InputError(
                    f"{path}: $.{key}",
                    f"expected that of flange_from_profiler, found {off:.3g} {key.rsplit('_')[-1]} beside it; "
                    "was one of them edited alone?",
                )


class StiffnessFile(PartFile):
    """`stiffness.json`: joint stiffness of a robot, which `part` names."""

    NAME: ClassVar[str] = "stiffness.json"
    format: Literal["joint-stiffness"] = "joint-stiffness"
    version: Literal[1] = 1
    joint_stiffness_nm_per_rad: tuple[Positive, Positive, Positive, Positive, Positive, Positive]
    covariance: Covariance6
    condition_number: Unknown = None
    postures: int = 0
    loads: int = 0
    not_included: list[str] = Field(default_factory=list, description="errors that no load shows, with their size")


class PosturePoint(Row):
    """How robot, cutter and turntable stand at a point."""

    cutter_rotation_deg: Number
    turntable_deg: Number
    tilt_deg: Unknown = None
    track_mm: Unknown = None
    joints_deg: Six
    displacement_mm: Any
    clearance_mm: Unknown


class PostureMap(Row):
    """Mean displacement over cutter rotation and turntable, null where infeasible, and why."""

    cutter_rotation_deg: list[Number]
    turntable_deg: list[Number]
    tilt_deg: list[Number] | None = None
    track_mm: list[Number] | None = None
    mean_displacement_mm: list[list[Unknown]]
    cause: list[list[str | None]]


class PostureFile(PartFile):
    """`posture.json`: postures of every point of a path."""

    NAME: ClassVar[str] = "posture.json"
    format: Literal["posture"] = "posture"
    version: Literal[1] = 1
    part: Part
    points: list[PosturePoint]
    map: PostureMap


class StationRow(Row):
    """A place along the edge and by how much the finishing pass is corrected there."""

    arc_length_mm: Number
    along_n_mm: Unknown
    along_n_u_mm: Unknown
    along_m_mm: Unknown
    along_m_u_mm: Unknown
    tilt_deg: Unknown
    tilt_u_deg: Unknown
    batch_displacement_mm: Unknown = None
    batch_tilt_deg: Unknown = None


class BatchRow(Row):
    """What the stations' means over a batch are of."""

    parts: Annotated[int, Field(ge=1)]
    length_mm: Number
    bevel_deg: Number
    scatter_mm: Unknown
    scatter_deg: Unknown
    part_ids: list[str] = Field(default_factory=list)
    place_mm: Vector | None = Field(default=None, description="middle of the edge in the base")
    normal: Vector | None = Field(default=None, description="of the bevel face in its middle, in the base")
    cutter_diameter_mm: Unknown = None
    robot: str | None = None
    robot_serial: str | None = None


class CorrectionFile(PartFile):
    """`correction.json`: what the finishing pass was moved and turned by."""

    NAME: ClassVar[str] = "correction.json"
    format: Literal["path-correction"]
    version: Literal[1]
    stations: list[StationRow]
    allowance_mm: Number
    refused: str | None
    batch: BatchRow | None = None


class CornerRow(Row):
    """A corner of a groove in a section."""

    name: str
    position_mm: Vector
    u_mm: tuple[NotNegative, NotNegative]
    column: Unknown


class GrooveSection(JointSection):
    """A section of a groove or of one plate, with its corners (docs/pipelines.md)."""

    corners: list[CornerRow]


class JointFile(PartFile):
    """A joint as measured in sections."""

    version: Literal[1]
    frame: Literal["base"]
    sections: list[GrooveSection]
    part: Part
    requirements: dict[str, Any]
    uncertainty: UncertaintyRow
    checks: list[Check]
    verdict: Verdict
    reason: str


class GrooveFile(JointFile):
    """`groove.json`: a groove as measured."""

    NAME: ClassVar[str] = "groove.json"
    format: Literal["groove-inspection"]
    type: Literal["I", "V", "Y", "HV", "HY", "X", "K", "U", "J"]


class PreparationFile(JointFile):
    """`preparation.json`: the prepared edge of one plate as measured."""

    NAME: ClassVar[str] = "preparation.json"
    format: Literal["preparation-inspection"]
    type: Literal["bevel", "compound", "nose", "J"]


class InputRow(Row):
    """A file that a run read."""

    name: str
    path: str
    sha256: str


class StageRow(Row):
    """A stage that ran."""

    name: str
    seconds: NotNegative


class RunFile(ResultFile):
    """`run.json`: what a run did and what it rests on. Of no one part: a pipeline may read several."""

    NAME: ClassVar[str] = "run.json"
    pipeline: dict[str, Any]
    versions: dict[str, str]
    seed: int
    inputs: list[InputRow]
    stages: list[StageRow]
    warnings: list[str]
    files: list[str] = Field(default_factory=list)


class BatchPartFile(ResultFile):
    """`part.json`: what a batch knows of one part, with the digests of all it rests on; `identity`: whose it is."""

    NAME: ClassVar[str] = "part.json"
    format: Literal["bevel-part"]
    version: Literal[1]
    part: str = Field(description="its folder's name")
    recording: str = Field(description="as given")
    outcome: Literal["crashed", "hung", "failed", "rejected", "passed"]
    cause: str = Field(description="why it was rejected, or has no results")
    part_id: str | None
    identity: dict[str, Any]
    verdict: str | None
    requirements: dict[str, Any]
    sections: list[dict[str, Any]]
    seconds: NotNegative
    pipeline: str = Field(description="SHA-256 of the pipeline as resolved")
    versions: str = Field(description="SHA-256 of versions and code")
    inputs: list[dict[str, str | None]]
    files: dict[str, str] = Field(description="SHA-256 of each result")


class EngagementRow(Row):
    """What the cutter meets along a layer."""

    index: Annotated[int, Field(ge=1)]
    arc_length_mm: list[Unknown]
    radial_depth_mm: list[Unknown]
    axial_depth_mm: list[Unknown]
    chip_area_mm2: list[Unknown]


class EngagementFile(PartFile):
    """`engagement.json`: depths and chip area along each layer of a path."""

    NAME: ClassVar[str] = "engagement.json"
    format: Literal["bevel-engagement"]
    version: Literal[1]
    layers: list[EngagementRow]


class ReworkFile(PartFile):
    """`rework.json`: where too much or too little material stands, and the path that removes the first."""

    NAME: ClassVar[str] = "rework.json"
    format: Literal["bevel-rework"]
    version: Literal[1]
    reason: str
    too_much_material: list[dict[str, Any]]
    too_little_material: list[dict[str, Any]]
    toolpath: ToolpathFile | None


class ViolationRow(Row):
    """What is wrong with a program, and where."""

    line: int | None
    arc_length_mm: Unknown
    kind: str
    finding: str


class NearestRow(Row):
    """Where two bodies come nearest, as measured."""

    distance_mm: Unknown
    pair: list[str]
    line: int
    arc_length_mm: Unknown


class LimitRow(Row):
    """A value that was held against a limit."""

    name: str
    value: Unknown
    limit: float
    passed: bool


class ProgramCheckFile(PartFile):
    """`program_check.json`: the written program as driven through its cell."""

    NAME: ClassVar[str] = "program_check.json"
    format: Literal["program-check"]
    version: Literal[1]
    dialect: str
    program: str
    passed: bool
    violations: list[ViolationRow]
    not_checked: list[str]
    length_mm: Unknown
    time_s: Unknown
    stops: int = 0
    stops_counted: bool = False
    postures: int
    clearance_mm: Unknown
    clearance_pair: list[str] | None
    nearest: NearestRow | None = None
    limit_margin_deg: Unknown
    wrist_deg: Unknown
    condition: Unknown
    speed_share: Unknown
    deviation_mm: Unknown
    checks: list[LimitRow] = []
