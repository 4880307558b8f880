"""What a program does around the milling, held against the cell file's `process` section."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator

import numpy as np

from workbench.artefacts import ProgramMove, ProgramMoves
from workbench.robot.bounds import CollisionScreen
from workbench.robot.cell_file import HomePart, ProcessPart
from workbench.robot.cell_model import Cell
from workbench.robot.collision import outermost
from workbench.robot.inverse import inverse_kinematics
from workbench.robot.kinematics import forward_kinematics
from workbench.robot.way import nearest_branch
from workbench.units import DEG, Float, Shaped

NO_PROCESS = "the way to the first posture and back home, spindle and coolant: the program does none of it"
SAME_PLACE = 0.001 * DEG  # joint angles that are home's: what the digits of a program may turn them by


def not_seen(cell: Cell, process: ProcessPart, dialect: str) -> Iterator[str]:
    """What nobody can look at although the process is stated: stands in the program's head."""
    standstill = "stands" if turns_freely(cell, process.home) else "and its external axes stand"
    yield f"the way from where the robot {standstill} to home"
    if cell.without_contact.may_touch != cell.may_touch:
        yield "the cutter against the plate between the path's ends and the points of approach and retract"
    if process.home.controller_name:
        yield f"that {process.home.controller_name} on the controller is the cell file's home"
    if process.spindle is None:
        yield "the spindle: the cell file names no signals ($.process.spindle)"
    elif process.spindle.at_speed_signal is None:
        yield "that the spindle is at speed: no signal says so, the program waits for some time"
    if hooks := (*process.before, *process.after):
        yield f"what these routines do: {', '.join(hooks)}"
    if process.restart and dialect == "ur":
        yield "restart points: URScript has none, a program begins at its begin"
    elif process.restart:
        yield "the way to a restart point: lead the robot by hand to the target before its label"


def turns_freely(cell: Cell, home: HomePart) -> bool:
    """Whether, with the robot at home, the external axis may go from anywhere to anywhere; of two nothing is proven."""
    if cell.turntable is None or len(cell.axes) > 1:
        return cell.turntable is None
    places = np.linspace(cell.turntable.limits[0], cell.turntable.limits[1], 1000)
    joints = np.tile(home.joints, (len(places), 1))
    return not CollisionScreen(cell.without_contact).swept(joints[None], places[None]).any()


def placed(program: ProgramMoves, cell: Cell) -> ProgramMoves:
    """The program with home filled in where it names the controller's."""
    process = cell.process
    if process is None or not process.home.controller_name:
        return program
    home, name = process.home, process.home.controller_name.lower()
    table = turntable_at_home(home, outermost(cell, np.zeros(()))) * DEG

    def filled(move: ProgramMove) -> ProgramMove:
        if move.place.lower() != name:
            return move
        return dataclasses.replace(move, joints=home.joints, turntable=table)

    return dataclasses.replace(program, moves=tuple(filled(move) for move in program.moves))


def disorders(program: ProgramMoves, process: ProcessPart) -> Iterator[tuple[int, str]]:
    """Index of the move and what is wrong: it must begin and end at home, and mill with the spindle at speed."""
    home = process.home.joints
    for i in (0, len(program.moves) - 1):
        joints = program.moves[i].joints
        if joints is None or np.abs(joints - home).max() > SAME_PLACE:
            yield i, f"the program {'ends' if i else 'begins'} elsewhere than at the cell file's home"
    turns, ready = False, process.spindle is None
    events = sorted(program.events, key=lambda event: event.line)
    for i, move in enumerate(program.moves):
        for event in (one for one in events if one.before == i):
            turns = event.kind == "spindle_on" or (turns and event.kind != "spindle_off")
            if process.spindle is not None and event.kind in ("spindle_on", "spindle_off"):
                ready = False
            awaited = "wait_speed" if process.spindle and process.spindle.at_speed_signal else "wait_time"
            ready = ready or (turns and event.kind == awaited)
        if move.kind != "J" and not ready:
            yield i, "the tool moves along a path before the spindle is on and at speed"
            break
    if process.spindle and turns:
        yield len(program.moves) - 1, "the spindle still turns on the way home"


def drawn_back(cell: Cell, joints: Shaped[Float, " 6"], distance_mm: float) -> Float | None:
    """The posture (6,) with the cutter drawn back along its axis: of all, the nearest to `joints`; None: none."""
    flange = forward_kinematics(cell.chain, joints)
    flange[:3, 3] -= distance_mm * (flange @ cell.flange_from_cutter)[:3, 2]
    (found,) = nearest_branch(inverse_kinematics(cell.chain, flange[None]), joints[None])
    return None if np.isnan(found).any() else np.asarray(found)


def turntable_at_home(home: HomePart, first_deg: Float | float) -> Float:
    """Values at home of one external axis (), or of tilt and turntable (2,), deg.

    As stated, or where the path has them first; a home of the controller has them at 0.
    """
    first = np.asarray(first_deg, float)
    one = home.turntable_deg if home.track_mm is None else home.track_mm
    stated = [home.tilt_deg, home.turntable_deg] if first.ndim else [one]
    free = 0.0 * first if home.controller_name else first
    said = np.array(stated, float).reshape(first.shape)  # None: NaN
    return np.asarray(np.where(np.isnan(said), free, said))
