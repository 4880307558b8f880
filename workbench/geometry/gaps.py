"""Which places along the edge were measured, and which lie in a gap between frames."""

from __future__ import annotations

import numpy as np

from workbench.units import Bool, Float, Int

LEAST_GAP_MM = 1.5  # frames this near to each other leave no gap between them
GAP_PITCHES = 4.0  # nor do frames within this many of their usual distances


def covered(s_frames: Float, pass_index: Int, at: Float) -> Bool:
    """Was the edge measured at the places `at` (m,), by any pass? s_frames (N,) mm, NaN where not seen."""
    out = np.zeros(at.shape, bool)
    for p in np.unique(pass_index):
        s = np.sort(s_frames[(pass_index == p) & np.isfinite(s_frames)])
        if s.size < 2:
            continue
        steps = np.diff(s)
        widest = max(LEAST_GAP_MM, GAP_PITCHES * float(np.median(steps)))
        after = np.clip(np.searchsorted(s, at), 1, s.size - 1)
        inside = (at >= s[0] - 1e-6) & (at <= s[-1] + 1e-6)
        out |= inside & (steps[after - 1] <= widest)
    return out
