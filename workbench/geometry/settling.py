"""Freeing the ends of a face, frame by frame, of noise that neighbouring frames do not share."""

from __future__ import annotations

import math

import numpy as np

from workbench.kernels import kernel
from workbench.units import Float, Int

SETTLE_FRAMES = 31
SETTLE_GAP = 4  # frames that may be missing between neighbours
LIMIT_SIGMAS = 1.5  # room for noise at a column's limits where frames share it
SHARED_NOISE = 0.2  # of the variance, left by smoothing over them


def settled(low: Float, step: Float, sigma: Float, column: Int, group: Int) -> tuple[Float, Float, Float, Float]:
    """`low` and `step` (n,) freed of noise that neighbouring frames do not share; what remains of it, mm; and weights.

    Noise of the corner that `low` is counted from blurs the steps of the columns, and blurred steps feign knowledge of
    where between two columns the end lies. Frames in order of time, column (n,) of the last return counted outwards:
    low - column * step runs smoothly, but for noise and vibration; what the noise explains of its scatter is taken off.
    What remains is shared by neighbours: while the end passes one limit of a column slowly, they say one thing, and it
    may lie on the limit in all of them; `low` and `step` then leave room for the noise.
    """
    low, step, sigma, weight = low.copy(), step.copy(), sigma.copy(), np.ones(low.size)
    for g in np.unique(group):
        mine = np.flatnonzero((group == g) & np.isfinite(low) & (step > 0))
        if mine.size < 2 * SETTLE_FRAMES:
            continue
        course = low[mine] - (column[mine] - np.median(column[mine])) * np.median(step[mine])
        smooth, drift = np.empty(mine.size), np.empty(mine.size)
        for part in np.split(np.arange(mine.size), np.flatnonzero(np.diff(mine) > SETTLE_GAP) + 1):
            smooth[part], drift[part] = _running_line(course[part], min(SETTLE_FRAMES, part.size))
        rough = course - smooth
        spread = float(np.median(np.abs(rough)) / 0.6745) ** 2
        noise = float(np.median(sigma[mine]) ** 2) * (1.0 - 2.25 / SETTLE_FRAMES)
        share = min(1.0, noise / max(spread, 1e-12))
        low[mine] -= share * np.clip(rough, -3.0 * sigma[mine], 3.0 * sigma[mine])
        sigma[mine] *= math.sqrt(max(1.0 - share, SHARED_NOISE))
        alike = np.clip(2.0 * sigma[mine] / np.maximum(np.abs(drift), 1e-9), 1.0, 0.5 * SETTLE_FRAMES)
        weight[mine] = 1.0 / (1.0 + share**2 * (alike - 1.0))
        room = LIMIT_SIGMAS * sigma[mine] * (1.0 - weight[mine])
        low[mine] -= room
        step[mine] += 2.0 * room
    return low, step, sigma, weight


@kernel
def _running_line(y: Float, window: int) -> tuple[Float, Float]:
    """Value and slope at each place of the line through the `window` places around it (shifted inwards at the ends)."""
    out, slopes = np.empty(y.size), np.empty(y.size)
    half = window // 2
    for i in range(y.size):
        first = min(max(i - half, 0), y.size - window)
        my = y[first : first + window].mean()
        mx = 0.5 * (window - 1)
        sxy = 0.0
        for k in range(window):
            sxy += (k - mx) * (y[first + k] - my)
        slopes[i] = sxy / max(window * (window * window - 1.0) / 12.0, 1.0)
        out[i] = my + slopes[i] * (i - first - mx)
    return out, slopes
