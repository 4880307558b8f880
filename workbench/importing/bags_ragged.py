"""Columns for profiles of different length, a block of them at a time, so that many take little room."""

from __future__ import annotations

import numpy as np

from workbench.geometry.columns import columns_by_spacing, usual_pitch
from workbench.units import AnyArray, Bool, Float, Float32

BLOCK = 64  # profiles
SAMPLE = 100  # profiles that the usual step is taken from


def ragged_columns(rows_mm: list[Float32], by_spacing: bool) -> tuple[list[AnyArray], str]:
    """Columns (int32) of the points of each row of x, and how they were found.

    By the gaps in x, so that a column stays a pixel of the sensor as far as x shows it; where the gaps tell nothing, or
    `by_spacing` is False, counted from each row's first point. All points are returns.
    """
    found = _by_spacing(rows_mm) if by_spacing else None
    lengths = [len(row) for row in rows_mm]
    how = "counted from each profile's first point" if found is None else "by the gaps in x"
    note = f"profiles of {min(lengths)} to {max(lengths)} points: columns {how}"
    return found or [np.arange(length, dtype=np.int32) for length in lengths], note


def _by_spacing(rows_mm: list[Float32]) -> list[AnyArray] | None:
    seen = [row for row in rows_mm if len(row)]
    pitch_mm = usual_pitch(*_in_one(seen[:: 1 + len(seen) // SAMPLE]))
    if pitch_mm is None:
        return None
    origin = min(float(row[0]) / pitch_mm for row in seen)
    columns: list[AnyArray] = []
    for begin in range(0, len(rows_mm), BLOCK):
        block = rows_mm[begin : begin + BLOCK]
        x_mm, first = _in_one(block)
        found = columns_by_spacing(x_mm, first, pitch_mm=pitch_mm, origin=origin) if len(x_mm) else first
        if found is None:
            return None
        columns += [part.astype(np.int32) for part in np.split(found, np.cumsum([len(row) for row in block])[:-1])]
    return columns


def _in_one(rows_mm: list[Float32]) -> tuple[Float, Bool]:
    """All points (R,) of some rows, and which are a row's first."""
    ends = np.cumsum([len(row) for row in rows_mm])
    first = np.zeros(ends[-1], bool)
    first[[end - len(row) for end, row in zip(ends, rows_mm, strict=True) if len(row)]] = True
    return np.concatenate(rows_mm).astype(float), first
