"""Profiles in any table of text, as the mapping file describes it."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from workbench.errors import InputError
from workbench.importing.gopxl import intensities
from workbench.importing.mapping import Mapping, claims
from workbench.importing.mapping_parts import LENGTH_MM, TIME_S, ProfileColumns, ProfilesPart
from workbench.importing.neutral import Imported, Points, ProfileFrames, bounded, without
from workbench.importing.text import (
    Table,
    cells,
    first_bytes,
    header_names,
    numbered,
    numbers,
    read_lines_as_bytes,
    slabs,
)
from workbench.units import Bool, Float

NAME = "table of profiles (by the mapping)"
HEADER = ["frame", "time_s", "x_mm", "z_mm"]


def known_form(head: bytes) -> ProfilesPart | None:
    """The form of a table whose header leaves no doubt: frame,time_s,x_mm,z_mm and perhaps intensity."""
    columns = ProfileColumns(x="x_mm", z="z_mm", frame="frame", time="time_s")
    part = ProfilesPart(length_unit="mm", time_unit="s", frames="column", columns=columns)
    names = header_names(head, part)
    if names == [*HEADER, "intensity"]:
        return part.model_copy(update={"columns": columns.model_copy(update={"intensity": "intensity"})})
    return part if names == HEADER else None


def recognises(path: Path, head: bytes, mapping: Mapping) -> bool:
    """Whether the mapping names the file, all of its columns stand in the header, or the header is the known one."""
    part = mapping.profiles
    if part is None:
        return known_form(head) is not None
    if part.files is not None or part.columns is None:
        return claims(part, path)
    return set(wanted_columns(part).values()) <= set(header_names(head, part))


def read(path: Path, mapping: Mapping) -> Imported:
    """The frames of a table.

    Raises:
        InputError: a column is missing, a cell is no number, a time or travel that changes within a frame.
    """
    part = mapping.profiles or known_form(first_bytes(path))
    assert part is not None
    return _read_rows(path, part) if part.frames == "rows" else _read_points(path, part)


def wanted_columns(part: ProfilesPart) -> dict[str, str | int]:
    """Columns by role."""
    return part.columns.model_dump(exclude_none=True) if part.columns else {}


def _read_points(path: Path, part: ProfilesPart) -> Imported:
    """One row a point."""
    wanted, unit = wanted_columns(part), LENGTH_MM[part.length_unit]
    points, values = Points(), FrameValues(part)
    table = None
    for table in slabs(path, part, wanted):
        first = values.add(table)
        x, z = (bounded(without(table.columns[role], part.missing) * unit) for role in ("x", "z"))
        points.add(x, z, first, intensities(table, "intensity") if "intensity" in wanted else None)
    assert table is not None
    if points.rows > 1 and points.frames > points.rows / 2:
        what = f"expected several points a frame, found {points.frames} frames in {points.rows} rows"
        raise InputError(f"{table.where}: line {values.second_line}", what)
    grid = points.gridded(table.where, by_spacing=part.ragged == "spacing")
    frames = ProfileFrames(
        table.where,
        grid.x_mm,
        grid.z_mm,
        time_s=values.of("time", TIME_S[part.time_unit or "s"]),
        travel_mm=values.of("travel", unit),
        intensity=grid.intensity,
        length_unit=part.length_unit,
    )
    used = ", ".join(f"{role} = {table.names[role]}" for role in wanted)
    units = f"lengths in {part.length_unit}" + (f", times in {part.time_unit}" if "time" in wanted else "")
    return Imported(profiles=frames, notes=(f"table: {used}; {units}", *filter(None, [grid.note])))


class FrameValues:
    """Where frames begin, and what has one value a frame, stretch by stretch."""

    def __init__(self, part: ProfilesPart) -> None:
        self.part, self.second_line = part, 1
        self._last: dict[str, float] = {}
        self._values: dict[str, list[Float]] = {"time": [], "travel": []}
        self._way: tuple[float, float] | None = None  # for 'restart': sign of the usual step, span of x

    def add(self, table: Table) -> Bool:
        """(R,) True at each frame's first row; InputError where time or travel change within a frame."""
        begun = bool(self._last)
        first = self._first(table)
        if not begun:
            first[0] = True
            self.second_line = int(table.line[min(1, len(first) - 1)])
        for role, values in self._values.items():
            if role in table.columns:
                self._check(table, role, first)
                values.append(table.columns[role][first])
        self._last |= {role: float(column[-1]) for role, column in table.columns.items()}
        return first

    def of(self, role: str, unit: float) -> Float | None:
        """A value a frame; None where the table has none."""
        return np.concatenate(self._values[role]) * unit if self._values[role] else None

    def _first(self, table: Table) -> Bool:
        if self.part.frames == "column":
            return np.asarray(self._step(table.present("frame"), "frame") != 0)
        if self.part.frames == "restart":
            x = table.present("x")
            if self._way is None:
                self._way = way_of(x)
            return np.asarray(self._step(x, "x") * self._way[0] < -0.5 * self._way[1])
        if self.part.frames == "blank_lines":
            return table.after_blank.copy()
        return np.zeros(len(table.columns["x"]), bool)

    def _step(self, values: Float, role: str) -> Float:
        return np.diff(values, prepend=self._last.get(role, values[0]))

    def _check(self, table: Table, role: str, first: Bool) -> None:
        values = table.present(role)
        changed = ~first & (self._step(values, role) != 0)
        if changed.any():
            row = int(changed.argmax())
            what = f"column {table.names[role]}: expected one value a frame, found {values[row]:g}"
            raise InputError(f"{table.where}: line {table.line[row]}", what)


def way_of(x: Float) -> tuple[float, float]:
    """Sign of the usual step of x, and its span."""
    step = np.diff(x)
    return float(np.sign(np.median(step))) if len(step) else 1.0, float(np.ptp(x)) if len(x) else 0.0


def _read_rows(path: Path, part: ProfilesPart) -> Imported:
    """One row of ranges a frame."""
    assert part.x_first is not None
    assert part.x_pitch is not None
    rows = []
    for number, line in numbered(read_lines_as_bytes(path)):
        if number > part.skip_lines + part.header:
            rows.append(numbers(cells(line, part.delimiter), f"{path}: line {number}", part.decimal))
            if len(rows[-1]) != len(rows[0]):
                raise InputError(
                    f"{path}: line {number}", f"expected {len(rows[0])} ranges a row, found {len(rows[-1])}"
                )
    if not rows:
        raise InputError(str(path), "expected rows of ranges, found none")
    unit = LENGTH_MM[part.length_unit]
    z_mm = bounded(without(np.stack(rows), part.missing) * unit)
    across = part.x_first + part.x_pitch * np.arange(z_mm.shape[1])
    x_mm = np.broadcast_to(bounded(np.asarray(across * unit)), z_mm.shape)
    note = f"table: a row of ranges a frame, x from {part.x_first:g} by {part.x_pitch:g}; lengths in {part.length_unit}"
    return Imported(profiles=ProfileFrames(str(path), x_mm, z_mm, length_unit=part.length_unit), notes=(note,))
