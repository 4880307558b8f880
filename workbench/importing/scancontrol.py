"""scanCONTROL's text export: a block of x rows, as many y rows, as many z rows; a row a profile, in mm.

Semicolons, decimal commas, blank lines between the blocks, y constant in a row (the way along the scan). Points without
return are left out, so rows have unequal lengths. Seen in an export of a scanCONTROL 2925.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from workbench.errors import InputError
from workbench.importing.mapping import Mapping
from workbench.importing.neutral import Imported, Points, ProfileFrames, bounded
from workbench.importing.text import cells, head_text, numbers, read_text
from workbench.units import Float, Int

NAME = "scanCONTROL profiles"
BLOCKS = ("x", "y", "z")
FEWEST_POINTS = 8  # a row; fewer cells may be anything
NUMBER = re.compile(r"[-+]?\d+,\d+")
GOOD_SHARE = 0.8
Row = tuple[int, Float]  # line in the file, numbers


def recognises(path: Path, head: bytes, mapping: Mapping) -> bool:
    """Whether the first line is numbers with decimal commas between semicolons, but for a few damaged ones."""
    first = head_text(head).split("\n", 1)[0]
    row = cells(first, ";")[: -1 if first.count(";") > FEWEST_POINTS else None]
    good = sum(NUMBER.fullmatch(cell) is not None for cell in row)
    return len(row) >= FEWEST_POINTS and good >= GOOD_SHARE * len(row)


def read(path: Path, mapping: Mapping) -> Imported:
    """Profiles, and the way along the scan from the y rows.

    Raises:
        InputError: not three blocks of equally many rows, x, y and z of a row of unequal length, y not constant.
    """
    where = str(path)
    x, y, z = _blocks(path)
    for (_, across), (line_y, along), (line_z, up) in zip(x, y, z, strict=True):
        for line, row in ((line_y, along), (line_z, up)):
            if len(row) != len(across):
                raise InputError(f"{where}: line {line}", f"expected {len(across)} numbers as in x, found {len(row)}")
        if not np.ptp(along) == 0:
            raise InputError(f"{where}: line {line_y}", "expected one y for the whole profile")
    points, start = Points(), np.zeros(1, int)
    for (_, across), (_, up) in zip(x, z, strict=True):
        points.add(bounded(across), bounded(up), start)
    grid = points.gridded(where)
    travel_mm = np.array([row[0] for _, row in y])
    notes = [f"{NAME}: blocks of x, y, z rows in mm; y is the way along the scan", *filter(None, [grid.note])]
    frames = ProfileFrames(where, grid.x_mm, grid.z_mm, travel_mm=travel_mm, sensor="scanCONTROL")
    return Imported(profiles=frames, notes=tuple(notes))


def _blocks(path: Path) -> list[list[Row]]:
    """The three blocks of rows."""
    where = str(path)
    lines = read_text(path).split("\n")
    blank = np.array([not line.strip(" ;\t") for line in lines])
    starts: Int = np.flatnonzero(~blank & np.append(True, blank[:-1]))
    ends: Int = np.flatnonzero(~blank & np.append(blank[1:], True)) + 1
    sizes = ends - starts
    if len(sizes) != len(BLOCKS) or np.ptp(sizes) != 0:
        found = ", ".join(map(str, sizes[:6]))
        raise InputError(where, f"expected three blocks (x, y, z) of equally many rows, found blocks of {found} rows")
    return [
        [(i + 1, _row(lines[i], f"{where}: line {i + 1}")) for i in range(start, end)]
        for start, end in zip(starts, ends, strict=True)
    ]


def _row(line: str, where: str) -> Float:
    row = cells(line, ";")
    return numbers(row[:-1] if not row[-1] else row, where, decimal=",")
