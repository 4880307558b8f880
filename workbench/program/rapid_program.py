"""What a RAPID module says, as values: the result of `parse_rapid`."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from workbench.units import Float

Numbers = tuple[float, ...]


class Pose(NamedTuple):
    """A frame in another."""

    position_mm: Numbers  # 3
    quaternion_wxyz: Numbers  # 4


class RobTarget(NamedTuple):
    """Where a move leads, in its work object."""

    position_mm: Numbers  # 3
    quaternion_wxyz: Numbers  # 4
    configuration: Numbers  # 4: cf1, cf4, cf6, cfx
    external_axes: Numbers  # 6, deg or mm; 9E+09: not there


class JointTarget(NamedTuple):
    """Where a move of the axes leads."""

    joints_deg: Numbers  # 6
    external_axes: Numbers  # 6


class ToolData(NamedTuple):
    """A tool: its frame in the flange and its load."""

    held_by_robot: bool
    frame: Pose
    mass_kg: float
    centre_of_gravity_mm: Numbers  # 3


class WorkObject(NamedTuple):
    """A work object: the object's frame in the user's, the user's in the world."""

    held_by_robot: bool
    user_frame: Pose
    object_frame: Pose


class OnController(NamedTuple):
    """A joint target that the module does not declare: the controller has it."""

    name: str


class Event(NamedTuple):
    """A statement between moves: SetDO, WaitDI, WaitTime, ActUnit, VelSet, Stop, label, or call."""

    instruction: str
    arguments: tuple[str | float, ...]
    before: int  # index of the move of the procedure that comes next
    line: int  # of the file, from 1


class Move(NamedTuple):
    """One move: MoveL, MoveC, MoveJ (to a RobTarget) or MoveAbsJ (to joint angles)."""

    instruction: str
    target: RobTarget | JointTarget | OnController
    via: RobTarget | None  # of MoveC
    feed_mm_s: float
    zone_mm: float  # 0: fine
    tool: str
    work_object: str
    line: int  # of the file, from 1


@dataclass(frozen=True, slots=True, eq=False)
class RapidProgram:
    """One module."""

    module: str
    tools: dict[str, ToolData]
    work_objects: dict[str, WorkObject]
    procedures: dict[str, tuple[Move, ...]]
    events: dict[str, tuple[Event, ...]] = field(default_factory=dict)  # by procedure

    @property
    def moves(self) -> tuple[Move, ...]:
        """All moves, procedure after procedure."""
        return tuple(move for moves in self.procedures.values() for move in moves)

    @property
    def poses(self) -> tuple[Float, Float]:
        """Positions (k, 3) in mm and unit quaternions (k, 4) of all targets in space."""
        targets = [move.target for move in self.moves if isinstance(move.target, RobTarget)]
        q = np.array([target.quaternion_wxyz for target in targets]).reshape(-1, 4)
        position = np.array([target.position_mm for target in targets]).reshape(-1, 3)
        return position, q / np.linalg.norm(q, axis=1, keepdims=True)
