"""Gocator "CSV Version 2" surfaces: blocks `Info`, `DeviceInfo`, ..., each closed by `End`; the heights in `Part`.

A surface has a line `Frame, Source, Time, ... Row Count, Column Count ...`, its values, a header cell `Y\\X` with the x
of each column, then a row a profile: its y, then z. Lengths in mm, an empty cell is no return. Seen in an export of a
Gocator 3109. Each surface of the file becomes a scanning pass.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

from workbench.errors import InputError
from workbench.importing.mapping import Mapping
from workbench.importing.neutral import Imported, ProfileFrames, bounded
from workbench.importing.text import cells, head_text, numbered, numbers, read_text
from workbench.units import Float, Shaped

NAME = "Gocator CSV surface"
CORNER = "Y\\X"
Lines = Iterator[tuple[int, str]]


class Surface(NamedTuple):
    """One grid of heights in mm."""

    x_mm: Shaped[Float, " M"]
    y_mm: Shaped[Float, " N"]
    z_mm: Shaped[Float, "N M"]


def recognises(path: Path, head: bytes, mapping: Mapping) -> bool:
    """Whether the file begins with the block `Info` and its `CSV Version`."""
    lines = head_text(head[:4096]).split("\n")
    return len(lines) > 1 and lines[0].strip(" ,") == "Info" and lines[1].startswith("CSV Version")


def read(path: Path, mapping: Mapping) -> Imported:
    """The surfaces, one profile per row; the way along the scan is y.

    Raises:
        InputError: another version, no surface, a grid that is not as large as it says, a cell that is no number.
    """
    where = str(path)
    version, model, surfaces = "", "", []
    lines = numbered(read_text(path))
    for number, line in lines:
        titles = cells(line, ",")
        if titles[0] == "CSV Version":
            version = _values(lines, titles, f"{where}: line {number}").get("CSV Version", "")
            if version != "2":
                raise InputError(f"{where}: line {number + 1}", f"expected CSV Version 2, found {version[:20]!r}")
        elif titles[:2] == ["ID", "Model"]:
            model = _values(lines, titles, f"{where}: line {number}")["Model"]
        elif titles[0] == "Frame":
            surfaces.append(_surface(lines, titles, number, where))
    if not version or not surfaces:
        raise InputError(where, "expected a surface (a block with 'Frame' and 'Row Count'), found none")
    if len({surface.z_mm.shape[1] for surface in surfaces}) > 1:
        raise InputError(where, "expected surfaces of equally many columns")
    note = f"{NAME}: {len(surfaces)} surface(s) in mm; a row is a profile, y the way along the scan"
    return Imported(profiles=_frames(where, surfaces, model), notes=(note,))


def _frames(where: str, surfaces: list[Surface], model: str) -> ProfileFrames:
    z_mm = bounded(np.concatenate([surface.z_mm for surface in surfaces]))
    rows = [len(surface.y_mm) for surface in surfaces]
    x_mm = np.repeat(bounded(np.stack([surface.x_mm for surface in surfaces])), rows, axis=0)
    travel_mm = np.concatenate([surface.y_mm for surface in surfaces])
    passes = np.repeat(np.arange(len(surfaces)), rows) if len(surfaces) > 1 else None
    return ProfileFrames(where, x_mm, z_mm, travel_mm=travel_mm, pass_index=passes, sensor=f"Gocator {model}".strip())


def _values(lines: Lines, titles: list[str], where: str) -> dict[str, str]:
    """The line after a line of titles, by title."""
    _, line = next(lines, (0, ""))
    values = cells(line, ",")
    if len(values) < len(titles):
        raise InputError(where, f"expected {len(titles)} values in the line after it, found {len(values)}")
    return dict(zip(titles, values, strict=False))


def _surface(lines: Lines, titles: list[str], number: int, where: str) -> Surface:
    """The grid after a `Frame` line, as many rows and columns as it says."""
    place = f"{where}: line {number}"
    said = _values(lines, titles, place)
    counts = [said.get(name, "") for name in ("Row Count", "Column Count")]
    if not all(count.isascii() and count.isdigit() and 0 < len(count) < 7 for count in counts):
        raise InputError(place, f"expected 'Row Count' and 'Column Count', found {' and '.join(map(repr, counts))}")
    rows, columns = map(int, counts)
    grid: list[Float] = []
    for row in range(rows + 1):
        at, line = next(lines, (0, ""))
        cell, place = cells(line, ","), f"{where}: line {at or number}"
        if len(cell) != columns + 1 or (row == 0 and cell[0] != CORNER):
            found = f"found {cell[0][:20]!r} and {len(cell) - 1}" if at else "the file ends"
            content = f"row {row} of {rows}: y and {columns} heights" if row else f"'{CORNER}' and {columns} columns"
            raise InputError(place, f"expected {content}, {found}")
        values = numbers(cell[row == 0 :], place)
        if np.isnan(values[: 1 if row else None]).any():
            raise InputError(place, "expected a coordinate in every cell")
        grid.append(values)
    end, line = next(lines, (0, ""))
    if cells(line, ",")[0] != "End":
        raise InputError(f"{where}: line {end or 'last'}", f"expected 'End' after {rows} rows")
    table = np.stack(grid[1:])
    return Surface(grid[0], table[:, 0], table[:, 1:])
