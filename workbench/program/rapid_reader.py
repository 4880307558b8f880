"""A RAPID module as moves that can be judged."""

from __future__ import annotations

import numpy as np

from workbench.artefacts import ProgramMove, ProgramMoves, ProgramTool
from workbench.errors import InputError
from workbench.geometry.poses import pose_from, rotation_from_quaternion
from workbench.program.rapid_parser import parse_rapid
from workbench.program.rapid_program import JointTarget, Move, Pose, RobTarget
from workbench.program.rapid_values import TOOL0, WOBJ0
from workbench.units import DEG, Float

KINDS = {"MoveAbsJ": "J", "MoveJ": "J", "MoveL": "L", "MoveC": "C"}
ABSENT = 9e8  # an external axis beyond this is not there (9E+09 in single precision)


def read_rapid(text: str, name: str = "program") -> ProgramMoves:
    """Read a RAPID module with one procedure that moves.

    The turntable is the external axis eax_a; it turns what stands in the cell, the work object stays in the base.

    Args:
        text: the module.
        name: of its file, for messages.

    Raises:
        InputError: what `parse_rapid` refuses; several procedures that move, or none; an external axis other than
            eax_a; a stationary tool or a work object that the robot holds.
    """
    program = parse_rapid(text, name)
    moving = [moves for moves in program.procedures.values() if moves]
    if len(moving) != 1:
        raise InputError(name, f"expected one procedure that moves, found {len(moving)}")
    tools = {"tool0": TOOL0, **program.tools}
    objects = {"wobj0": WOBJ0, **program.work_objects}
    for tool, data in tools.items():
        if not data.held_by_robot:
            raise InputError(name, f"expected a tool that the robot holds, '{tool}' is stationary")
    for place, where in objects.items():
        if where.held_by_robot:
            raise InputError(name, f"expected a work object that stands, the robot holds '{place}'")
    declared = {key.lower() for key in (*tools, *objects)}
    named = {move.tool: ProgramTool(None) for move in moving[0] if move.tool.lower() not in declared}
    places: dict[str, Float | None] = {
        move.work_object: None for move in moving[0] if move.work_object.lower() not in declared
    }
    spelt = {key.lower(): key for key in (*named, *places, *tools, *objects)}
    return ProgramMoves(
        dialect="abb",
        name=name,
        moves=tuple(_move(move, spelt, name) for move in moving[0]),
        tools=named
        | {
            key: ProgramTool(_matrix(data.frame), data.mass_kg, np.array(data.centre_of_gravity_mm))
            for key, data in tools.items()
        },
        work_objects=places
        | {key: _matrix(data.user_frame) @ _matrix(data.object_frame) for key, data in objects.items()},
    )


def _move(move: Move, spelt: dict[str, str], name: str) -> ProgramMove:
    target = move.target
    joints = np.array(target.joints_deg) * DEG if isinstance(target, JointTarget) else None
    return ProgramMove(
        line=move.line,
        kind=KINDS[move.instruction],  # type: ignore[arg-type]
        tool=spelt[move.tool.lower()],
        work_object=spelt[move.work_object.lower()],
        joints=joints,
        pose=_of_target(target) if isinstance(target, RobTarget) else None,
        via=None if move.via is None else _of_target(move.via),
        feed_mm_s=move.feed_mm_s,
        zone_mm=move.zone_mm,
        turntable=_turntable(target.external_axes, f"{name}: line {move.line}"),
        configuration=tuple(int(part) for part in target.configuration) if isinstance(target, RobTarget) else None,
    )


def _turntable(axes: tuple[float, ...], where: str) -> float | None:
    """Angle of eax_a in rad; None: it is not there."""
    if any(axis < ABSENT for axis in axes[1:]):
        raise InputError(where, "expected no external axis but eax_a")
    return axes[0] * DEG if axes[0] < ABSENT else None


def _of_target(target: RobTarget) -> Float:
    return _matrix(Pose(target.position_mm, target.quaternion_wxyz))


def _matrix(pose: Pose) -> Float:
    q = np.array(pose.quaternion_wxyz)
    return pose_from(rotation_from_quaternion(q / np.linalg.norm(q)), np.array(pose.position_mm))
