"""Columns for profiles of different length, a block of them at a time, so that many take little room."""

from __future__ import annotations

import numpy as np

from workbench.geometry.columns import columns_by_spacing
from workbench.units import AnyArray, Float32

BLOCK = 64  # profiles
SAMPLE = 1000  # profiles that the usual step is taken from


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
    steps = [np.diff(row) for row in seen[:: 1 + len(seen) // SAMPLE]]
    pitch_mm = float(np.median(np.concatenate(steps))) if sum(map(len, steps)) else 0.0
    if pitch_mm == 0:
        return None
    origin = min(float(row[0]) / pitch_mm for row in seen)
    columns: list[AnyArray] = []
    for begin in range(0, len(rows_mm), BLOCK):
        block = rows_mm[begin : begin + BLOCK]
        ends = np.cumsum([len(row) for row in block])
        first = np.zeros(ends[-1], bool)
        first[[end - len(row) for end, row in zip(ends, block, strict=True) if len(row)]] = True
        x_mm = np.concatenate(block).astype(float)
        # A block without two points in a row has no step: the function says None, and all are counted.
        found = columns_by_spacing(x_mm, first, pitch_mm=pitch_mm, origin=origin) if len(x_mm) else first
        if found is None:
            return None
        columns += [part.astype(np.int32) for part in np.split(found, ends[:-1])]
    return columns
