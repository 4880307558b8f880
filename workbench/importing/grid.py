"""Points in the order of a file to the scanner's grid, frame by column."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from workbench.errors import InputError
from workbench.geometry.columns import columns_by_count, columns_by_spacing
from workbench.units import AnyArray, Bool, Float, Float32, Int

MOST_EMPTY = 20  # cells a point: beyond it the rows cannot be profiles of one sensor
FEW_CELLS = 1_000_000
MAX_MM = 1e5  # as scan.read: beyond it no length in mm, but a code for 'no return'


class Grid(NamedTuple):
    """Points by frame and column; NaN = no return."""

    x_mm: Float32
    z_mm: Float32
    intensity: AnyArray | None
    note: str  # how ragged frames were laid out; '' where none was ragged


def gridded(
    x_mm: Float, z_mm: Float, first: Bool, where: str, *, intensity: AnyArray | None = None, by_spacing: bool = True
) -> Grid:
    """The grid of points (R,) whose frames begin where `first` (R,) is True.

    Frames of unequal length are laid out by the gaps in x, so that columns stay the sensor's pixels as far as the file
    shows them; where the gaps tell nothing, or `by_spacing` is False, points are counted from column 0.
    """
    column, note = columns_by_count(first), ""
    counts = np.diff(np.append(np.flatnonzero(first), len(first)))
    if counts.min() < counts.max():
        spaced = columns_by_spacing(x_mm, first) if by_spacing else None
        note = f"frames of {counts.min()} to {counts.max()} points: columns "
        note += "counted from each frame's first point" if spaced is None else "by the gaps in x"
        column = column if spaced is None else spaced
    shape = (len(counts), int(column.max()) + 1)
    if shape[0] * shape[1] > max(FEW_CELLS, MOST_EMPTY * len(x_mm)):
        raise InputError(where, f"expected frames of alike length, found {counts.min()} to {counts.max()} points")
    return _filled(shape, np.cumsum(first) - 1, column, x_mm, z_mm, intensity, note)


def _filled(
    shape: tuple[int, int], frame: Int, column: Int, x_mm: Float, z_mm: Float, intensity: AnyArray | None, note: str
) -> Grid:
    x, z = np.full(shape, np.nan, np.float32), np.full(shape, np.nan, np.float32)
    x[frame, column], z[frame, column] = bounded(x_mm), bounded(z_mm)
    light = None
    if intensity is not None:
        light = np.zeros(shape, np.uint16)
        light[frame, column] = intensity
    return Grid(x, z, light, note)


def bounded(lengths_mm: Float) -> Float32:
    """Lengths as float32; what float32 cannot hold becomes the largest it can, for the check of sizes to find."""
    return np.asarray(np.clip(lengths_mm, -1e30, 1e30), np.float32)


def without(values: Float, missing: list[float]) -> Float:
    """`values` with NaN for those that mean no return."""
    return np.where(np.isin(values, missing), np.nan, values) if missing else values
