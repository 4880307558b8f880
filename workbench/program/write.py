"""`program.write`: the path as a program in the language of the robot's controller."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Annotated, Literal

from pydantic import AfterValidator, Field

from workbench.artefacts import Chapter, Document, Judgement, Moves, PathGate, RobotCell
from workbench.dialect import Dialect, ProgramJob, released, write_program
from workbench.errors import InputError
from workbench.program.chapter import program_chapter
from workbench.program.fanuc import Fanuc
from workbench.program.krl import Krl
from workbench.program.names import program_name
from workbench.program.parameters import Zone, program_job
from workbench.program.rapid import Rapid
from workbench.program.rapid_words import free_name
from workbench.program.trajectory import Trajectory
from workbench.program.urscript import UrScript
from workbench.robot.cell import Cell
from workbench.robot.process import NO_PROCESS, not_seen
from workbench.stage import stage

Controller = Literal["abb", "kuka", "fanuc", "ur", "trajectory"]
Name = Annotated[str, AfterValidator(free_name)]
OTHERS: dict[str, Callable[[ProgramJob, Cell], Dialect]] = {
    "kuka": Krl,
    "fanuc": Fanuc,
    "ur": UrScript,
    "trajectory": Trajectory,
}


@stage("program.write")
def write(
    moves: Moves,
    gate: PathGate,
    cell: RobotCell | None = None,
    *,
    controller: Annotated[
        Controller | None,
        Field(
            description="whose language: RAPID, KRL, FANUC's TP, URScript, or joint angles over time; null: the cell's"
        ),
    ] = None,
    name: Annotated[str, AfterValidator(program_name), Field(description="of the program and its files")] = "BevelPath",
    procedure: Annotated[Name, Field(description="RAPID: name of the procedure that mills")] = "MillBevel",
    tool_name: Annotated[Name, Field(description="RAPID: name of the tool data")] = "tMill",
    work_object_name: Annotated[Name, Field(description="RAPID: name of the work object")] = "woEdge",
    zone_mm: Zone = 0.3,
) -> tuple[Document | PathGate | Judgement | Chapter, ...]:
    """Write the moves as a program for the robot's controller (docs/controllers.md).

    `abb`: a RAPID module. `kuka`: KRL, `.src` and `.dat`. `fanuc`: TP as ASCII, `.ls`. `ur`: URScript. `trajectory`:
    joint angles and external axis over time, as CSV and JSON. A program is written only where the pipeline knows the
    robot's cell, for moves that rest on postures (`stiffness.posture`); it begins with a move of the axes to the first
    one. Its files are read back by the dialect's own strict reader and driven through the cell, between all targets
    (docs/programs.md). What fails leaves no program: the gate says line, place and what is wrong. What the cell file
    does not state stands in the program's head as NOT CHECKED, and the exit status is 1. `program_check.json` tells
    how near the program came to anything.

    Tool and work object are those of the controller where the cell file names them: then the tool is the cutter's tip.
    Otherwise the program declares them: the tool centre point lies on the cutter's flank, a radius off its axis.
    Positions have 3 decimals or more, orientations 3 of a degree or more. Feeds have 3 significant digits. Circular
    moves turn the tool in the frame of the work object, as `path.simplify` assumes. Files are ASCII; names out of
    recordings stand in comments only, filtered. Nothing is written where the gate rejects the path.

    Args:
        moves: the path as straight and circular moves.
        gate: of this path's own checks.
        cell: the robot cell; without one nothing is written, and the gate is passed on.
        controller: the maker of the controller; null: what the cell's file says.
        name: of the program and its files.
        procedure: name of the procedure.
        tool_name: name of the tool data, where the program declares it.
        work_object_name: name of the work object, likewise.

    Raises:
        InputError: two of RAPID's names are the same; the gate is another path's; a cell, but no postures; moves that
            leave the path farther than its check allows for; what the controller cannot do (URScript: a turntable
            that turns).
    """
    known = cell.controller.dialect if isinstance(cell, Cell) and cell.controller else None
    chosen = controller or known
    if not isinstance(cell, Cell):
        released(name, moves.toolpath, gate, cell, moves)
        return (gate,)
    if chosen is None:
        raise InputError(
            f"{cell.source}: $.controller",
            "expected the make of the robot's controller: abb, kuka, "
            "fanuc, ur or trajectory (or the pipeline's input 'controller')",
        )
    if not released(name, moves.toolpath, gate, cell, moves):
        return (gate,)
    if known not in (None, chosen):
        said = f"that the controller takes it: the cell names {known}, and this is for {chosen}"
        gate = dataclasses.replace(gate, unchecked=(*gate.unchecked, said))
    if cell.process is not None:
        told = chosen != "trajectory"
        open_ = not_seen(cell.process, chosen) if told else (f"{NO_PROCESS} (a trajectory has no words for it)",)
        cell = dataclasses.replace(cell, process=cell.process if told else None, unseen=(*cell.unseen, *open_))
    job = program_job(name, moves, cell, zone_mm, gate.tolerance_mm)
    dialect = (
        _rapid(job, cell, procedure, tool_name, work_object_name) if chosen == "abb" else OTHERS[chosen](job, cell)
    )
    written = write_program(dialect, gate, cell)
    if written.judgement is None:
        return (written.gate,)
    return (*written.documents, written.gate, written.judgement, program_chapter(written.judgement, written.gate, cell))


def _rapid(job: ProgramJob, cell: Cell, procedure: str, tool_name: str, work_object_name: str) -> Rapid:
    names = [job.name, procedure, tool_name, work_object_name]
    if len({name.lower() for name in names}) < len(names):
        raise InputError("program.write", f"expected four different names, got {', '.join(names)}")
    return Rapid(job, cell, procedure, tool_name, work_object_name)
