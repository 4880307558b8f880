"""How long a path takes."""

from __future__ import annotations

import numpy as np

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
