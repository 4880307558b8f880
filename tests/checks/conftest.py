"""Good recordings to spoil."""

from __future__ import annotations

from functools import cache

import numpy as np

from bench.drawn.plates import random_recipe
from workbench.artefacts import Recording
from workbench.synthetic import simulate_recording


@cache
def good(condition: str = "straight", seed: int = 41) -> Recording:
    """A recording under a named condition; made once."""
    return simulate_recording(random_recipe(condition, seed))[0]


def pooled(recording: Recording, columns: int) -> np.ndarray:
    """Ranges averaged over columns, as a sensor's own filter does, where something returned."""
    seen = np.isfinite(recording.z_mm)
    kernel = np.ones(columns)
    total = np.apply_along_axis(np.convolve, 1, np.where(seen, recording.z_mm, 0.0).astype(float), kernel, "same")
    count = np.apply_along_axis(np.convolve, 1, seen.astype(float), kernel, "same")
    return np.where(seen, total / np.maximum(count, 1), np.nan).astype(np.float32)
