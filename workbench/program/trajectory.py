"""A joint trajectory: when each posture is reached, for controllers and simulators that take points over time.

Rows for every posture of the path, travels included: time in s, the six joint angles and the turntable in deg, and
which layer it belongs to (0: travel). CSV, and JSON with the names of the joints. Between two rows all angles go
evenly; where postures lie so far apart, or the turntable turns so fast, that they would leave the path, there are rows
between the postures. The time of a row is that of the path's feed, longer where a joint or the turntable could not
follow by its speed or, where the cell states it, its acceleration: also from the standstill at the first row and to
that at the last one. There is no way to the first row: the robot must stand there.
"""

from __future__ import annotations

import functools
import json
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, NoReturn

import numpy as np

from workbench.artefacts import Postures, ProgramMoves, ProgramTool
from workbench.dialect import ProgramJob
from workbench.errors import InputError
from workbench.geometry.moves import chords_mm
from workbench.geometry.poses import (
    inverse,
    is_rigid,
    pose_from,
    quaternion_from_rotation,
    rotation_from_quaternion,
    slerp,
)
from workbench.kernels import kernel
from workbench.language import Language, row
from workbench.program.reading import Reading, one_file
from workbench.robot.cell_model import Cell
from workbench.robot.collision import turntable_pose
from workbench.robot.inverse import inverse_kinematics
from workbench.robot.kinematics import forward_kinematics
from workbench.robot.way import nearest_branch
from workbench.units import DEG, AnyArray, Float, Int

COLUMNS = ("time_s", *(f"j{i}_deg" for i in range(1, 7)), "turntable_deg", "layer")
TOOL, BASE = "tool", "base"
DIGITS = 6  # of angles in deg
SHARE = 0.99  # of speeds and accelerations: the rest is for what digits of times add
LEAST_S = 1e-6  # between two rows
ROW_SHARE, MOST_ROWS = 0.25, 100  # of the tolerance of the path, by which rows may leave it; rows to a posture
MOST_SWEEPS = 200  # forth and back: a few suffice, each corner meets its neighbours
NEARLY = 1 + 1e-6


TABLE = Language(
    forms={"columns": ",".join(COLUMNS), "row": f"{row([''] * 8, 'numbers', f'.{DIGITS}f')},{{layer:d}}"},
    order={"": ("columns",), "columns": ("row",), "row": ("row", "")},
    comment="#",
)


class Table(Reading):
    """A joint trajectory: the CSV, row by row, of which the JSON must say the same; its base is the robot's."""

    language, dialect, suffix = TABLE, "trajectory", ".csv"

    def __init__(self) -> None:
        super().__init__()
        self.rows: list[list[float]] = []
        self.tool, self.work_object, self.objects = TOOL, BASE, {BASE: np.eye(4)}

    def program(self, files: Mapping[str, str]) -> ProgramMoves:
        """The program of both files."""
        read = super().program(files)
        if len(self.moves) < 2:
            raise InputError(self.name, f"expected at least two rows, found {len(self.moves)}")
        self.tools[TOOL] = ProgramTool(_same(self.rows, *one_file(files, ".json")))
        return read

    columns = Reading.header

    def row(self, numbers: list[float], layer: int) -> None:
        if numbers[0] <= (self.rows[-1][0] if self.rows else -1.0) or (not self.rows and numbers[0] != 0.0):
            self.refuse("times that rise from 0")
        self.rows.append([*numbers, float(layer)])
        joints, table = np.array(numbers[1:7]) * DEG, numbers[7] * DEG
        self.move("J", joints=joints, turntable=table, time_s=numbers[0], layer=layer)


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

    @property
    def made(self) -> Postures:
        """That it goes through."""
        assert self.job.moves.postures is not None
        return self.job.moves.postures

    @functools.cached_property
    def rows(self) -> list[list[float]]:
        """All that differ from the one before: time, joints, turntable, layer."""
        angles, towards, _ = self._fine
        columns = [self._times(), angles[self.kept], self.made.layer[towards[self.kept]]]
        rows: list[list[float]] = np.column_stack(columns).tolist()
        return rows

    @functools.cached_property
    def _fine(self) -> tuple[Float, Int, Float]:
        """Joints and turntable (n, 7) as they are written, deg; which posture (n,) each leads to; the share of the way.

        The postures, and between them so many that angles which go evenly from row to row stay on the path.
        """
        seven = self.made.axes
        off, _ = self._between_postures(np.arange(1, len(seven)), np.full(len(seven) - 1, 0.5))
        count = np.clip(np.ceil(np.sqrt(off / (ROW_SHARE * self.job.rounding_mm))), 1, MOST_ROWS).astype(int)
        towards = np.repeat(np.arange(len(seven)), np.append(1, count))
        share = np.concatenate([[1.0], *(np.arange(1, n + 1) / n for n in count.tolist())])
        fine, inner = seven[towards], np.flatnonzero(share < 1.0)
        fine[inner] = self._between_postures(towards[inner], share[inner])[1]
        return np.asarray(np.round(fine / DEG, DIGITS)), towards, share

    @functools.cached_property
    def _on_part(self) -> Float:
        """The path's frame (n, 4, 4) at all postures, in the turntable's frame."""
        made, part_from_base = self.made, inverse(turntable_pose(self.cell, self.made.turntable))
        return np.asarray(part_from_base @ forward_kinematics(self.cell.chain, made.joints) @ made.flange_from_point)

    def _between_postures(self, towards: Int, share: Float) -> tuple[Float, Float]:
        """How far even angles leave the path (k,), mm, on the way to postures (k,); and angles (k, 7) that stay on it.

        On the part the path's frame goes straight and turns evenly. Where nothing reaches it, the angles go evenly.
        """
        made, cell, seven = self.made, self.cell, self.made.axes
        even = seven[towards - 1] + share[:, None] * (seven[towards] - seven[towards - 1])
        start, end = self._on_part[towards - 1], self._on_part[towards]
        first, last = (quaternion_from_rotation(pose[:, :3, :3]) for pose in (start, end))
        place = start[:, :3, 3] + share[:, None] * (end[:, :3, 3] - start[:, :3, 3])
        wanted = turntable_pose(self.cell, even[:, 6]) @ pose_from(
            rotation_from_quaternion(slerp(first, last, share)), place
        )
        there = forward_kinematics(cell.chain, even[:, :6]) @ made.flange_from_point
        apart = np.linalg.norm(there[:, :3, 2:] - wanted[:, :3, 2:], axis=1)  # tilt of the axis, and at the point
        off = np.asarray(apart @ np.array([self.job.moves.toolpath.cutter.flute_length_mm, 1.0]))
        left = np.flatnonzero(off > ROW_SHARE * self.job.rounding_mm)
        branches = inverse_kinematics(cell.chain, wanted[left] @ inverse(made.flange_from_point))
        best = nearest_branch(branches, np.ascontiguousarray(even[left, :6]))
        even[left, :6] = np.where(np.isfinite(best), best, even[left, :6])
        return off, even

    @functools.cached_property
    def kept(self) -> Int:
        """Indices of the rows that differ from the one before."""
        return np.flatnonzero(np.append(True, np.any(np.diff(self._fine[0], axis=0), axis=1)))

    def _times(self) -> Float:
        """When each of the kept rows is reached, s."""
        made, table = self.made, self.cell.turntable
        angles, towards, share = self._fine
        way = chords_mm(made.position_mm) / made.feed_mm_s[1:]
        whole = np.append(0.0, np.cumsum(way))
        feed = whole[towards] - (1 - share) * np.append(0.0, way)[towards]
        at_feed = np.diff(feed[self.kept])
        moved = np.diff(angles[self.kept], axis=0) * DEG
        rated = SHARE * np.append(self.cell.chain.speeds, table.speed if table else np.inf)
        steps = np.maximum(np.maximum(at_feed, (np.abs(moved) / rated).max(axis=1)), LEAST_S)
        if self.cell.rated_accelerations is not None:
            steps = 1 / slowed(moved, SHARE * self.cell.rated_accelerations, 1 / steps)
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

    circular = straight  # the postures lie on the arc

    def remark(self, text: str) -> str:
        """Up to the end of the line."""
        return f"# {text}"

    def foot(self) -> Iterable[str]:
        """Nothing."""
        return []

    def read(self, files: Mapping[str, str]) -> ProgramMoves:
        """Turn it back."""
        return Table().program(files)

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
        first, end = np.searchsorted(self._fine[1][self.kept], [before, last], side="right").tolist()
        return [",".join(map(str, _tidy(row))) for row in self.rows[first:end]]


def _tidy(row: list[float]) -> list[float | int]:
    """Time to a nanosecond, angles as they are rounded."""
    return [round(row[0], 9), *(value + 0.0 for value in row[1:-1]), int(row[-1])]


# How fast rows may follow each other: a joint's speed changes from one row to the next within the shorter step.


def slowed(moved: Float, most: Float, rate: Float) -> Float:
    """The rates (n,), 1/s, of steps between rows, lowered until no joint changes its speed too fast.

    Args:
        moved: (n, 7) of joints and turntable in each step, rad.
        most: (7,) largest accelerations, rad/s^2; inf: not known.
        rate: (n,) largest rates, one over the step's time.
    """
    rate = rate.copy()
    for _ in range(MOST_SWEEPS):
        if not _sweep(moved, most, rate):
            break
    ends = 2 * np.abs(moved[[0, -1]]) * rate[[0, -1], None] ** 2
    inner = np.abs(np.diff(moved * rate[:, None], axis=0)) * np.maximum(rate[1:], rate[:-1])[:, None]
    left = float((np.concatenate([ends, inner]) / most).max())
    return np.asarray(rate / np.sqrt(max(left, 1.0)))  # all times by one factor: accelerations by its square


@kernel
def _sweep(moved: AnyArray, most: AnyArray, rate: AnyArray) -> bool:
    """Lower rates forth and back through all rows; whether any was lowered."""
    n, changed = len(rate), False
    for k in range(len(most)):
        for end in (0, n - 1):  # half a step from or to the standstill
            if 2 * abs(moved[end, k]) * rate[end] ** 2 > most[k] * NEARLY:
                rate[end], changed = np.sqrt(most[k] / (2 * abs(moved[end, k]))), True
    for turn in range(2 * (n - 1)):
        i = turn if turn < n - 1 else 2 * (n - 1) - 1 - turn
        for k in range(len(most)):
            one, other = moved[i, k] * rate[i], moved[i + 1, k] * rate[i + 1]
            asked = abs(one - other) * max(rate[i], rate[i + 1])
            if asked <= most[k] * NEARLY:
                continue
            changed = True
            if one * other <= 0:  # the joint turns round: both steps must be slower
                less = np.sqrt(most[k] / asked)
                rate[i] *= less
                rate[i + 1] *= less
                continue
            fast, slow = (i, i + 1) if abs(one) > abs(other) else (i + 1, i)
            way, speed = abs(moved[fast, k]), abs(moved[slow, k]) * rate[slow]
            alone = (speed + np.sqrt(speed**2 + 4 * way * most[k])) / (2 * way)  # where its own step is the shorter one
            rate[fast] = min(alone, (speed + most[k] / rate[slow]) / way)
    return changed
