"""Result files of comparisons, studies and calibrations."""

from __future__ import annotations

from typing import Annotated, Any, ClassVar, Literal, Self

from pydantic import Field, model_validator

from workbench.result_files.contract import (
    Covariance6,
    Matrix,
    Matrix6,
    NotNegative,
    Number,
    PartFile,
    ResultFile,
    Row,
    Six,
    Unknown,
    UnknownU,
    Vector,
)

Share = Annotated[float, Field(ge=0, le=1)]


class PlacesColumns(Row):
    """Places that were compared, a column each; null: not compared."""

    position_mm: list[Vector]
    normal: list[tuple[Unknown, Unknown, Unknown]]
    arc_length_mm: list[Unknown]
    distance_mm: list[Unknown]
    u_mm: list[UnknownU]
    level_of_detection_mm: list[UnknownU]
    changed: list[bool]


class DeviationFile(PartFile):
    """`deviation.json`: signed distances of a scan from its reference."""

    NAME: ClassVar[str] = "deviation.json"
    format: Literal["bevel-deviation"]
    version: Literal[1]
    frame: Literal["base"]
    scan: str
    reference: str
    reference_kind: Literal["scan", "plan", "mesh"]
    registered: bool
    finding: str
    changed: bool
    compared: int
    mean_mm: Unknown
    rms_mm: UnknownU
    percentiles_mm: dict[str, Unknown]
    significant_share: Unknown
    level_of_detection_mm: UnknownU
    sections: list[dict[str, Any]]
    regions: list[dict[str, Any]]
    places: PlacesColumns


class RegistrationFile(PartFile):
    """`registration.json`: the pose of a scan in its reference, with its covariance."""

    NAME: ClassVar[str] = "registration.json"
    format: Literal["cloud-registration"]
    version: Literal[1]
    scan: str
    reference: str
    reference_from_scan: Matrix
    pivot_mm: Vector
    covariance: Matrix6 = Field(description="shift of the pivot in mm, then a rotation vector in rad")
    overlap: Share
    rms_mm: NotNegative
    places: int
    held: list[str] = Field(description="directions that the surfaces do not determine")
    warnings: list[str]


class CloudRegistrationFile(PartFile):
    """`cloud_registration.json`: the pose of a cloud in another one, without a covariance."""

    NAME: ClassVar[str] = "cloud_registration.json"
    format: Literal["points-registration"]
    version: Literal[1]
    reference: str
    source: str
    reference_from_cloud: Matrix
    overlap: Share
    rms_mm: NotNegative
    reach_mm: Number
    voxel_mm: Number


class ComponentRow(Row):
    """A component of variation (AIAG)."""

    name: Literal["EV", "AV", "GRR", "PV", "TV"]
    sd: UnknownU
    interval: tuple[Number, Number] | None
    contribution_percent: Unknown
    study_percent: Unknown
    tolerance_percent: Unknown


class CharacteristicRow(Row):
    """A characteristic of a gauge study."""

    name: str
    unit: str
    limits: tuple[Number, Number] | None
    anova: list[dict[str, Any]]
    interaction_pooled: bool
    components: list[ComponentRow]
    distinct_categories: int | None
    sections: list[dict[str, Any]]
    bias: list[dict[str, Any]]


class RepeatabilityFile(PartFile):
    """`repeatability.json`: a gauge study; `part` has what all its inspections agree on, such as the instruments."""

    NAME: ClassVar[str] = "repeatability.json"
    format: Literal["bevel-repeatability"]
    version: Literal[1]
    parts: list[str]
    operators: list[str]
    trials: int
    characteristics: list[CharacteristicRow]
    inspections: list[dict[str, str]]
    warnings: list[str]


class SensitivityRow(Row):
    """A characteristic and what the links of the chain contribute to its u."""

    name: str
    unit: str
    way: Literal["blind", "corrected"]
    tolerance_half_width: Number
    u: NotNegative
    holds: bool
    improve_first: str
    links: list[dict[str, Any]]


class SensitivityFile(PartFile):
    """`sensitivity.json`: uncertainty of the milled bevel by link of the chain."""

    NAME: ClassVar[str] = "sensitivity.json"
    format: Literal["bevel-sensitivity"]
    version: Literal[1]
    bevel_deg: Number
    links: list[dict[str, Any]]
    characteristics: list[SensitivityRow]


class ToolPointRow(Row):
    """A point of the tool in the flange."""

    name: str
    position_mm: Vector
    u_mm: NotNegative = Field(description="along the least certain direction")
    covariance_mm2: tuple[Vector, Vector, Vector] | None = None


class ToolAxisRow(Row):
    """The tool's axis in the flange, towards the tip."""

    direction: Vector
    u_deg: NotNegative = Field(description="about the least certain direction")


class Measured(PartFile):
    """What a calibration says of itself. Other programs may leave it out."""

    residual_rms_mm: UnknownU = None
    misfit: Unknown = Field(default=None, description="chi-square over degrees of freedom")
    left_out: list[dict[str, Any]] = Field(default_factory=list)
    good_enough: bool | None = Field(default=None, description="for the tolerance that was given")
    verdict: str | None = None
    not_included: list[str] = Field(default_factory=list, description="errors that no reading shows, with their size")
    warnings: list[str] = Field(default_factory=list)


class ToolFile(Measured):
    """`tcp.json`: tool points in the flange, the tip first."""

    NAME: ClassVar[str] = "tcp.json"
    format: Literal["tool-calibration"]
    version: Literal[1]
    frame: Literal["flange"]
    points: Annotated[list[ToolPointRow], Field(min_length=1)]
    axis: ToolAxisRow | None = Field(description="null: not measured")
    touches: int | None = None


class TurntableFile(Measured):
    """`turntable.json`: the turntable's axis in the base."""

    NAME: ClassVar[str] = "turntable.json"
    format: Literal["turntable-calibration"]
    version: Literal[1]
    frame: Literal["base"]
    base_from_turntable: Matrix
    axis_point_mm: Vector
    axis_direction: Vector
    u_mm: NotNegative = Field(description="of the axis over its reach, along the least certain direction")
    direction_u_deg: NotNegative
    points: int | None = None


class ArmErrorRow(Row):
    """A joint offset, length or tilt of the robot, as it differs from the robot as built: mm or degrees."""

    name: str
    axis: Annotated[int, Field(ge=1)]
    value_mm: Unknown = None
    value_deg: Unknown = None
    u_mm: UnknownU = None
    u_deg: UnknownU = None
    determined: bool


class RobotFile(Measured):
    """`robot.json`: what a robot's joint offsets and lengths are off, seen by a tracker or beside a hand-eye pose."""

    NAME: ClassVar[str] = "robot.json"
    format: Literal["robot-calibration"]
    version: Literal[1]
    frame: Literal["base"]
    parameters: list[ArmErrorRow]
    covariance: list[list[Number]] = Field(description="of the parameters, mm and rad")
    left_as_built: list[str] = Field(description="what the measurements leave open, and why")
    u_mm: NotNegative = Field(description="of a place, along an axis, by the corrected robot")
    residual_rms_as_built_mm: UnknownU = None
    flange_from_profiler: Matrix | None = Field(default=None, description="for the corrected robot: see handeye.json")
    hand_eye_covariance: Matrix6 | None = None
    volume_u_mm: UnknownU = None
    sphere_center_mm: Vector | None = None
    sphere_diameter_mm: UnknownU = None
    postures: int | None = None
    tracker_from_base: Matrix | None = None
    registration_covariance: Matrix6 | None = None
    targets: list[dict[str, Any]] = Field(default_factory=list)
    readings: int | None = None


class ValidationRow(Row):
    """A posture that was held out."""

    frames: list[int]
    error_mm: tuple[Unknown, Unknown, Unknown]
    u_mm: tuple[UnknownU, UnknownU, UnknownU]


class CalibrationValidationFile(PartFile):
    """`calibration_validation.json`: errors of a hand-eye calibration on held-out postures."""

    NAME: ClassVar[str] = "calibration_validation.json"
    how: str
    rms_mm: NotNegative
    expected_mm: NotNegative
    misfit: Unknown
    freedom: int
    postures: list[ValidationRow]


class ForceRow(Row):
    """Milling force along a layer."""

    index: Annotated[int, Field(ge=1)]
    arc_length_mm: list[Number]
    mean_n: list[Any]
    peak_n: list[Any]


class MillingForceFile(PartFile):
    """`milling_force.json`: force on the cutter along each layer, N."""

    NAME: ClassVar[str] = "milling_force.json"
    format: Literal["milling-force"]
    version: Literal[1]
    frame: Literal["point"] = Field(
        default="point",
        description="each point's own, as in toolpath.json: x into the material, y along the feed, z to the tip",
    )
    layers: list[ForceRow]


class CoefficientsFile(ResultFile):
    """`coefficients.json`: of the milling force of one material by one tool, from recordings. Of no part."""

    NAME: ClassVar[str] = "coefficients.json"
    format: Literal["cutting-coefficients"]
    version: Literal[1]
    material: str
    tool: str
    ktc_n_mm2: Number
    krc_n_mm2: Number
    kac_n_mm2: Number
    kte_n_mm: Number
    kre_n_mm: Number
    kae_n_mm: Number
    covariance: Covariance6
    not_included: list[str]


class ModesFile(PartFile):
    """`modes.json`: mass, stiffness and damping of a robot, as the logarithms of its parameters are known."""

    NAME: ClassVar[str] = "modes.json"
    format: Literal["robot-modes"]
    version: Literal[1]
    joint_stiffness_nm_per_rad: Six
    link_masses_kg: Six
    parameters: list[str]
    covariance_of_logarithms: list[list[Number]]
    not_included: list[str]


class MarginRow(Row):
    """Limiting depth at a point of a path, mm; null: none up to the largest that was looked at."""

    layer: Annotated[int, Field(ge=1)]
    arc_length_mm: Number
    depth_mm: Number
    up_limit_mm: Unknown
    down_limit_mm: Unknown
    margin: Unknown
    least_margin: Unknown


class ChatterFile(PartFile):
    """`chatter.json`: limiting over actual depth of cut along a path."""

    NAME: ClassVar[str] = "chatter.json"
    format: Literal["chatter"]
    version: Literal[1]
    points: list[MarginRow]
    not_included: list[str]


class DeflectionFile(ResultFile):
    """`deflection.json`: displacement of the tool under a wrench. Of no part: the model's answer for one posture."""

    NAME: ClassVar[str] = "deflection.json"
    format: Literal["deflection"]
    version: Literal[1]
    frame: Literal["base"]
    displacement_mm: list[Any]
    rotation_deg: list[Any]
    joint_deflection_deg: list[Any]


class ScoredSection(Row):
    """Values at a place on the edge, in the base. Every value has its `_u`: root_mm and root_u_mm."""

    origin_mm: Vector | None = Field(
        default=None, description="on the lower edge, or in the middle of a groove; null: not measured"
    )
    root_mm: Unknown = None
    root_u_mm: UnknownU = None
    bevel_deg: Unknown = None
    bevel_u_deg: UnknownU = None
    gap_mm: Unknown = None
    gap_u_mm: UnknownU = None
    depth_mm: Unknown = None
    depth_u_mm: UnknownU = None
    normal: Vector | None = Field(default=None, description="raw edge: outward normal of the end face")
    tangent: Vector | None = Field(default=None, description="raw edge: direction of rising arc length")
    along_n_u_mm: UnknownU = Field(default=None, description="of origin_mm along the true normal")
    along_m_u_mm: UnknownU = Field(default=None, description="of origin_mm across the end face")
    axis_u_deg: UnknownU = Field(default=None, description="of the normal's turn about the edge")
    heading_u_deg: UnknownU = Field(default=None, description="of the tangent's direction")


class ScoredRecording(Row):
    """What a method says of one recording: sections, a hand-eye pose, or why it refuses."""

    refused: str | None = None
    seconds: NotNegative | None = Field(default=None, description="of processor time")
    sections: list[ScoredSection] = Field(default_factory=list)
    flange_from_profiler: Matrix | None = None
    translation_u_mm: tuple[NotNegative, NotNegative, NotNegative] | None = None
    rotation_u_deg: tuple[NotNegative, NotNegative, NotNegative] | None = Field(
        default=None, description="of a rotation vector in the flange's axes, R_true = exp(w) R"
    )


class SubmissionFile(ResultFile):
    """`submission.json`: results of a method over the recordings of a track, for `workbench score`. Of no part."""

    NAME: ClassVar[str] = "submission.json"
    format: Literal["edge-benchmark-submission"]
    version: Literal[1]
    method: Annotated[str, Field(min_length=1, max_length=200)]
    track: str | None = None
    recordings: dict[str, ScoredRecording]


class TrueRecording(Row):
    """The truth of one recording, at stations along the edge in order; of a sphere, the pose alone."""

    position_mm: list[Vector] | None = Field(default=None, min_length=2)
    seen: list[bool] | None = Field(default=None, description="whether the edge can be measured there")
    flange_from_profiler: Matrix | None = None

    @model_validator(mode="after")
    def _one_of_both(self) -> Self:
        if self.flange_from_profiler is None and (self.position_mm is None or self.seen is None):
            raise ValueError("expected position_mm and seen, or flange_from_profiler")
        columns = {"position_mm": self.position_mm, "seen": self.seen} | (self.model_extra or {})
        lengths = {len(column) for column in columns.values() if isinstance(column, list)}
        if self.flange_from_profiler is None and len(lengths) != 1:
            raise ValueError("expected columns of one length")
        return self


class TruthFile(ResultFile):
    """`truth.json`: what is true of the recordings of a track, for `workbench score`. Of no part."""

    NAME: ClassVar[str] = "truth.json"
    format: Literal["edge-benchmark-truth"]
    version: Literal[1]
    benchmark: str | None = None
    track: str | None = None
    set: str | None = None
    recordings: dict[str, TrueRecording]
