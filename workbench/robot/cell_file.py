"""The cell file's form: strict JSON, every key described. Lengths in mm, angles in deg.

And whether its numbers can be what their names say: mm and not metres, degrees and not radians, z outwards. A cell that
passes may still be wrong by what no number shows; what the file leaves open is named in results.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, model_validator

from workbench.errors import InputError
from workbench.geometry.poses import is_rigid, pose_from, rotation_from_quaternion
from workbench.robot.makers import Make
from workbench.robot.wrist import Side, refuse_contradiction
from workbench.units import Float

Length = Annotated[float, Field(ge=-1e5, le=1e5)]
Size = Annotated[float, Field(gt=0, le=1e5)]
Point = tuple[Length, Length, Length]
Matrix = Annotated[list[Annotated[list[float], Field(min_length=4, max_length=4)]], Field(min_length=4, max_length=4)]
Quaternion = tuple[float, float, float, float]
Six = tuple[Size, Size, Size, Size, Size, Size]
Spring = Annotated[float, Field(gt=0, le=1e12)]
Springs = tuple[Spring, Spring, Spring, Spring, Spring, Spring]
Uncertainty = Annotated[float, Field(ge=0, le=10)]

LEAST_MM = 5.0  # no tool, turntable or frame of a cell lies nearer to its origin; what is in metres does, to 5 m
THINNEST_MM, LONGEST_MM = 1.0, 10.0  # no body is thinner and shorter; in metres, any is that 1 m and 10 m hold
UNLIKE = 20.0  # times or parts of torque times speed that a stated power is; in W it is 1000 times
LEAST_ROOM_MM = 100.0  # no robot moves in less; in metres, any envelope below 100 m is
BURIED_MM = 10.0  # deeper within the spindle's own body than the radius of a cutter modelled as part of it
FEW_DEG, NEAR_DEG = 13.0, 0.01  # a turntable's range up to 4 pi, its limits as near to parts of pi as they are rounded
FOLDED_DEG = 3.2  # a home with all joints within it, but for 0, stretches the arm and its wrist; in radians any does
AHEAD_MM = 20.0  # from the cutter's tip, along its axis: no body of the tool is there; others beside it may be
BARE_MM = 10.0  # of the cutter's end that bodies may leave uncovered
OFF_MM = 50.0  # that a centre of gravity may lie outside the box around the tool's bodies
STIFFEST = 5e7  # Nm/rad, of a joint: the stiffest axis of the paper's robot has 3.4e6, of those that carry 1 t some 1e7
LEAST_TRACK_MM = 50.0  # of a track; in metres any up to 50 m
METRES = "is it in metres?"
LEAST = {  # of numbers that the file states: nothing has less, but what is in another unit
    "tool.mass_kg": (0.1, "kg", "is it in tonnes?"),  # to 100 kg
    "margin_mm": (0.1, "mm", METRES),  # to 100 mm
    **dict.fromkeys(("margins.limit_deg", "margins.wrist_deg"), (0.1, "deg", "is it in radians?")),  # to 5 deg
    **dict.fromkeys(  # nothing in a cell is calibrated better, nor repeats; in metres, any below 1 mm is
        (*(f"uncertainty.{of}_u_mm" for of in ("tool", "base", "turntable")), "robot.repeatability_mm"),
        (1e-3, "mm", METRES),
    ),
    "robot.acceleration_deg_s2": (10.0, "deg/s^2", "is it in rad/s^2?"),  # industrial axes reach 50 and more
    **dict.fromkeys(  # however heavy; in rad/s2 any up to 230 deg/s2
        ("turntable.acceleration_deg_s2", "turntable.tilt.acceleration_deg_s2"), (4.0, "deg/s^2", "is it in rad/s^2?")
    ),
    **dict.fromkeys(("track.speed_mm_s", "process.feed.most_mm_s"), (0.2, "mm/s", "is it in m/s?")),  # to 200 mm/s
}
MAY_BE_NONE = {place for place in LEAST if place.startswith(("margin", "uncertainty"))}  # 0 states none


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


Pose = Placed | Matrix  # or the 4x4 matrix `a_from_b`, row-major


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

    pose: Pose = Field(default=Placed(), description="of the shape's middle, in the frame of what it belongs to")
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


KINDS = ("box_mm", "capsule_mm", "cylinder_mm", "sphere_mm", "mesh")


class ToolShapePart(ShapePart):
    """A collision shape of the tool."""

    body: Literal["tool", "cutter"] = Field(default="tool", description="what messages and may_touch call it")


class SpindleCurvePart(_Part):
    """What the spindle gives for any length of time (S1) at its nose; between two speeds evenly."""

    speed_rpm: list[Size] = Field(min_length=2, description="rising; nothing is known beyond its ends")
    torque_nm: list[Size] | None = Field(default=None, description="at each speed; null: as the power tells")
    power_kw: list[Size] | None = Field(default=None, description="at each speed; null: as the torque tells")

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

    limits_deg: tuple[float, float] = Field(default=(-180.0, 180.0), description="lowest and highest angle")
    speed_deg_s: float = Field(default=30.0, gt=0, description="largest speed")
    acceleration_deg_s2: float | None = Field(
        default=None, gt=0, le=100000, description="largest acceleration; null: not judged"
    )
    shapes: list[ShapePart] = Field(default=[], description="collision shapes, in its frame")

    @model_validator(mode="after")
    def _rising(self) -> Self:
        if not self.limits_deg[0] < self.limits_deg[1]:
            raise ValueError("expected limits_deg with the lower one first")
        return self


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
        default=None, description="prismatic joint of the URDF below the base: tells what is not stated here"
    )
    direction: Point | None = Field(
        default=None, description="in which the base goes as the value rises, in its frame; of any length"
    )
    limits_mm: tuple[float, float] | None = Field(default=None, description="lowest and highest value")
    speed_mm_s: float | None = Field(default=None, gt=0, description="largest speed")
    acceleration_mm_s2: float | None = Field(
        default=None, gt=0, le=100000, description="largest acceleration; null: not judged"
    )

    @model_validator(mode="after")
    def _usable(self) -> TrackPart:
        if self.joint is None and None in (self.direction, self.limits_mm, self.speed_mm_s):
            raise ValueError("expected direction, limits_mm and speed_mm_s, or the joint of the URDF")
        if self.limits_mm is not None and not self.limits_mm[0] < self.limits_mm[1]:
            raise ValueError("expected limits_mm with the lower one first")
        if self.direction is not None and not np.linalg.norm(self.direction) > 0:
            raise ValueError("expected a direction that is not zero")
        return self


class WorkpiecePart(_Part):
    """The workpiece on the turntable, or on the base where there is none."""

    pose: Pose = Field(default=Placed(), description="of the mesh's frame, in the turntable's frame (or the base)")
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
    pose: Pose = Field(default=Placed(), description="of the frame in the base")


class LoadingPart(_Part):
    """What is mounted for loading tests; noise is the standard deviation of loaded minus unloaded."""

    flange_from_sensor: Pose = Field(description="frame of the force and torque sensor")
    flange_from_tool: Pose = Field(description="the tool frame, whose displacement is given in six dimensions")
    targets_mm: list[Point] = Field(default=[], description="tracked points p1, p2, ... in the flange frame")
    load_points_mm: list[Point] = Field(default=[], description="where a force can be applied, in the flange frame")
    force_noise_n: float = Field(default=0.5, gt=0, description="each axis")
    torque_noise_nm: float = Field(default=0.05, gt=0, description="each axis")
    displacement_noise_mm: float = Field(default=0.01, gt=0, description="of the tool frame, each axis")
    rotation_noise_deg: float = Field(default=0.002, gt=0, description="of the tool frame, each axis")
    target_noise_mm: float = Field(default=0.015, gt=0, description="of a tracked point, each axis")


class ControllerPart(_Part):
    """The robot's controller."""

    dialect: Make = Field(
        description="whose language it reads: RAPID, KRL, FANUC's TP, URScript, INFORM, or joint angles over time"
    )
    level_joint_3: bool | None = Field(
        default=None, description="joint 3 counts against the ground, not the upper arm; null: as FANUC's do"
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


Word = Annotated[str, Field(pattern=r"^[A-Za-z][A-Za-z0-9_]{0,31}$")]  # a name that a controller knows
Place = Annotated[
    str, Field(pattern=r"^[A-Za-z][A-Za-z0-9_]{0,31}(\[[0-9]{1,4}\])?$")
]  # likewise; PR[1] of FANUC, P010 of Yaskawa


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
    loading: LoadingPart | None = Field(default=None, description="needed by loading tests only")
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


def matrix_of(pose: Pose) -> Float | None:
    """The 4x4 matrix of a pose in the file; None: it is not a rigid motion."""
    if isinstance(pose, Placed):
        q = np.array(pose.quaternion_wxyz)
        return pose_from(rotation_from_quaternion(q / np.linalg.norm(q)), np.array(pose.position_mm))
    matrix = np.array(pose, float)
    return matrix if is_rigid(matrix) else None


# Whether the numbers can be what their names say.


def check_plausible(part: CellPart, where: str) -> None:
    """Refuse a cell whose numbers show another unit or sense than their names; `where` is the file and '$'.

    Raises:
        InputError: the first of them, with its place in the file.
    """
    for place, text in _doubts(part):
        raise InputError(f"{where}.{place}", text)


def _doubts(part: CellPart) -> Iterator[tuple[str, str]]:
    yield from _tool(part)
    if part.turntable is not None:
        yield from _turntable(part.turntable)
        if part.envelope is not None:
            yield from _out_of_reach(part.turntable, part.envelope)
    if part.track is not None:
        yield from _track(part.track)
    if part.work_object is not None and np.any(_matrix(part.work_object.pose)[:3, 3]):
        yield from _near(part.work_object.pose, "work_object.pose", "robot's base")
    yield from _bodies(part)
    yield from _least(part)
    yield from _robot(part)
    if part.process is not None:
        home = part.process.home.joints_deg
        if 0 < max(map(abs, home)) < FOLDED_DEG:
            found = ", ".join(f"{value:g}" for value in home)
            yield "process.home.joints_deg", f"expected degrees, found {found}: are they radians?"


def _least(part: CellPart) -> Iterator[tuple[str, str]]:
    """Numbers below the least that are one."""
    for place, (least, unit, guess) in LEAST.items():
        value = _at(part, place)
        if value is not None and 0 < value < least:
            none = "0 or " if place in MAY_BE_NONE else ""
            yield place, f"expected {none}at least {least:g} {unit}, found {value:g}: {guess}"


def _at(part: BaseModel, place: str) -> float | None:
    """A number of the file, the least of several; None: it states none there."""
    value: Any = part
    for key in place.split("."):
        value = getattr(value, key, None)
    return None if value is None else float(np.min(value))


def _axes(table: TurntablePart) -> Iterator[tuple[str, AxisPart]]:
    """The axes by their places."""
    yield "turntable", table
    if table.tilt is not None:
        yield "turntable.tilt", table.tilt


def _turntable(table: TurntablePart) -> Iterator[tuple[str, str]]:
    yield from _near(table.base_from_turntable, "turntable.base_from_turntable", "robot's base")
    if table.tilt is not None:
        yield from _near(table.tilt.base_from_tilt, "turntable.tilt.base_from_tilt", "robot's base")
    for place, axis in _axes(table):
        yield from _axis(place, axis)


def _axis(place: str, axis: AxisPart) -> Iterator[tuple[str, str]]:
    low, high = axis.limits_deg
    parts_of_pi = [abs(limit / (np.pi / 4) - round(limit / (np.pi / 4))) * np.pi / 4 for limit in (low, high)]
    if high - low < FEW_DEG and max(abs(low), abs(high)) > 0.5 and max(parts_of_pi) < NEAR_DEG:
        yield f"{place}.limits_deg", f"expected degrees, found {low:g}, {high:g}: are they radians?"


def _out_of_reach(table: TurntablePart, room: EnvelopePart) -> Iterator[tuple[str, str]]:
    """What is milled on a turntable lies where robot and tool may go; a mesh is not looked at."""
    pose, beyond = _matrix(table.base_from_turntable), []
    for shape in table.shapes:
        middle = pose[:3, :3] @ _matrix(shape.pose)[:3, 3] + pose[:3, 3]
        reach = np.array([_reach_mm(shape, axis) for axis in pose[:3, :3]])
        off = np.maximum(np.array(room.lowest_mm) - middle - reach, middle - reach - np.array(room.highest_mm))
        beyond.append(shape.mesh is None and bool((off > 0).any()))
    if beyond and all(beyond):
        found = "found all of its bodies outside: is it in another unit or frame?"
        yield "turntable.base_from_turntable", f"expected a turntable that reaches into $.envelope, {found}"


def _track(track: TrackPart) -> Iterator[tuple[str, str]]:
    assert track.limits_mm is not None  # the joint tells them
    low, high = track.limits_mm
    if high - low < LEAST_TRACK_MM:
        yield (
            "track.limits_mm",
            f"expected a range of at least {LEAST_TRACK_MM:g} mm, found {low:g}, {high:g}: {METRES}",
        )


def _bodies(part: CellPart) -> Iterator[tuple[str, str]]:
    for place, shape in _shapes(part):
        size = _extents_mm(shape)
        if min(size) < THINNEST_MM and max(size) < LONGEST_MM:
            found = " x ".join(f"{value:g}" for value in size)
            yield place, f"expected a body of mm, found one of {found}: {METRES}"
    for i, fixture in enumerate(part.fixtures):
        if fixture.on == "base" and fixture.mesh is None and np.any(_matrix(fixture.pose)[:3, 3]):
            yield from _near(fixture.pose, f"fixtures[{i}].pose", "robot's base")
    if part.envelope is not None:
        room = min(h - low for low, h in zip(part.envelope.lowest_mm, part.envelope.highest_mm, strict=True))
        if room < LEAST_ROOM_MM:
            yield "envelope", f"expected a box in which a robot can move, found one {room:.3g} mm wide: {METRES}"


def _robot(part: CellPart) -> Iterator[tuple[str, str]]:
    springs = part.robot.joint_stiffness_nm_per_rad
    if springs is not None and max(springs) > STIFFEST:
        unit = "is it in Nmm/rad, or multiplied by 57.3?"
        yield (
            "robot.joint_stiffness_nm_per_rad",
            f"expected at most {STIFFEST:g} Nm/rad, found {max(springs):g}: {unit}",
        )


def bare_mm(part: CellPart) -> float:
    """How much of the cutter's end lies outside the tool's bodies, more than bodies leave uncovered; else 0."""
    if not part.tool.shapes or any(shape.mesh for shape in part.tool.shapes):
        return 0.0
    tip = _matrix(part.tool.flange_from_cutter)[:3, 3]
    nearest = min(-_depth_mm(shape, tip) for shape in part.tool.shapes)
    return nearest if nearest > BARE_MM else 0.0


def _tool(part: CellPart) -> Iterator[tuple[str, str]]:
    tool = part.tool
    yield from _near(tool.flange_from_cutter, "tool.flange_from_cutter", "flange")
    if tool.spindle is not None:
        yield from _curve(tool.spindle)
    tip = _matrix(tool.flange_from_cutter)
    for i, shape in enumerate(tool.shapes):
        depth = _depth_mm(shape, tip[:3, 3])
        if shape.body == "tool" and depth > BURIED_MM:
            yield (
                "tool.flange_from_cutter",
                f"expected the cutter's tip outside the spindle, found it {depth:.0f} mm within $.tool.shapes[{i}]: "
                "are its unit and the frame right?",
            )
    middles = [(s.body, _matrix(s.pose)[:3, 3]) for s in tool.shapes if s.mesh is None]
    cutter = [middle for body, middle in middles if body == "cutter"] or [middle for _, middle in middles]
    if cutter and all(tip[:3, 2] @ (middle - tip[:3, 3]) > LEAST_MM for middle in cutter):
        yield (
            "tool.flange_from_cutter",
            "expected z from shank to tip, found the shapes ahead of the tip: is z flipped?",
        )
    elif any(_depth_mm(shape, tip[:3, 3] + AHEAD_MM * tip[:3, 2]) > 0.0 for shape in tool.shapes):
        yield (
            "tool.flange_from_cutter",
            f"expected the tool's bodies to end at the cutter's tip, found one {AHEAD_MM:g} mm beyond it: another "
            "cutter, or is the tip's place wrong?",
        )
    up = tip[:3, 3] - AHEAD_MM * tip[:3, 2]
    if tool.shapes and not bare_mm(part) and all(s.mesh is None and _depth_mm(s, up) < -BARE_MM for s in tool.shapes):
        yield (
            "tool.flange_from_cutter",
            f"expected z along the cutter's axis, found no body of the tool {AHEAD_MM:g} mm back from the tip: is z "
            "another axis, or the quaternion not scalar first?",
        )
    if tool.centre_of_gravity_mm is not None and np.linalg.norm(tool.centre_of_gravity_mm) < LEAST_MM:
        found = ", ".join(f"{value:g}" for value in tool.centre_of_gravity_mm)
        yield "tool.centre_of_gravity_mm", f"expected at least {LEAST_MM:g} mm from the flange, found {found}: {METRES}"
    elif tool.centre_of_gravity_mm is not None and tool.shapes and not any(shape.mesh for shape in tool.shapes):
        boxes = [_around(shape) for shape in tool.shapes]
        low, high = np.min([one for one, _ in boxes], axis=0), np.max([one for _, one in boxes], axis=0)
        at = np.array(tool.centre_of_gravity_mm)
        off = float(np.maximum(np.minimum(low, 0.0) - at, at - np.maximum(high, 0.0)).max())  # the flange counts too
        if off > OFF_MM:
            yield (
                "tool.centre_of_gravity_mm",
                f"expected a place among the tool's bodies, found one {off:.0f} mm outside: "
                "is it in the flange's frame?",
            )


def _curve(curve: SpindleCurvePart) -> Iterator[tuple[str, str]]:
    """Torque and power that no one spindle has: P = T omega, but for what the drive limits."""
    if curve.torque_nm is None or curve.power_kw is None:
        return
    asked = np.array(curve.torque_nm) * np.array(curve.speed_rpm) * (2 * np.pi / 60 / 1000)
    ratio = float(np.median(np.array(curve.power_kw) / asked))
    if not 1 / UNLIKE < ratio < UNLIKE:
        yield "tool.spindle.power_kw", f"expected about torque times speed, found {ratio:.3g} times that: is it in W?"


def _near(pose: Pose, place: str, origin: str) -> Iterator[tuple[str, str]]:
    at = _matrix(pose)[:3, 3]
    if np.linalg.norm(at) < LEAST_MM:
        found = ", ".join(f"{value:g}" for value in at)
        why = METRES if at.any() else "was it left out?"
        yield place, f"expected a place at least {LEAST_MM:g} mm from the {origin}, found {found}: {why}"


def _matrix(pose: Pose) -> Float:
    matrix = matrix_of(pose)
    assert matrix is not None  # the cell was built of it
    return matrix


def _shapes(part: CellPart) -> Iterator[tuple[str, ShapePart]]:
    for i, shape in enumerate(part.tool.shapes):
        yield f"tool.shapes[{i}]", shape
    for place, axis in _axes(part.turntable) if part.turntable else ():
        yield from ((f"{place}.shapes[{i}]", other) for i, other in enumerate(axis.shapes))
    for i, fixture in enumerate(part.fixtures):
        yield f"fixtures[{i}]", fixture


def _extents_mm(shape: ShapePart) -> tuple[float, ...]:
    """Extents of a shape of the file along its own axes; infinite for a mesh, which `read_cell` looks at."""
    if shape.box_mm is not None:
        return shape.box_mm
    if shape.cylinder_mm is not None:
        return 2 * shape.cylinder_mm[0], shape.cylinder_mm[1]
    if shape.capsule_mm is not None:
        return 2 * shape.capsule_mm[0], 2 * shape.capsule_mm[0] + shape.capsule_mm[1]
    return (np.inf,) if shape.sphere_mm is None else (2 * shape.sphere_mm,)


def _reach_mm(shape: ShapePart, direction: Float) -> float:
    """How far a shape, no mesh, reaches from its middle along a unit vector of the frame that it is given in."""
    x, y, z = np.abs(_matrix(shape.pose)[:3, :3].T @ direction)
    if shape.box_mm is not None:
        return float(np.array([x, y, z]) @ np.array(shape.box_mm) / 2)
    if shape.cylinder_mm is not None:
        return float(shape.cylinder_mm[0] * np.hypot(x, y) + shape.cylinder_mm[1] / 2 * z)
    if shape.capsule_mm is not None:
        return float(shape.capsule_mm[0] + shape.capsule_mm[1] / 2 * z)
    return shape.sphere_mm or 0.0


def _around(shape: ShapePart) -> tuple[Float, Float]:
    """Lowest and highest corner of the box around a shape, along the axes of the frame that it is given in."""
    middle, reach = _matrix(shape.pose)[:3, 3], np.array([_reach_mm(shape, axis) for axis in np.eye(3)])
    return middle - reach, middle + reach


def _depth_mm(shape: ShapePart, point_mm: Float) -> float:
    """How deep a point lies within a shape; negative outside, and for a mesh."""
    pose = _matrix(shape.pose)
    at = np.abs(pose[:3, :3].T @ (point_mm - pose[:3, 3]))
    if shape.box_mm is not None:
        return float((np.array(shape.box_mm) / 2 - at).min())
    if shape.cylinder_mm is not None:
        radius, length = shape.cylinder_mm
        return float(min(radius - np.hypot(at[0], at[1]), length / 2 - at[2]))
    if shape.capsule_mm is not None:
        radius, length = shape.capsule_mm
        return float(radius - np.linalg.norm([at[0], at[1], max(at[2] - length / 2, 0.0)]))
    return -np.inf if shape.sphere_mm is None else float(shape.sphere_mm - np.linalg.norm(at))
