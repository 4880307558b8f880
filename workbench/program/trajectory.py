"""A joint trajectory: when each posture is reached, for controllers and simulators that take points over time.

One row for every posture of the path, travels included: time in s, the six joint angles and the turntable in deg, and
which layer it belongs to (0: travel). CSV, and JSON with the names of the joints. Between two rows all
angles go evenly. The time of a row is that of the path's feed, longer where a joint or the turntable could not
follow. There is no way to the first row: the robot must stand there.
"""

from __future__ import annotations

import functools
import json
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, NoReturn

import numpy as np

from workbench.artefacts import ProgramMove, ProgramMoves, ProgramTool
from workbench.dialect import ProgramJob
from workbench.errors import InputError
from workbench.geometry.poses import is_rigid
from workbench.program.reading import NUMBER, Lines, one_file
from workbench.robot.cell import Cell
from workbench.units import DEG, Float, Int

# A strict reader for joint trajectories: the CSV and the JSON of one must say the same.

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


@dataclass
class Trajectory:
    """Joint angles over time, as a table."""

    job: ProgramJob
    cell: Cell

    @functools.cached_property
    def rows(self) -> list[list[float]]:
        """Of all postures that differ from the one before: time, joints, turntable, layer."""
        made = self.job.moves.postures
        assert made is not None
        angles = np.column_stack([made.joints, made.turntable]) / DEG
        rows: list[list[float]] = np.column_stack([self._times(), angles, made.layer])[self.kept].tolist()
        return rows

    @functools.cached_property
    def kept(self) -> Int:
        """Indices of those postures."""
        return np.flatnonzero(np.append(True, np.diff(self._times()) > 0))

    def _times(self) -> Float:
        """When each posture is reached, s, rounded up to a microsecond a step."""
        made, table = self.job.moves.postures, self.cell.turntable
        assert made is not None
        way = np.linalg.norm(np.diff(made.position_mm, axis=0), axis=1) / made.feed_mm_s[1:]
        joints = (np.abs(np.diff(made.joints, axis=0)) / self.cell.chain.speeds).max(axis=1)
        turn = np.abs(np.diff(made.turntable)) / (table.speed if table else 1.0)
        steps = np.ceil(np.maximum(np.maximum(way, joints), turn) * 1e6) / 1e6
        return np.append(0.0, np.cumsum(steps))

    def head(self) -> Iterator[str]:
        """Remarks and the columns' names."""
        yield from (self.remark(one) for one in self.job.remarks)
        yield ",".join(COLUMNS)

    def start(self) -> Iterable[str]:
        """The first posture."""
        return self._between(-1, 0)

    def straight(self, i: int) -> Iterable[str]:
        """All postures up to target i."""
        assert self.job.moves.point is not None
        before, here = self.job.moves.point[i - 1 : i + 1].tolist()
        return self._between(before, here)

    def circular(self, i: int) -> Iterable[str]:
        """Likewise: the postures lie on the arc."""
        return self.straight(i)

    def remark(self, text: str) -> str:
        """Up to the end of the line."""
        return f"# {text}"

    def foot(self) -> Iterable[str]:
        """Nothing."""
        return []

    def read(self, files: Mapping[str, str]) -> ProgramMoves:
        """Turn it back."""
        return read_trajectory(files)

    def configuration(self, joints: Float, cell: Cell) -> None:
        """It says the angles themselves."""

    def documents(self, text: str) -> dict[str, str]:
        """The table as CSV, and as JSON."""
        remarks = [line.removeprefix("# ") for line in text.splitlines() if line.startswith("#")]
        document: dict[str, Any] = {
            "format": "joint-trajectory",
            "version": 1,
            "joint_names": list(self.cell.chain.joint_names),
            "flange_from_tool": self._tool(),
            "columns": list(COLUMNS),
            "remarks": remarks,
            "points": [_tidy(row) for row in self.rows],
        }
        return {f"{self.job.name}.csv": text, f"{self.job.name}.json": json.dumps(document, indent=1) + "\n"}

    def _tool(self) -> list[list[float]]:
        """The tool frame that the postures rest on."""
        pose = self.job.moves.flange_from_point
        assert pose is not None
        rows: list[list[float]] = (np.round(pose, 9) + 0.0).tolist()
        return rows

    def _between(self, before: int, last: int) -> list[str]:
        first, end = np.searchsorted(self.kept, [before, last], side="right").tolist()
        return [",".join(map(str, _tidy(row))) for row in self.rows[first:end]]


def _tidy(row: list[float]) -> list[float | int]:
    """Time to a microsecond, angles to 0.000001 deg."""
    return [*(round(value, 6) + 0.0 for value in row[:-1]), int(row[-1])]
