"""The robot cell: robot, tool, turntable, workpiece, fixtures, and how its stiffness is measured. Lengths in mm."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np

from workbench.artefacts import Judgement, Moves, ProgramMoves, RobotCell
from workbench.errors import InputError
from workbench.robot.cell_file import ProcessPart
from workbench.robot.kinematics import Chain
from workbench.robot.margins import OFF_MM, WRITTEN_JOINT, Margins
from workbench.robot.shapes import Shape
from workbench.units import Float, Shaped

COAXIAL = 1e-3  # rad, mm: nearer than this, the cutter's axis is the flange's


@dataclass(frozen=True, slots=True, eq=False)
class Turntable:
    """A turntable under the workpiece; it turns about the z-axis of its frame."""

    base_from_turntable: Shaped[Float, "4 4"]  # at 0
    limits: Shaped[Float, " 2"]  # rad
    speed: float  # rad/s, largest
    acceleration: float | None = None  # rad/s^2, largest; None: not stated


@dataclass(frozen=True, slots=True, eq=False)
class LoadingSetup:
    """What is mounted on the flange for loading tests, and its noise (standard deviations of a difference).

    The tool frame is the one whose displacement is given in six dimensions; targets are tracked points.
    """

    flange_from_sensor: Shaped[Float, "4 4"]
    flange_from_tool: Shaped[Float, "4 4"]
    targets_mm: Shaped[Float, "k 3"]  # in the flange frame
    load_points_mm: Shaped[Float, "m 3"]  # in the flange frame: where a force can be applied
    force_noise_n: float
    torque_noise_nm: float
    displacement_noise_mm: float
    rotation_noise: float  # rad
    target_noise_mm: float


@dataclass(frozen=True, slots=True, eq=False)
class Controller:
    """The robot's controller, as far as a program must know it."""

    dialect: str  # abb, kuka, fanuc, ur, yaskawa or trajectory
    level_joint_3: bool  # whether joint 3 counts against the ground (most of FANUC's)
    corner_region: bool  # whether CR (mm) of FANUC or Yaskawa is installed


@dataclass(frozen=True, slots=True, eq=False)
class Cell(RobotCell):
    """A robot cell as its file describes it; `shapes` are the robot's links first, then all that stands around."""

    source: str  # the file's name as given, for messages
    title: str
    chain: Chain
    shapes: tuple[Shape, ...]
    flange_from_cutter: Shaped[Float, "4 4"]  # the tool's tip: z along the cutter's axis, from shank to tip
    turntable: Turntable | None
    loading: LoadingSetup | None
    may_touch: tuple[tuple[str, str], ...]  # pairs of bodies that are not checked
    margin_mm: float  # clearance below which a posture counts as colliding
    warnings: tuple[str, ...] = ()
    controller: Controller | None = None  # None: the file does not say
    margins: Margins = field(default_factory=Margins)
    accelerations: Shaped[Float, " 6"] | None = None  # rad/s^2, largest of the joints; None: not stated
    controller_tools: Mapping[str, Float] = field(
        default_factory=dict
    )  # flange_from_tool (4, 4) by the controller's name
    controller_frames: Mapping[str, Float] = field(default_factory=dict)  # base_from_workobject (4, 4), likewise
    tool_mass_kg: float | None = None
    tool_centre_of_gravity_mm: Shaped[Float, " 3"] | None = None  # in the flange
    base_from_workobject: Float = field(default_factory=lambda: np.eye(4))
    joint_stiffness_nm_per_rad: Shaped[Float, " 6"] | None = None  # of this robot; None: not stated
    material: str | None = None  # of the workpiece: whose cutting coefficients hold; None: not stated
    unchecked: tuple[str, ...] = ()  # what the cell file does not say, so that nothing can look at it
    process: ProcessPart | None = None  # what a program does around the milling; None: not stated
    unseen: tuple[str, ...] = ()  # what stands in the cell and no body was given for

    @property
    def rated_accelerations(self) -> Float | None:
        """Largest of the joints and the turntable (7,), rad/s^2, inf where the file states none; None: it states no."""
        table = self.turntable.acceleration if self.turntable else None
        if self.accelerations is None and table is None:
            return None
        joints = np.full(6, np.inf) if self.accelerations is None else self.accelerations
        return np.append(joints, np.inf if table is None else table)

    @property
    def tool_name(self) -> str | None:
        """Of the tool as the controller has it; None: programs declare it."""
        return next(iter(self.controller_tools), None)

    @property
    def work_object_name(self) -> str | None:
        """Of the work object as the controller has it; None: programs declare it."""
        return next(iter(self.controller_frames), None)

    def judge(
        self,
        program: ProgramMoves,
        moves: Moves,
        tolerance_mm: float,
        configuration: Callable[..., tuple[int, ...] | None],
    ) -> Judgement:
        """Drive a program through this cell (`workbench.robot.judge`)."""
        from workbench.robot.judge import judge
        from workbench.robot.surface import Planned

        postures = moves.postures
        assert postures is not None
        planned = Planned(moves.toolpath, postures.planned_turntable, tolerance_mm, postures.flange_from_point)
        return judge(self, program, planned, configuration)


def within_margins(cell: Cell) -> Cell:
    """The cell with limits nearer by their margins, and all of it by what a program may be off its postures.

    What is planned in it keeps the margins as a program too.

    Raises:
        InputError: a joint or a turntable that is left no range.
    """
    inwards = np.array([1.0, -1.0])
    limits, table = cell.chain.limits + (cell.margins.limit + WRITTEN_JOINT) * inwards, cell.turntable
    if table is not None:
        kept = turntable_margin(cell) + WRITTEN_JOINT
        table = dataclasses.replace(table, limits=table.limits + kept * inwards)
    if (np.diff(limits) <= 0).any():
        raise InputError(
            f"{cell.source}: $.margins.limit_deg",
            f"no range is left of a joint within {np.degrees(cell.margins.limit):g} deg of its limits",
        )
    chain = dataclasses.replace(cell.chain, limits=limits)
    return dataclasses.replace(cell, chain=chain, turntable=table, margin_mm=cell.margin_mm + OFF_MM)


def turntable_margin(cell: Cell) -> float:
    """What the turntable keeps from its limits, rad: the margin, but no more than a quarter of a narrow range."""
    return 0.0 if cell.turntable is None else float(min(cell.margins.limit, np.ptp(cell.turntable.limits) / 4))


def spindle_warning(flange_from_cutter: Float) -> str | None:
    """What to say of a spindle whose axis is the flange's own: turning the cutter about it is turning joint 6."""
    axis, at = flange_from_cutter[:3, 2], flange_from_cutter[:3, 3]
    off = np.hypot(at[0], at[1])
    if np.hypot(axis[0], axis[1]) > COAXIAL or off > COAXIAL:
        return None
    return (
        "the spindle is coaxial with the flange: joint 6 alone turns the cutter about its axis, so the cutter rotation "
        "changes no posture and no displacement; mount the spindle at an angle or offset"
    )
