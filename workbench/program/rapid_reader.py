"""A RAPID module as moves that can be judged."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from workbench.artefacts import EventKind, ProgramEvent, ProgramMove, ProgramMoves, ProgramTool
from workbench.errors import InputError
from workbench.geometry.poses import pose_from, rotation_from_quaternion
from workbench.program.rapid_parser import parse_rapid
from workbench.program.rapid_program import Event, JointTarget, Move, OnController, Pose, RobTarget
from workbench.program.rapid_values import TOOL0, WOBJ0
from workbench.program.skeleton import known_events
from workbench.robot.cell_file import ProcessPart
from workbench.units import DEG, Float

KINDS = {"MoveAbsJ": "J", "MoveJ": "J", "MoveL": "L", "MoveC": "C"}
ABSENT = 9e8  # an external axis beyond this is not there (9E+09 in single precision)


def read_rapid(text: str, name: str = "program", process: ProcessPart | None = None) -> ProgramMoves:
    """Read a RAPID module with one procedure that moves.

    The turntable is the external axis eax_a; it turns what stands in the cell, the work object stays in the base.

    Args:
        text: the module.
        name: of its file, for messages.
        process: whose signals switch what; None: a program that switches any is refused.

    Raises:
        InputError: what `parse_rapid` refuses; several procedures that move, or none; an external axis other than
            eax_a; a signal or unit of no known use; a statement that a blending move would run ahead of; a stationary
            tool or a work object that the robot holds.
    """
    program = parse_rapid(text, name)
    moving = [moves for moves in program.procedures.values() if moves]
    if [one for key, found in program.events.items() if not program.procedures[key] for one in found]:
        raise InputError(name, "expected statements in the procedure that moves, and in no other")
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
    events = tuple(one for found in program.events.values() for one in found)
    _stops(moving[0], events, name)
    return ProgramMoves(
        dialect="abb",
        name=name,
        events=tuple(_events(events, process, name)),
        moves=tuple(_move(move, spelt, name, *_limits(events, i)) for i, move in enumerate(moving[0])),
        tools=named
        | {
            key: ProgramTool(_matrix(data.frame), data.mass_kg, np.array(data.centre_of_gravity_mm))
            for key, data in tools.items()
        },
        work_objects=places
        | {key: _matrix(data.user_frame) @ _matrix(data.object_frame) for key, data in objects.items()},
    )


def _stops(moves: tuple[Move, ...], events: tuple[Event, ...], name: str) -> None:
    """The controller runs ahead of a move that blends: what is switched there is switched too early."""
    for event in events:
        if event.before and moves[event.before - 1].zone_mm > 0:
            raise InputError(name, f"line {event.line}: expected a move to 'fine' before this statement")


def _limits(events: tuple[Event, ...], i: int) -> tuple[float, float]:
    """Share of the programmed feeds and largest feed, mm/s, at a move: VelSet's last words before it."""
    said = [event.arguments for event in events if event.instruction == "velset" and event.before <= i]
    percent, most = said[-1] if said else (100.0, np.inf)
    return float(percent) / 100, float(most)


def _events(events: tuple[Event, ...], process: ProcessPart | None, name: str) -> Iterator[ProgramEvent]:
    """What each statement between moves does, by the cell file's names."""
    known = known_events(process)
    plain: dict[str, EventKind] = {"waittime": "wait_time", "velset": "feed_limits", "stop": "stop", "label": "restart"}
    for event in events:
        name_of, switched = (*(str(one).lower() for one in event.arguments[:2]), "", "")[:2]
        use = {"setdo": switched, "waitdi": "wait", "actunit": "unit", "call": "call"}.get(event.instruction, "")
        kind = plain.get(event.instruction) or known.get((use, name_of))
        if kind is None:
            raise InputError(
                name,
                f"line {event.line}: expected a name and a use of the cell file's process section, "
                f"found {event.instruction} {event.arguments[0]}",
            )
        value = ",".join(f"{one:g}" if isinstance(one, float) else one for one in event.arguments)
        yield ProgramEvent(event.line, event.before, kind, value)


def _move(move: Move, spelt: dict[str, str], name: str, share: float, most_mm_s: float) -> ProgramMove:
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
        feed_mm_s=min(share * move.feed_mm_s, most_mm_s),
        zone_mm=move.zone_mm,
        turntable=None
        if isinstance(target, OnController)
        else _turntable(target.external_axes, f"{name}: line {move.line}"),
        place=target.name if isinstance(target, OnController) else "",
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
