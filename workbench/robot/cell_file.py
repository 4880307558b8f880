"""The cell file's form: strict JSON, every key described. Lengths in mm, angles in deg."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Field, model_validator

from workbench.geometry.poses import RIGID, is_rigid, pose_from, rotation_from_quaternion
from workbench.parameters import INDEXED, NAME
from workbench.robot.makers import Make
from workbench.robot.wrist import Side, refuse_contradiction
from workbench.units import DEG, Float

Length = Annotated[float, Field(ge=-1e5, le=1e5)]
Size = Annotated[float, Field(ge=1e-3, le=1e5)]
Point = tuple[Length, Length, Length]
Matrix = Annotated[list[Annotated[list[float], Field(min_length=4, max_length=4)]], Field(min_length=4, max_length=4)]
Quaternion = tuple[float, float, float, float]
Six = tuple[Size, Size, Size, Size, Size, Size]
Spring = Annotated[float, Field(gt=0, le=1e12)]
Springs = tuple[Spring, Spring, Spring, Spring, Spring, Spring]
Uncertainty = Annotated[float, Field(ge=0, le=10)]


def _rising(limits: tuple[float, float]) -> tuple[float, float]:
    if not limits[0] < limits[1]:
        raise ValueError("expected the lower one first")
    return limits


Limits = Annotated[tuple[float, float], AfterValidator(_rising)]


class _Part(BaseModel):
    """An object of the file: known keys only."""

    model_config = ConfigDict(strict=True, extra="forbid", allow_inf_nan=False, frozen=True)


class Placed(_Part):
    """A pose: origin and orientation."""

    position_mm: Point = Field(default=(0.0, 0.0, 0.0), description="origin")
    quaternion_wxyz: Quaternion = Field(default=(1.0, 0.0, 0.0, 0.0), description="orientation, scalar first")

    @model_validator(mode="after")
    def _unit(self) -> Placed:
        if abs(np.linalg.norm(self.quaternion_wxyz) - 1) > 1e-3:
            raise ValueError("expected a quaternion of norm 1 within 1e-3")
        return self


def _matrix(pose: Placed | Matrix) -> Float:
    if isinstance(pose, Placed):
        q = np.array(pose.quaternion_wxyz)
        return pose_from(rotation_from_quaternion(q / np.linalg.norm(q)), np.array(pose.position_mm))
    matrix = np.array(pose, float)
    if not is_rigid(matrix):
        raise ValueError(RIGID)
    return matrix


def _rows(points: list[Point]) -> Float:
    return np.array(points, float).reshape(-1, 3)


if TYPE_CHECKING:
    Pose = Float  # (4, 4), whichever way the file gives it
    Points = Float  # (k, 3)
else:
    Pose = Annotated[Placed | Matrix, AfterValidator(_matrix)]  # or the 4x4 matrix `a_from_b`, row-major
    Points = Annotated[list[Point], AfterValidator(_rows)]


class RobotPart(_Part):
    """The robot."""

    urdf: str = Field(description="its URDF, or the xacro that makes one, relative to this file")
    arguments: dict[str, str] = Field(default={}, description="of the xacro: name to text, as in ur_type:=ur10e")
    base_frame: str = Field(default="base_link", description="the URDF's frame in which the controller reports poses")
    flange_frame: str = Field(default="tool0", description="the URDF's frame of the mounting flange")
    held: dict[str, Length] = Field(
        default={},
        description="joints of the URDF that stand: name to deg, or mm of a prismatic one (a linear track)",
    )
    packages: dict[str, str] = Field(
        default={},
        description="ROS packages (package://name/... of meshes, $(find name) of xacro): name to folder, relative to "
        "this file; others are looked for by the package.xml above the URDF and beside that",
    )
    srdf: str | None = Field(
        default=None, description="MoveIt's file, whose disabled pairs of links may touch, relative to this file"
    )
    acceleration_deg_s2: Six | None = Field(default=None, description="largest of the joints; null: not judged")
    repeatability_mm: float | None = Field(
        default=None, gt=0, le=10, description="of a pose (ISO 9283, RP), of its data sheet; null: not judged"
    )
    configuration: list[Side] = Field(
        default=[], max_length=3, description="in which the arm is to mill, one word of each pair at most; empty: any"
    )
    joint_stiffness_nm_per_rad: Springs | None = Field(
        default=None, description="of this robot, where no stiffness.json is named; null: unknown"
    )

    @model_validator(mode="after")
    def _sides(self) -> RobotPart:
        refuse_contradiction(self.configuration)
        return self


class ShapePart(_Part):
    """A collision shape: exactly one of its kinds, and where it is."""

    pose: Pose = Field(
        default=Placed(),
        validate_default=True,
        description="of the shape's middle, in the frame of what it belongs to",
    )
    box_mm: tuple[Size, Size, Size] | None = Field(default=None, description="edge lengths along x, y, z")
    capsule_mm: tuple[Size, Size] | None = Field(
        default=None, description="radius, and length along z without the caps"
    )
    cylinder_mm: tuple[Size, Size] | None = Field(default=None, description="radius, and length along z")
    sphere_mm: Size | None = Field(default=None, description="radius")
    mesh: str | None = Field(default=None, description="an STL, OBJ or PLY file in mm, relative to this file")

    @model_validator(mode="after")
    def _one_kind(self) -> ShapePart:
        given = [name for name in KINDS if getattr(self, name) is not None]
        if len(given) != 1:
            raise ValueError(f"expected exactly one of {', '.join(KINDS)}")
        return self

    @property
    def solid(self) -> tuple[str, tuple[float, ...]] | None:
        """Kind and sizes as a `Shape` has them; None: a mesh."""
        given = ((name.removesuffix("_mm"), getattr(self, name)) for name in KINDS if name != "mesh")
        found = [(kind, size if isinstance(size, tuple) else (size,)) for kind, size in given if size is not None]
        return next(iter(found), None)


KINDS = ("box_mm", "capsule_mm", "cylinder_mm", "sphere_mm", "mesh")


class ToolShapePart(ShapePart):
    """A collision shape of the tool."""

    body: Literal["tool", "cutter"] = Field(default="tool", description="what messages and may_touch call it")


class SpindleCurvePart(_Part):
    """What the spindle gives for any length of time (S1) at its nose; between two speeds evenly."""

    speed_rpm: list[Size] = Field(min_length=2, description="rising; nothing is known beyond its ends")
    torque_nm: list[Size] | None = Field(default=None, description="at each speed; null: from the power")
    power_kw: list[Size] | None = Field(default=None, description="at each speed; null: from the torque")

    @model_validator(mode="after")
    def _curve(self) -> SpindleCurvePart:
        columns = [column for column in (self.torque_nm, self.power_kw) if column is not None]
        if not columns or any(len(column) != len(self.speed_rpm) for column in columns):
            raise ValueError("expected torque_nm or power_kw, or both, with one value a speed")
        if (np.diff(self.speed_rpm) <= 0).any():
            raise ValueError("expected speed_rpm rising")
        return self


class ToolPart(_Part):
    """Spindle and cutter."""

    flange_from_cutter: Pose = Field(description="the cutter's tip: z along its axis from shank to tip")
    controller_name: str | None = Field(
        default=None,
        min_length=1,
        max_length=32,
        description="of the tool as measured on the controller; null: the "
        "program declares it, from mass and centre of gravity",
    )
    mass_kg: float | None = Field(default=None, gt=0, le=1000, description="of spindle and cutter")
    centre_of_gravity_mm: Point | None = Field(default=None, description="of spindle and cutter, in the flange")
    spindle: SpindleCurvePart | None = Field(
        default=None, description="torque and power over speed, of its data sheet; null: not judged"
    )
    shapes: list[ToolShapePart] = Field(default=[], description="collision shapes, in the flange frame")


class AxisPart(_Part):
    """What holds of an axis that turns."""

    limits_deg: Limits = Field(default=(-180.0, 180.0), description="lowest and highest angle")
    speed_deg_s: float = Field(default=30.0, gt=0, description="largest speed")
    acceleration_deg_s2: float | None = Field(
        default=None, gt=0, le=100000, description="largest acceleration; null: not judged"
    )
    shapes: list[ShapePart] = Field(default=[], description="collision shapes, in its frame")


class TiltPart(AxisPart):
    """The axis that tilts the turntable: the first of a two-axis positioner."""

    base_from_tilt: Pose = Field(description="its frame at 0 deg; it turns about z")


class TurntablePart(AxisPart):
    """The turntable under the workpiece."""

    base_from_turntable: Pose = Field(description="its frame with it, and its tilt, at 0 deg; it turns about z")
    tilt: TiltPart | None = Field(default=None, description="null: it stands on the base")


class TrackPart(_Part):
    """The linear track that carries the robot, known to the controller as the robot's own (targets stay in space).

    The base is where it stands with the track at 0: all that is in its frame, but what goes along, stands there.
    """

    joint: str | None = Field(
        default=None, description="prismatic joint of the URDF below the base: gives what is not stated here"
    )
    direction: Point | None = Field(
        default=None, description="in which the base goes as the value rises, in its frame; of any length"
    )
    limits_mm: Limits | None = Field(default=None, description="lowest and highest value")
    speed_mm_s: float | None = Field(default=None, gt=0, description="largest speed")
    acceleration_mm_s2: float | None = Field(
        default=None, gt=0, le=100000, description="largest acceleration; null: not judged"
    )

    @model_validator(mode="after")
    def _usable(self) -> TrackPart:
        if self.joint is None and None in (self.direction, self.limits_mm, self.speed_mm_s):
            raise ValueError("expected direction, limits_mm and speed_mm_s, or the joint of the URDF")
        if self.direction is not None and not np.linalg.norm(self.direction) > 0:
            raise ValueError("expected a direction that is not zero")
        return self


class WorkpiecePart(_Part):
    """The workpiece on the turntable, or on the base where there is none."""

    pose: Pose = Field(
        default=Placed(),
        validate_default=True,
        description="of the mesh's frame, in the turntable's frame (or the base)",
    )
    mesh: str | None = Field(
        default=None, description="an STL, OBJ or PLY file in mm, or a cloud (PLY, PCD, XYZ); null: nothing to run into"
    )
    material: str | None = Field(
        default=None, description="whose cutting coefficients hold (`stiffness.force`); null: not stated"
    )
    voxel_mm: float = Field(default=10.0, gt=0, le=1000, description="edge of the cubes that hold a cloud's points")


class FixturePart(ShapePart):
    """Something that stands in the cell."""

    name: str = Field(min_length=1, description="for messages")
    on: Literal["base", "turntable", "tilt", "carriage"] = Field(
        default="base", description="what it stands on; the carriage is a track's, and goes along with the robot"
    )


class MarginsPart(_Part):
    """What a posture keeps from joint limits and singularities."""

    limit_deg: float = Field(default=2.0, ge=0, le=45, description="of each joint and the turntable from its limits")
    wrist_deg: float = Field(default=5.0, ge=0, le=45, description="of axis 6 from the line of axis 4 (abs(q5))")
    condition: float = Field(
        default=50.0,
        gt=1,
        le=1e6,
        description="largest ratio of singular values of the Jacobian, lengths in units of half the robot's own",
    )


class UncertaintyPart(_Part):
    """How well the cell is known: standard uncertainties, of each axis."""

    tool_u_mm: Uncertainty = Field(default=0.0, description="of the tool on the flange")
    tool_u_deg: Uncertainty = Field(default=0.0, description="of its orientation")
    base_u_mm: Uncertainty = Field(
        default=0.0, description="of the part in the base, beside what the hand-eye of its scan leaves open"
    )
    base_u_deg: Uncertainty = Field(default=0.0, description="of its orientation")
    turntable_u_mm: Uncertainty = Field(default=0.0, description="of the turntable's axis in the base")
    turntable_u_deg: Uncertainty = Field(default=0.0, description="of the axis' direction")


class EnvelopePart(_Part):
    """A box that the robot and its tool stay in, along the axes of the base."""

    lowest_mm: Point = Field(description="corner")
    highest_mm: Point = Field(description="corner")

    @model_validator(mode="after")
    def _open(self) -> EnvelopePart:
        if not all(low < high for low, high in zip(self.lowest_mm, self.highest_mm, strict=True)):
            raise ValueError("expected lowest_mm below highest_mm")
        return self


class WorkObjectPart(_Part):
    """The frame in which targets are written."""

    controller_name: str | None = Field(
        default=None,
        min_length=1,
        max_length=32,
        description="of the frame as measured on the controller; null: the program declares it",
    )
    pose: Pose = Field(default=Placed(), validate_default=True, description="of the frame in the base")


class LoadingSetup(_Part):
    """What is mounted for loading tests; noise is the standard deviation of loaded minus unloaded."""

    flange_from_sensor: Pose = Field(description="frame of the force and torque sensor")
    flange_from_tool: Pose = Field(description="the tool frame, whose displacement is given in six dimensions")
    targets_mm: Points = Field(
        default=[], validate_default=True, description="tracked points p1, p2, ... in the flange frame"
    )
    load_points_mm: Points = Field(
        default=[], validate_default=True, description="where a force can be applied, in the flange frame"
    )
    force_noise_n: float = Field(default=0.5, gt=0, description="each axis")
    torque_noise_nm: float = Field(default=0.05, gt=0, description="each axis")
    displacement_noise_mm: float = Field(default=0.01, gt=0, description="of the tool frame, each axis")
    rotation_noise_deg: float = Field(default=0.002, gt=0, description="of the tool frame, each axis")
    target_noise_mm: float = Field(default=0.015, gt=0, description="of a tracked point, each axis")

    @property
    def wrench_noise(self) -> Float:
        """Of force and torque (6,), N and Nm."""
        return np.repeat([self.force_noise_n, self.torque_noise_nm], 3)

    def moved_noise(self, points: int) -> Float:
        """Of the displacement of tracked points (3 points,), mm; or of the tool frame (6,), where there are none."""
        if points:
            return np.full(3 * points, self.target_noise_mm)
        return np.repeat([self.displacement_noise_mm, self.rotation_noise_deg * DEG], 3)


class ControllerPart(_Part):
    """The robot's controller."""

    dialect: Make = Field(
        description="whose language it reads: RAPID, KRL, FANUC's TP, URScript, INFORM, or joint angles over time"
    )
    level_joint_3: bool | None = Field(
        default=None, description="joint 3 is measured from the horizontal, not the upper arm; null: as FANUC does"
    )
    corner_region: bool = Field(default=False, description="FANUC, Yaskawa: CR, corners in mm, is installed")
    acceleration_s: float | None = Field(
        default=None,
        gt=0,
        le=5,
        description="longest time in which a linear move reaches its feed: what a stop costs, and by what FANUC's CNT "
        "rounds; null: stops cost nothing in the program's time, and there is no CNT",
    )
    position_levels_mm: list[Annotated[float, Field(gt=0, le=500)]] = Field(
        default=[], max_length=8, description="Yaskawa: zones of PL=1, 2, ..., as its parameters have them; empty: none"
    )
    world_from_base: Pose | None = Field(
        default=None,
        description="ABB, KUKA: the robot's base in the controller's world ($ROBROOT), where that is the `base_frame`; "
        "null: `base_frame` is its base",
    )


Word = Annotated[str, Field(pattern=NAME)]  # a name that a controller knows
Place = Annotated[str, Field(pattern=INDEXED)]  # likewise; PR[1] of FANUC, P010 of Yaskawa


def _signal(value: object) -> object:
    """Said in one line, for a name and a number alike."""
    if isinstance(value, str) and value.isdigit():
        raise ValueError(f"expected the signal's number without quotes, {value}, or its name")
    return value


# By name (ABB, KUKA) or number (KUKA, FANUC, UR, Yaskawa).
Signal = Annotated[Word | Annotated[int, Field(ge=0, le=9999)], BeforeValidator(_signal)]
Clear = Annotated[float, Field(gt=0, le=2000)]


class HomePart(_Part):
    """Where programs begin and end."""

    joints_deg: tuple[Length, Length, Length, Length, Length, Length] = Field(description="of the robot, at home")
    turntable_deg: Length | None = Field(
        default=None,
        description="of the turntable, at home; null: where the path has it first, or 0 with a controller_name",
    )
    tilt_deg: Length | None = Field(default=None, description="of its tilt, likewise")
    track_mm: Length | None = Field(default=None, description="of the track, likewise")
    controller_name: Place | None = Field(
        default=None, description="of the joint target on the controller; null: the program declares it"
    )

    @property
    def joints(self) -> Float:
        """(6,) rad."""
        return np.array(self.joints_deg) * DEG


class SpindlePart(_Part):
    """The spindle's signals."""

    on_signal: Signal = Field(description="digital output, by name or number: 1 turns it")
    at_speed_signal: Signal | None = Field(
        default=None, description="digital input: 1 at speed; null: the program waits `wait_s`, and says NOT CHECKED"
    )
    wait_s: float = Field(
        default=20.0, gt=0, le=600, description="ABB: longest wait for speed, beyond it the robot stops; others wait on"
    )


class FeedPart(_Part):
    """Limits of the feed."""

    override_percent: float = Field(default=100.0, ge=1, le=100, description="of the programmed feeds")
    most_mm_s: float = Field(gt=0, le=5000, description="largest feed of the tool centre point")


class ProbePart(_Part):
    """A stop at which the operator sees that the part is where the path has it."""

    distance_mm: Clear = Field(
        default=50.0, description="from where the cutter begins to cut, back along its axis, with the spindle off"
    )


class ProcessPart(_Part):
    """What a program does around the milling, in the words of the cell's controller; a trajectory does none of it."""

    home: HomePart
    approach_mm: Clear = Field(default=50.0, description="along the cutter's axis, straight to the first target")
    retract_mm: Clear = Field(default=50.0, description="likewise, from the last target")
    probe: ProbePart | None = Field(
        default=None, description="the program stops there and asks; null: it does not, and a shape-only path gets none"
    )
    spindle: SpindlePart | None = Field(default=None, description="null: not switched, and programs say so")
    coolant_signal: Signal | None = Field(default=None, description="digital output; null: none")
    mechanical_unit: Word | None = Field(
        default=None, description="ABB: turntable that is activated (ActUnit); null: none"
    )
    before: list[Word] = Field(default=[], description="routines on the controller that are called first")
    after: list[Word] = Field(default=[], description="likewise, at home in the end")
    restart: bool = Field(default=True, description="a label at the start of every layer, with all that milling needs")
    stop_between_layers: bool = Field(
        default=False, description="spindle and coolant off and a stop before every layer but the first"
    )
    feed: FeedPart | None = Field(default=None, description="null: as programmed")


class CellPart(_Part):
    """The whole file."""

    format: Literal["robot-cell"]
    version: Literal[1]
    title: str = ""
    robot: RobotPart
    tool: ToolPart
    controller: ControllerPart | None = Field(
        default=None, description="needed by programs; null: the pipeline's input names it"
    )
    turntable: TurntablePart | None = None
    track: TrackPart | None = Field(default=None, description="null: the robot stands, or its track does (`held`)")
    workpiece: WorkpiecePart = WorkpiecePart()
    fixtures: list[FixturePart] = []
    loading: LoadingSetup | None = Field(default=None, description="needed by loading tests only")
    may_touch: list[tuple[str, str]] = Field(default=[], description="pairs of bodies whose contact is no collision")
    margin_mm: float = Field(
        default=5.0, ge=0, le=1000, description="clearance below which a posture counts as colliding"
    )
    margins: MarginsPart = MarginsPart()
    uncertainty: UncertaintyPart | None = Field(default=None, description="null: not stated, and programs say so")
    envelope: EnvelopePart | None = Field(default=None, description="null: not stated, and programs say so")
    work_object: WorkObjectPart | None = Field(default=None, description="null: not stated: targets are in the base")
    process: ProcessPart | None = Field(
        default=None, description="null: a program mills only, and says NOT CHECKED (exit status 1)"
    )


def stated(part: CellPart, place: str) -> Any:
    """What the file states at a place, `tool.mass_kg`; None: nothing, or nothing above it."""
    value: Any = part
    for key in place.split("."):
        value = getattr(value, key, None)
    return value
