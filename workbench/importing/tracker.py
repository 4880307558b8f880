"""Readings of a laser tracker by position: `Pos n`, then a line a reading: `X= ... Y= ... Z= ...`."""

from __future__ import annotations

import re
from pathlib import Path
from typing import NamedTuple

import numpy as np

from workbench.cloud.readers import READING
from workbench.errors import InputError
from workbench.importing.text import decoded
from workbench.units import Float, Shaped

NAME = "readings of a laser tracker"
POSITION = re.compile(r"^\s*Pos\w*\s*(\d+)\b", re.IGNORECASE)
INTO_A_TABLE = (
    "it is no recording: nothing of it goes into `workbench import`; the mean of each position, beside the robot's "
    "pose or joints there, is a row of the table that stage calibrate.tracker takes (docs/howto/calibrate_robot.md)"
)


class Position(NamedTuple):
    """All readings of one position."""

    number: int
    reading: Shaped[Float, "n 3"]  # in the file's unit


def recognises(head: str) -> bool:
    """Whether a text begins with a position and readings of it."""
    lines = [line for line in head.splitlines() if line.strip()][:2]
    return len(lines) == 2 and bool(POSITION.match(lines[0])) and bool(READING.search(lines[1]))


def read_positions(path: Path) -> tuple[Position, ...]:
    """The readings by position; positions that have none are left out.

    Raises:
        InputError: a line that is neither; no readings.
    """
    found: dict[int, list[tuple[float, ...]]] = {}
    now: list[tuple[float, ...]] | None = None
    for number, line in enumerate(decoded(path.read_bytes()).split("\n"), 1):
        if head := POSITION.match(line):
            now = found.setdefault(int(head[1]), [])
        elif (told := READING.search(line)) and now is not None:
            now.append(tuple(float(value) for value in told.groups()))
        elif line.strip() and "INVALID" not in line:
            raise InputError(f"{path}: line {number}", "expected 'Pos n', or a reading as 'X= ... Y= ... Z= ...'")
    made = tuple(Position(number, np.array(readings)) for number, readings in found.items() if readings)
    if not made:
        raise InputError(str(path), "expected readings as 'X= ... Y= ... Z= ...', found none")
    return made


def told(positions: tuple[Position, ...]) -> list[str]:
    """Counts, scatter within a position, and the position whose readings scatter most."""
    off = [one.reading - one.reading.mean(axis=0) for one in positions]
    count = sum(map(len, off))
    lines = [f"positions: {len(positions)} with {count} readings, in the file's own unit (trackers write mm)"]
    if count > len(positions):
        spread = float(np.sqrt(sum(float((one**2).sum()) for one in off) / (3 * (count - len(positions)))))
        far = [float(np.linalg.norm(one, axis=1).max()) for one in off]
        worst = int(np.argmax(far))
        lines.append(
            f"within a position: standard deviation {spread:.4g} an axis, {far[worst]:.4g} off the mean at the most, "
            f"at position {positions[worst].number}"
        )
    return lines
