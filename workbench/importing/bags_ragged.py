"""Columns for profiles of different length, a block of them at a time, so that many take little room."""

from __future__ import annotations

import numpy as np

from workbench.geometry.columns import columns_by_count, columns_by_spacing, usual_pitch
from workbench.units import AnyArray, Bool, Float32, Int

SAMPLE = 4  # blocks that the usual step is taken from


def ragged_columns(blocks_mm: list[Float32], lengths: list[Int], by_spacing: bool) -> tuple[list[AnyArray], str]:
    """Columns (uint16) of the points of each block of x, and how they were found. All points are returns.

    By the gaps in x, so that a column stays a pixel of the sensor as far as x shows it; where the gaps tell nothing, or
    `by_spacing` is False, counted from each profile's first point.

    Args:
        blocks_mm: x of some profiles each, one after the other.
        lengths: points of each of their profiles.
    """
    found = _by_spacing(blocks_mm, lengths) if by_spacing else None
    how = "counted from each profile's first point" if found is None else "by the gaps in x"
    every = np.concatenate(lengths)
    note = f"profiles of {every.min()} to {every.max()} points: columns {how}"
    return found or [counted(length) for length in lengths], note


def counted(lengths: Int) -> AnyArray:
    """Columns (R,) from 0 in each of some profiles of these lengths."""
    return columns_by_count(_first(lengths)).astype(np.uint16)


def _by_spacing(blocks_mm: list[Float32], lengths: list[Int]) -> list[AnyArray] | None:
    chosen = [k for k, x in enumerate(blocks_mm) if len(x)]
    sample = chosen[:: 1 + len(chosen) // SAMPLE]
    x_mm = np.concatenate([blocks_mm[k] for k in sample]).astype(float)
    pitch_mm = usual_pitch(x_mm, np.concatenate([_first(lengths[k]) for k in sample]))
    if pitch_mm is None:
        return None
    origin = min(float((blocks_mm[k][_first(lengths[k])] / pitch_mm).min()) for k in chosen)
    columns: list[AnyArray] = []
    for x, length in zip(blocks_mm, lengths, strict=True):
        first = _first(length)
        found = columns_by_spacing(x.astype(float), first, pitch_mm=pitch_mm, origin=origin) if len(x) else first
        if found is None:
            return None
        columns.append(found.astype(np.uint16))
    return columns


def _first(lengths: Int) -> Bool:
    """Which of the points (R,) of some profiles are a profile's first."""
    first = np.zeros(int(lengths.sum()), bool)
    first[(np.cumsum(lengths) - lengths)[lengths > 0]] = True
    return first
