"""A groove by seven corners, as trackers of submerged-arc welding write it."""

from __future__ import annotations

import re
from typing import NamedTuple

import numpy as np

from workbench.errors import InputError
from workbench.units import Float, Shaped

CORNERS = 7  # upper edge, root, three places between the roots, root, upper edge
TORCH = "Torchpos:"
MOST_ROWS = 1_000_000
NUMBER = r"[-+]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][-+]?\d{1,3})?"
ROW = re.compile(rf"{NUMBER}(?:,{NUMBER}){{{3 * CORNERS - 1}}},?")


class SevenCorners(NamedTuple):
    """Corners of n rows, and where the torch was: lateral, along and up, in mm."""

    corners_mm: Shaped[Float, "n 7 3"]
    torch_mm: Shaped[Float, "n 2"]  # lateral and up; NaN where none is told


def recognised(head: str) -> bool:
    """Whether a text begins as such a table does: 21 numbers a row, perhaps with lines of the torch between."""
    lines = [line.strip() for line in head.splitlines()[:4] if line.strip() and not line.startswith(TORCH)]
    return bool(lines) and ROW.fullmatch(lines[0]) is not None


def read_corners(text: str, where: str) -> SevenCorners:
    """Rows of seven corners in metres, each perhaps followed by `Torchpos:x,z`.

    Raises:
        InputError: a line that is neither.
    """
    rows: list[list[float]] = []
    torch: list[tuple[float, float]] = []
    lines = text.splitlines()
    for number, raw in enumerate(lines, 1):
        line = raw.strip()
        if not line:
            continue
        if line.startswith(TORCH):
            place = line[len(TORCH) :].split(",")
            if len(place) != 2 or not all(re.fullmatch(NUMBER, value.strip()) for value in place) or not rows:
                raise InputError(f"{where}: line {number}", f"expected {TORCH}x,z behind a row, found {line[:80]!r}")
            torch[-1] = float(place[0]), float(place[1])
        elif ROW.fullmatch(line) and len(rows) < MOST_ROWS:
            rows.append([float(value) for value in line.rstrip(",").split(",")])
            torch.append((np.nan, np.nan))
        elif number == len(lines):  # a log that was cut off in the middle of its last line
            break
        else:
            raise InputError(f"{where}: line {number}", f"expected {3 * CORNERS} numbers, found {line[:80]!r}")
    if not rows:
        raise InputError(where, f"expected rows of {3 * CORNERS} numbers, found none")
    corners_mm = 1e3 * np.array(rows).reshape(-1, CORNERS, 3)
    if not np.abs(corners_mm).max() < 1e6:
        raise InputError(where, "expected corners in metres, within 1 km")
    return SevenCorners(corners_mm, 1e3 * np.array(torch))
