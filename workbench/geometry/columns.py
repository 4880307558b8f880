"""Points of ragged profiles to columns: a file that leaves out what gave no return still shows where it was missing."""

from __future__ import annotations

import numpy as np

from workbench.units import Bool, Float, Int, Shaped

REFINEMENTS = 2
NEAR = 4  # strides: over a longer gap the profile may have turned away, and x with it
MOST_WIDER = 4  # columns for the longest row's points: beyond it the spacing tells nothing


def columns_by_count(first: Bool) -> Int:
    """Columns (R,) of points in order: 0, 1, 2, ... from each frame's `first` (R,) point."""
    starts = np.flatnonzero(first)
    return np.asarray(np.arange(len(first)) - np.repeat(starts, np.diff(np.append(starts, len(first)))))


def usual_pitch(x_mm: Float, first: Bool) -> float | None:
    """The step from column to column of points `x_mm` (R,), frame after frame, `first` (R,) at each frame's first.

    The median step leans to where points are dense; over whole strides the pitch averages out. None where x does not
    run one way.
    """
    step = np.diff(x_mm, prepend=x_mm[:1])
    inside = ~first & np.isfinite(step)
    if not np.isfinite(x_mm).all() or not inside.any():
        return None
    pitch = float(np.median(step[inside]))
    if pitch == 0 or (step[inside] * np.sign(pitch) <= 0).any():
        return None
    for _ in range(REFINEMENTS):
        strides = np.where(inside, np.maximum(1, np.round(step / pitch)), 0)
        near = strides <= NEAR
        pitch = float(step[inside & near].sum() / strides[near].sum())
    return pitch


def columns_by_spacing(
    x_mm: Float, first: Shaped[Bool, " R"], *, pitch_mm: float | None = None, origin: float | None = None
) -> Int | None:
    """Columns (R,) of points `x_mm` (R,), a gap of k usual spacings leaving k - 1 columns free.

    Args:
        x_mm: lateral coordinates, frame after frame.
        first: (R,) True at each frame's first point.
        pitch_mm: the usual step where these are some frames of many; None: theirs (`usual_pitch`).
        origin: x / pitch_mm of column 0, likewise; None: the least of these frames.

    Returns:
        Columns from 0, distinct and rising within a frame, alike for alike x in all frames; None where x does not run
        one way or the gaps are out of proportion.
    """
    pitch = usual_pitch(x_mm, first) if pitch_mm is None else pitch_mm
    step = np.diff(x_mm, prepend=x_mm[:1])
    if pitch is None or not np.isfinite(x_mm).all() or (step[~first] * np.sign(pitch) <= 0).any():
        return None
    strides = np.where(first, 0, np.maximum(1, np.round(step / pitch)))
    start = x_mm[first] / pitch
    along = np.cumsum(strides)
    frame = np.cumsum(first) - 1
    column = along - along[first][frame] + np.round(start - (start.min() if origin is None else origin))[frame]
    most = columns_by_count(first).max() + 1
    return column.astype(np.int64) if column.max() < MOST_WIDER * most else None
