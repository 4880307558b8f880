"""Programs in every language: as they are written, before anybody judges them, and as they are read back."""

from __future__ import annotations

from typing import Any

from workbench.artefacts import Moves, PathGate, ProgramMoves
from workbench.dialect import ProgramJob, program_files
from workbench.program.rapid import Rapid
from workbench.program.write_stage import OTHERS, program_job
from workbench.robot import Cell

from .conftest import passed

NAMES = ("BevelPath", "MillBevel", "tMill", "woEdge")  # of program, procedure, tool and work object


def job_of(moves: Moves, cell: Cell, zone_mm: float = 0.3, name: str = NAMES[0]) -> ProgramJob:
    return program_job(name, moves, cell, zone_mm, 0.05)


def dialect_of(moves: Moves, cell: Cell, controller: str, zone_mm: float = 0.3, names: Any = NAMES) -> Any:
    job = job_of(moves, cell, zone_mm, names[0])
    return Rapid(job, cell, *names[1:]) if controller == "abb" else OTHERS[controller](job, cell)


def files(moves: Moves, cell: Cell, controller: str, zone_mm: float = 0.3, gate: PathGate | None = None) -> Any:
    """Names and texts of the program's files."""
    return dict(program_files(dialect_of(moves, cell, controller, zone_mm), gate or passed(moves.toolpath)))


def back(moves: Moves, cell: Cell, controller: str, written: dict[str, str]) -> ProgramMoves:
    return dialect_of(moves, cell, controller).read(written)


def text(moves: Moves, cell: Cell, zone_mm: float = 0.3, gate: PathGate | None = None, names: Any = NAMES) -> str:
    """The program for ABB, which is one file."""
    dialect = dialect_of(moves, cell, "abb", zone_mm, names)
    (content,) = program_files(dialect, gate or passed(moves.toolpath)).values()
    return content


def from_text(written: str, moves: Moves, cell: Cell) -> ProgramMoves:
    return back(moves, cell, "abb", {"BevelPath.mod": written})
