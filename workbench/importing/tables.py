"""Profiles in any table of text, as the mapping file describes it."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from workbench.errors import InputError
from workbench.importing.mapping import Mapping
from workbench.importing.mapping_parts import LENGTH_MM, TIME_S, ProfileColumns, ProfilesPart
from workbench.importing.neutral import Imported, Points, ProfileFrames, bounded, without
from workbench.importing.text import Table, first_bytes, part_of, slabs
from workbench.units import AnyArray, Bool, Float, Int

NAME = "table of profiles (by the mapping)"
POINT = ProfileColumns(x="x_mm", z="z_mm", frame="frame", time="time_s")
PLAIN = ProfilesPart(length_unit="mm", time_unit="s", frames="column", columns=POINT)
GOPXL = ProfilesPart(
    length_unit="mm",
    frames="one",
    columns=ProfileColumns(x="X_mm", z="Z_mm", intensity="Intensity", valid="Valid", index="Index"),
)
HEADER = ("frame", "time_s", "x_mm", "z_mm")
KNOWN = {
    HEADER: PLAIN,
    (*HEADER, "intensity"): PLAIN.model_copy(update={"columns": POINT.model_copy(update={"intensity": "intensity"})}),
    ("Index", "X_mm", "Z_mm", "Intensity", "Valid"): GOPXL,
}


def recognises(path: Path, head: bytes, mapping: Mapping) -> bool:
    """Whether the mapping names the file, all of its columns stand in the header, or the header is a known one."""
    return part_of(mapping.profiles, KNOWN, path, head) is not None


def read(path: Path, mapping: Mapping) -> Imported:
    """The frames of a table.

    Raises:
        InputError: a column is missing, a cell is no number, a time, travel or pass that changes within a frame.
    """
    part = part_of(mapping.profiles, KNOWN, path, first_bytes(path))
    assert part is not None
    return _read_rows(path, part) if part.frames == "rows" else _read_points(path, part)


def _read_points(path: Path, part: ProfilesPart) -> Imported:
    """One row per point."""
    unit = LENGTH_MM[part.length_unit]
    points, values = Points(), FrameValues(part)
    table = None
    for table in slabs(path, part):
        first = values.add(table)
        x, z = (bounded(without(table.columns[role], part.missing) * unit) for role in ("x", "z"))
        if "valid" in table.columns:
            z[table.within("valid", table.present("valid"), 0, 1) == 0] = np.nan
        table.whole("scan_pass")
        points.add(x, z, np.flatnonzero(first), _intensities(table) if "intensity" in table.columns else None)
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
        pass_index=values.pass_index,
        intensity=grid.intensity,
        sensor="GoPxL" if part is GOPXL else None,
        length_unit=part.length_unit,
    )
    used = ", ".join(f"{role} = {name}" for role, name in table.names.items())
    units = f"lengths in {part.length_unit}" + (f", times in {part.time_unit}" if part.time_unit else "")
    return Imported(profiles=frames, notes=(f"table: {used}; {units}", *filter(None, [grid.note])))


def _intensities(table: Table) -> AnyArray:
    """As uint16; an empty cell is 0."""
    return table.within("intensity", np.nan_to_num(table.columns["intensity"]), 0, 65535).astype(np.uint16)


class FrameValues:
    """Where frames begin, and what has one value per frame, stretch by stretch."""

    def __init__(self, part: ProfilesPart) -> None:
        self.part, self.second_line = part, 1
        self._last: dict[str, float] = {}
        self._values: dict[str, list[Float]] = {"time": [], "travel": [], "scan_pass": []}
        self._way: tuple[float, float] | None = None  # for 'restart': sign of the usual step, span of x

    def add(self, table: Table) -> Bool:
        """(R,) True at each frame's first row; InputError where what has one value per frame changes in it."""
        begun = bool(self._last)
        first = self._first(table)
        if not begun:
            first[0] = True
            self.second_line = int(table.line[min(1, len(first) - 1)])
        if "index" in table.columns and (back := ~first & (self._step(table.present("index"), "index") <= 0)).any():
            what = f"column {table.names['index']}: expected a number that rises within a frame"
            raise InputError(table.place(int(back.argmax())), what)
        for role, values in self._values.items():
            if role in table.columns:
                self._check(table, role, first)
                values.append(table.columns[role][first])
        self._last |= {role: float(column[-1]) for role, column in table.columns.items()}
        return first

    def of(self, role: str, unit: float) -> Float | None:
        """One value per frame; None where the table has none."""
        return np.concatenate(self._values[role]) * unit if self._values[role] else None

    @property
    def pass_index(self) -> Int | None:
        """(N,) number of each frame's pass; None where the table has none."""
        found = self.of("scan_pass", 1.0)
        return None if found is None else found.astype(np.int64)

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
            what = f"column {table.names[role]}: expected one value per frame, found {values[row]:g}"
            raise InputError(table.place(row), what)


def way_of(x: Float) -> tuple[float, float]:
    """Sign of the usual step of x, and its span."""
    step = np.diff(x)
    return float(np.sign(np.median(step))) if len(step) else 1.0, float(np.ptp(x)) if len(x) else 0.0


def _read_rows(path: Path, part: ProfilesPart) -> Imported:
    """One row of ranges a frame."""
    assert part.x_first is not None
    assert part.x_pitch is not None
    found = [np.stack([*table.columns.values()], axis=1) for table in slabs(path, part)]
    unit = LENGTH_MM[part.length_unit]
    z_mm = bounded(without(np.concatenate(found), part.missing) * unit)
    across = part.x_first + part.x_pitch * np.arange(z_mm.shape[1])
    x_mm = np.broadcast_to(bounded(np.asarray(across * unit)), z_mm.shape)
    note = f"table: a row of ranges a frame, x from {part.x_first:g} by {part.x_pitch:g}; lengths in {part.length_unit}"
    return Imported(profiles=ProfileFrames(str(path), x_mm, z_mm, length_unit=part.length_unit), notes=(note,))
