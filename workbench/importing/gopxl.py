"""GoPxL's profile export: `Index,X_mm,Z_mm,Intensity,Valid`, one row a point, one profile a file. Lengths in mm."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from workbench.errors import InputError
from workbench.importing.mapping import Mapping
from workbench.importing.mapping_parts import TextPart
from workbench.importing.neutral import Imported, ProfileFrames, bounded
from workbench.importing.text import Table, header_names, read_table
from workbench.units import AnyArray, Int

NAME = "GoPxL profile"
HEADER = ("Index", "X_mm", "Z_mm", "Intensity", "Valid")
FORM = TextPart(length_unit="mm")
MOST_WIDER = 4  # columns by index for the number of points


def recognises(path: Path, head: bytes, mapping: Mapping) -> bool:
    """Whether the header is GoPxL's."""
    return tuple(header_names(head, FORM)) == HEADER


def read(path: Path, mapping: Mapping) -> Imported:
    """One profile; the index is the column, points that are not valid have no return.

    Raises:
        InputError: a cell is no number, an index that does not rise, an intensity out of range, Valid not 0 or 1.
    """
    table = read_table(path, FORM, {name: name for name in HEADER})
    column = _columns(table)
    valid = table.present("Valid")
    odd = np.flatnonzero((valid != 0) & (valid != 1))
    if len(odd):
        raise InputError(f"{table.where}: line {table.line[odd[0]]}", f"expected Valid 0 or 1, found {valid[odd[0]]:g}")
    shape = (1, int(column[-1]) + 1)
    x, z, light = np.full(shape, np.nan, np.float32), np.full(shape, np.nan, np.float32), np.zeros(shape, np.uint16)
    x[0, column] = np.where(valid, bounded(table.columns["X_mm"]), np.nan)
    z[0, column] = np.where(valid, bounded(table.columns["Z_mm"]), np.nan)
    light[0, column] = intensities(table, "Intensity")
    note = f"{NAME}: {len(column)} points in mm, one profile"
    return Imported(profiles=ProfileFrames(table.where, x, z, intensity=light, sensor="GoPxL"), notes=(note,))


def _columns(table: Table) -> Int:
    """The column of each point: its index."""
    index = table.present("Index")
    wrong = (index != np.round(index)) | (index < 0) | (index >= MOST_WIDER * len(index))
    wrong[1:] |= np.diff(index) <= 0
    if wrong.any():
        row = np.flatnonzero(wrong)[0]
        raise InputError(
            f"{table.where}: line {table.line[row]}", f"expected an index that rises, found {index[row]:g}"
        )
    return index.astype(np.int64)


def intensities(table: Table, role: str) -> AnyArray:
    """A column of intensities as uint16; an empty cell is 0."""
    values = np.nan_to_num(table.columns[role])
    wrong = np.flatnonzero((values < 0) | (values > 65535) | (values != np.round(values)))
    if len(wrong):
        raise InputError(
            f"{table.where}: line {table.line[wrong[0]]}",
            f"column {table.names[role]}: expected a whole number from 0 to 65535, found {values[wrong[0]]:g}",
        )
    return values.astype(np.uint16)
