"""`program.write`: the path as a program in the language of the robot's controller."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Annotated, Literal

from pydantic import AfterValidator, Field

from workbench.artefacts import Document, Moves, PathGate, RobotCell
from workbench.dialect import Dialect, ProgramJob, released, write_program
from workbench.errors import InputError
from workbench.program.fanuc import Fanuc
from workbench.program.krl import Krl
from workbench.program.names import program_name
from workbench.program.parameters import (
    TOOL_CENTRE_OF_GRAVITY_MM,
    TOOL_POSITION_MM,
    UPRIGHT,
    ToolCentreOfGravity,
    ToolMass,
    ToolPosition,
    ToolQuaternion,
    Zone,
    tool,
)
from workbench.program.rapid import Rapid
from workbench.program.rapid_words import free_name
from workbench.program.trajectory import Trajectory
from workbench.program.urscript import UrScript
from workbench.robot.cell import Cell
from workbench.stage import stage

Controller = Literal["abb", "kuka", "fanuc", "ur", "trajectory"]
Name = Annotated[str, AfterValidator(free_name)]
OTHERS: dict[str, Callable[[ProgramJob, Cell], Dialect]] = {
    "kuka": Krl, "fanuc": Fanuc, "ur": UrScript, "trajectory": Trajectory,
}  # fmt: skip


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
    tool_position_mm: ToolPosition = TOOL_POSITION_MM,
    tool_quaternion_wxyz: ToolQuaternion = UPRIGHT,
    tool_mass_kg: ToolMass = 15.0,
    tool_centre_of_gravity_mm: ToolCentreOfGravity = TOOL_CENTRE_OF_GRAVITY_MM,
    zone_mm: Zone = 0.3,
) -> tuple[Document, ...]:
    """Write the moves as a program for the robot's controller (docs/controllers.md).

    `abb`: a RAPID module. `kuka`: KRL, `.src` and `.dat`. `fanuc`: TP as ASCII, `.ls`. `ur`: URScript. `trajectory`:
    joint angles and external axis over time, as CSV and JSON. All but RAPID need postures (`stiffness.posture`): their
    programs begin with a move of the axes to the first one. Positions have 3 decimals or more, orientations 3 of a
    degree or more. Feeds have 3 significant digits. The tool centre point lies on the cutter's flank, a radius off its
    axis. Circular moves turn the tool in the frame of the work object, as `path.simplify` assumes. Files are ASCII;
    names out of recordings stand in comments only, filtered. Nothing is written where the gate rejects the path.

    Args:
        moves: the path as straight and circular moves.
        gate: of this path's own checks.
        cell: the robot cell, where the pipeline has one: then the moves must rest on postures.
        controller: the maker of the controller; null: what the cell's file says, RAPID where it says nothing.
        name: of the program and its files.
        procedure: name of the procedure.
        tool_name: name of the tool data.
        work_object_name: name of the work object.

    Raises:
        InputError: two of RAPID's names are the same; the gate is another path's; a cell, but no postures; moves that
            leave the path farther than its check allows for; what the controller cannot do (URScript: a turntable
            that turns).
    """
    known = cell.controller.dialect if isinstance(cell, Cell) and cell.controller else None
    chosen = controller or known or "abb"
    if gate and not known and not controller:
        said = "the make of the controller, which neither cell nor pipeline names"
        gate = dataclasses.replace(gate, unchecked=(*gate.unchecked, said))
    spindle = tool(tool_position_mm, tool_quaternion_wxyz, tool_mass_kg, tool_centre_of_gravity_mm, moves)
    job = ProgramJob(name, moves, spindle, zone_mm, moves.turntable_deg, gate.tolerance_mm if gate else 0.0)
    if chosen == "abb":
        return write_program(_rapid(job, procedure, tool_name, work_object_name), gate, cell)
    if not isinstance(cell, Cell):  # its programs say postures, and there are none without a cell
        released(name, moves.toolpath, gate, cell, moves)
        return ()
    return write_program(OTHERS[chosen](job, cell), gate, cell)


def _rapid(job: ProgramJob, procedure: str, tool_name: str, work_object_name: str) -> Rapid:
    names = [job.name, procedure, tool_name, work_object_name]
    if len({name.lower() for name in names}) < len(names):
        raise InputError("program.write", f"expected four different names, got {', '.join(names)}")
    return Rapid(job, procedure, tool_name, work_object_name)
