"""How long a path takes, and feeds along it that respect an acceleration."""

from __future__ import annotations

import numpy as np

from workbench.geometry.blocks import as_input
from workbench.kernels import kernel
from workbench.units import Float


def step_lengths_mm(position_mm: Float) -> Float:
    """(k,) distance of each point (k, 3) from the one before it; 0 for the first."""
    steps = np.linalg.norm(np.diff(position_mm, axis=0), axis=1)
    return np.concatenate([np.zeros(min(1, len(position_mm))), steps])


def step_times_s(position_mm: Float, feed_mm_s: Float) -> Float:
    """(k,) time of the step to each point (k, 3) at its feed (k,), which is the feed towards it; 0 for the first."""
    return step_lengths_mm(position_mm) / feed_mm_s


def travel_time_s(position_mm: Float, feed_mm_s: Float) -> float:
    """Time from the first point (k, 3) to the last at the feeds towards each (k,), in s."""
    return float(step_times_s(position_mm, feed_mm_s).sum())


def limit_acceleration(feed_mm_s: Float, step_mm: Float, acceleration_mm_s2: float) -> Float:
    """The greatest feeds (k,) not above `feed_mm_s` between which |v dv/ds| stays within the acceleration.

    `step_mm` (k,) is the distance to each point from the one before it. v^2 may change by twice acceleration times
    distance: one pass forwards for speeding up, one backwards for slowing down.
    """
    square = np.square(feed_mm_s)
    _limit(square, as_input(step_mm), 2.0 * float(acceleration_mm_s2))
    return np.sqrt(square)


@kernel
def _limit(square: Float, step: Float, slope: float) -> None:
    for k in range(1, square.size):
        square[k] = min(square[k], square[k - 1] + slope * step[k])
    for k in range(square.size - 1, 0, -1):
        square[k - 1] = min(square[k - 1], square[k] + slope * step[k])
