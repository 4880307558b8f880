"""Profiles in any table of text, as the mapping file describes it."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from workbench.errors import InputError
from workbench.importing.files import claims
from workbench.importing.gopxl import intensities
from workbench.importing.grid import bounded, gridded, without
from workbench.importing.mapping import Mapping
from workbench.importing.mapping_tables import LENGTH_MM, TIME_S, ProfileColumns, ProfilesPart
from workbench.importing.neutral import Imported, ProfileFrames
from workbench.importing.table import Table, header_names, read_table
from workbench.importing.text import cells, first_bytes, numbered, numbers, read_lines_as_bytes
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
    return set(_wanted(part).values()) <= set(header_names(head, part))


def read(path: Path, mapping: Mapping) -> Imported:
    """The frames of a table.

    Raises:
        InputError: a column is missing, a cell is no number, a time or travel that changes within a frame.
    """
    part = mapping.profiles or known_form(first_bytes(path))
    assert part is not None
    return _read_rows(path, part) if part.frames == "rows" else _read_points(path, part)


def _wanted(part: ProfilesPart) -> dict[str, str | int]:
    """Columns by role."""
    return part.columns.model_dump(exclude_none=True) if part.columns else {}


def _read_points(path: Path, part: ProfilesPart) -> Imported:
    """One row a point."""
    wanted, unit = _wanted(part), LENGTH_MM[part.length_unit]
    table = read_table(path, part, wanted)
    first = _first(table, part)
    x, z = (without(table.columns[role], part.missing) * unit for role in ("x", "z"))
    light = intensities(table, "intensity") if "intensity" in wanted else None
    by_spacing = part.ragged == "spacing"
    grid = gridded(x, z, first, table.where, intensity=light, by_spacing=by_spacing)
    frames = ProfileFrames(
        table.where,
        grid.x_mm,
        grid.z_mm,
        time_s=_of_frame(table, "time", first, TIME_S[part.time_unit or "s"]),
        travel_mm=_of_frame(table, "travel", first, unit),
        intensity=grid.intensity,
        length_unit=part.length_unit,
    )
    used = ", ".join(f"{role} = {table.names[role]}" for role in wanted)
    units = f"lengths in {part.length_unit}" + (f", times in {part.time_unit}" if "time" in wanted else "")
    return Imported(profiles=frames, notes=(f"table: {used}; {units}", *filter(None, [grid.note])))


def _first(table: Table, part: ProfilesPart) -> Bool:
    """Where frames begin."""
    if part.frames == "column":
        number = table.present("frame")
        first = np.diff(number, prepend=np.nan) != 0
    elif part.frames == "restart":
        first = restarts(table.present("x"))
    else:
        first = table.after_blank.copy() if part.frames == "blank_lines" else np.zeros(len(table.line), bool)
    first[0] = True
    if len(first) > 1 and first.sum() > len(first) / 2:
        raise InputError(
            f"{table.where}: line {table.line[1]}",
            f"expected several points a frame, found {first.sum()} frames in {len(first)} rows",
        )
    return np.asarray(first)


def restarts(x: Float) -> Bool:
    """Where x jumps back by more than half of what it spans, against its usual way."""
    step = np.diff(x, prepend=x[:1])
    way = np.sign(np.median(step[1:])) if len(step) > 1 else 1.0
    return np.asarray(step * way < -0.5 * np.ptp(x))


def _of_frame(table: Table, role: str, first: Bool, unit: float) -> Float | None:
    """A column with one value a frame."""
    if role not in table.columns:
        return None
    values = table.present(role)
    changed = np.flatnonzero(~first & (np.diff(values, prepend=values[:1]) != 0))
    if len(changed):
        raise InputError(
            f"{table.where}: line {table.line[changed[0]]}",
            f"column {table.names[role]}: expected one value a frame, found {values[changed[0]]:g}",
        )
    return values[first] * unit


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
