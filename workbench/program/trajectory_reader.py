"""A strict reader for joint trajectories: the CSV and the JSON of one must say the same."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import NoReturn

import numpy as np

from workbench.artefacts import ProgramMove, ProgramMoves, ProgramTool
from workbench.errors import InputError
from workbench.geometry.poses import is_rigid
from workbench.program.reading import NUMBER, Lines, one_file
from workbench.units import DEG, Float

COLUMNS = ("time_s", *(f"j{i}_deg" for i in range(1, 7)), "turntable_deg", "layer")
TOOL, BASE = "tool", "base"


def read_trajectory(files: Mapping[str, str]) -> ProgramMoves:
    """Read a joint trajectory from its CSV and JSON, name -> text; its base is the robot's.

    Raises:
        InputError: "line 12: expected ..., found ..."; times that do not rise from 0; a JSON that says something else.
    """
    name, text = one_file(files, ".csv")
    lines = Lines(text, name, "#")
    lines.take(",".join(COLUMNS), "the names of the columns: " + ",".join(COLUMNS))
    moves: list[ProgramMove] = []
    rows: list[list[float]] = []
    while lines.more:
        found = lines.take(",".join([NUMBER] * 8) + r",(\d+)", f"{len(COLUMNS)} numbers")
        row = [float(part) for part in found.groups()]
        if row[0] <= (rows[-1][0] if rows else -1.0) or (not rows and row[0] != 0.0):
            lines.refuse("times that rise from 0", found[0])
        rows.append(row)
        moves.append(
            ProgramMove(
                lines.number, "J", TOOL, BASE, joints=np.array(row[1:7]) * DEG, turntable=row[7] * DEG, time_s=row[0]
            )
        )
    if len(moves) < 2:
        raise InputError(name, f"expected at least two rows, found {len(moves)}")
    tool = _same(rows, *one_file(files, ".json"))
    return ProgramMoves(
        "trajectory", name, tuple(moves), {TOOL: ProgramTool(tool)}, {BASE: np.eye(4)}, remarks=tuple(lines.remarks)
    )


def _same(rows: list[list[float]], name: str, text: str) -> Float:
    """The tool (4, 4) that the JSON says, if its rows are those of the CSV."""

    def constant(found: str) -> NoReturn:
        raise ValueError(found)

    try:
        document = json.loads(text, parse_constant=constant)
        head = [document[key] for key in ("format", "version", "columns")]
        same = head == ["joint-trajectory", 1, list(COLUMNS)] and document["points"] == rows
        tool = np.array(document["flange_from_tool"], float)
    except (ValueError, KeyError, TypeError, RecursionError):
        same, tool = False, np.empty(0)
    if not same or tool.shape != (4, 4) or not is_rigid(tool):
        raise InputError(name, "expected a joint trajectory, version 1, with a tool and the rows of the CSV")
    return tool
