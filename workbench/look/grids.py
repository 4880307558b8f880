"""Profiles without poses: one behind the other, by the way along the scan where the file tells it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from workbench.look.sample import places, shades_of
from workbench.look.seen import Shade
from workbench.units import Float, Float32

LEAST_PIXELS, MOST_PIXELS = 20, 20_000_000  # of a height map that is measured as an image
EVEN = 0.05  # share of a step by which steps may differ


class Stacked(NamedTuple):
    """Points in the profiler frame; y is the way along the scan, or the frame's number times a column's pitch."""

    points_mm: Float
    shades: tuple[Shade, ...]


def stacked(x_mm: Float32, z_mm: Float32, travel_mm: Float | None) -> Stacked:
    """The returns of a grid (N, M)."""
    frame, column = places(x_mm, z_mm)
    y_mm = travel_mm if travel_mm is not None else np.arange(len(z_mm)) * pitch_mm(x_mm)
    points = np.stack([x_mm[frame, column], y_mm[frame], z_mm[frame, column]], axis=1).astype(float)
    return Stacked(points, shades_of(points, frame=frame, column=column))


def pitch_mm(x_mm: Float32) -> float:
    """Median distance of neighbouring columns; 1 where nothing tells it."""
    step = np.abs(np.diff(x_mm[:: max(1, len(x_mm) // 50)], axis=1))
    step = step[np.isfinite(step) & (step > 0)]
    return float(np.median(step)) if len(step) else 1.0


def even_grid(x_mm: Float32, travel_mm: Float | None) -> bool:
    """Whether profiles are a height map: x alike in all of them, and even steps of x and travel."""
    if travel_mm is None or min(x_mm.shape) < LEAST_PIXELS or x_mm.size > MOST_PIXELS:
        return False
    some = x_mm[:: max(1, len(x_mm) // 100)]
    low = np.min(some, axis=0, initial=np.inf, where=np.isfinite(some))
    high = np.max(some, axis=0, initial=-np.inf, where=np.isfinite(some))
    if not np.isfinite(low).all() or not (high - low < EVEN * pitch_mm(x_mm)).all():
        return False
    return all(_even(np.diff(values)) for values in ((low + high) / 2, travel_mm))


def _even(step: Float) -> bool:
    usual = float(np.median(step))
    return usual != 0 and bool((np.abs(step - usual) < EVEN * abs(usual)).all())
