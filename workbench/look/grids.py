"""Profiles without poses: one behind the other, by the way along the scan where the file tells it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from workbench.look.sample import places, shades_of
from workbench.look.seen import Shade
from workbench.units import Float, Float32


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
