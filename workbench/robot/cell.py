"""The robot cell: robot, tool, turntable, workpiece, fixtures, and how its stiffness is measured. Lengths in mm."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from workbench.artefacts import RobotCell
from workbench.errors import InputError
from workbench.robot.chain import Chain
from workbench.robot.margins import Margins
from workbench.robot.shapes import Shape
from workbench.units import Float

COAXIAL = 1e-3  # rad, mm: nearer than this, the cutter's axis is the flange's


@dataclass(frozen=True, slots=True, eq=False)
class Turntable:
    """A turntable under the workpiece; it turns about the z-axis of its frame."""

    base_from_turntable: Float  # (4, 4) at 0
    limits: Float  # (2,) rad
    speed: float  # rad/s, largest


@dataclass(frozen=True, slots=True, eq=False)
class LoadingSetup:
    """What is mounted on the flange for loading tests, and its noise (standard deviations of a difference).

    The tool frame is the one whose displacement is given in six dimensions; targets are tracked points.
    """

    flange_from_sensor: Float  # (4, 4)
    flange_from_tool: Float  # (4, 4)
    targets_mm: Float  # (k, 3) in the flange frame
    load_points_mm: Float  # (m, 3) in the flange frame: where a force can be applied
    force_noise_n: float
    torque_noise_nm: float
    displacement_noise_mm: float
    rotation_noise: float  # rad
    target_noise_mm: float


@dataclass(frozen=True, slots=True, eq=False)
class Controller:
    """The robot's controller, as far as a program must know it."""

    dialect: str  # abb, kuka, fanuc, ur or trajectory
    tool_number: int | None  # of the tool measured on it (KUKA, FANUC); None: the program says the tool
    frame_number: int | None  # of the frame measured on it (KUKA's base, FANUC's user frame), which is the base's
    level_joint_3: bool  # whether joint 3 counts against the ground (most of FANUC's)
    corner_region: bool  # whether FANUC's termination CR (mm) is installed


@dataclass(frozen=True, slots=True, eq=False)
class Cell(RobotCell):
    """A robot cell as its file describes it; `shapes` are the robot's links first, then all that stands around."""

    source: str  # the file's name as given, for messages
    title: str
    chain: Chain
    shapes: tuple[Shape, ...]
    flange_from_cutter: Float  # (4, 4) the tool's tip: z along the cutter's axis, from shank to tip
    turntable: Turntable | None
    loading: LoadingSetup | None
    may_touch: tuple[tuple[str, str], ...]  # pairs of bodies that are not checked
    margin_mm: float  # clearance below which a posture counts as colliding
    warnings: tuple[str, ...] = ()
    controller: Controller | None = None  # None: the file does not say
    margins: Margins = field(default_factory=Margins)
    accelerations: Float | None = None  # (6,) rad/s^2, largest of the joints; None: not stated
    controller_tools: Mapping[str, Float] = field(
        default_factory=dict
    )  # flange_from_tool (4, 4) by the controller's name
    controller_frames: Mapping[str, Float] = field(default_factory=dict)  # base_from_workobject (4, 4), likewise
    unchecked: tuple[str, ...] = ()  # what the cell file does not say, so that nothing can look at it


def within_margins(cell: Cell) -> Cell:
    """The cell with the limits of joints and turntable nearer by the margin: what is planned in it keeps the margin.

    Raises:
        InputError: a joint or a turntable that is left no range.
    """
    inwards = cell.margins.limit * np.array([1.0, -1.0])
    limits, table = cell.chain.limits + inwards, cell.turntable
    if table is not None:
        table = dataclasses.replace(table, limits=table.limits + inwards)
    if (np.diff(limits) <= 0).any() or (table is not None and table.limits[0] >= table.limits[1]):
        raise InputError(f"{cell.source}: $.margins.limit_deg", f"no range is left of a joint within "
                         f"{np.degrees(cell.margins.limit):g} deg of its limits")  # fmt: skip
    return dataclasses.replace(cell, chain=dataclasses.replace(cell.chain, limits=limits), turntable=table)


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
