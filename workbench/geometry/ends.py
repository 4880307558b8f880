"""Where a face ends, when its end is a silhouette: the place where its returns stop.

A single frame knows the end only to the step between two columns. Neighbouring frames cut the face at other phases of
that step, so together they know it far better; if all cut it at the same phase they know no more than one, and the
likelihood says so.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from scipy.special import ndtr

from workbench.units import Float

GRID = 121  # offsets at which the likelihood is kept
STRAY = 0.01  # probability that a frame's last return tells nothing about the end
MISSES = 6  # columns of the face that may have gone without return at its end


def end_log_likelihood(low: Float, step: Float, sigma: Float, missing: Float, grid: Float) -> Float:
    """Log-likelihood (n, GRID) of where the face ends, for each frame on the offsets `grid` (GRID,) mm.

    The face's last return in frame i lies at low[i] (n,) mm, the next column would have met it at low[i] + step[i]: the
    end lies between, uniformly (the half-pixel rule), or k steps further if k columns without return, each with
    probability missing[i], followed. All of it is blurred by sigma[i] mm, the noise of the place that `low` is
    counted from. step = 0 stands for an end measured as a corner: a normal distribution alone.
    """
    out = np.zeros((low.size, grid.size))
    blur = np.maximum(sigma, 1e-6)[:, None]
    silhouette = step > 0
    for k in range(MISSES):
        start = (low + k * step)[:, None]
        inside = ndtr((grid - start) / blur) - ndtr((grid - start - step[:, None]) / blur)
        out += np.where(silhouette[:, None], (missing[:, None] ** k) * inside, 0.0)
    corner = np.exp(-0.5 * ((grid - low[:, None]) / blur) ** 2)
    out = np.where(silhouette[:, None], out * (1.0 - missing[:, None]), corner)
    return np.log(out + STRAY * np.where(silhouette, 1.0, 0.3)[:, None])


@njit(cache=True, nogil=True)
def pooled_end(s: Float, log_likelihood: Float, at: Float, half_width: float, grid: Float) -> Float:
    """Mean, standard uncertainty and number of frames of the end's offset at each place, columns of (m, 3).

    s (n,) sorted arc lengths of the frames; log_likelihood (n, GRID) over offsets `grid`; `at` (m,). The frames within
    half_width are pooled with a flat prior. The uncertainty is half the half-width of the interval that holds
    95.45 % of the posterior: a silhouette's is no normal distribution.
    """
    out = np.full((at.size, 3), np.nan)
    total = np.zeros(grid.size)
    first = last = 0
    for i in range(at.size):
        low = np.searchsorted(s, at[i] - half_width)
        high = np.searchsorted(s, at[i] + half_width)
        if i == 0 or low >= last or (i % 64) == 0:  # a fresh sum now and then: rounding does not pile up
            total[:] = 0.0
            for j in range(low, high):
                total += log_likelihood[j]
        else:
            for j in range(first, low):
                total -= log_likelihood[j]
            for j in range(last, high):
                total += log_likelihood[j]
        first, last = low, high
        if high <= low:
            continue
        p = np.exp(total - total.max())
        p /= p.sum()
        mean = (p * grid).sum()
        cumulative = np.cumsum(p) - 0.5 * p
        lower = np.interp(0.02275, cumulative, grid)
        upper = np.interp(0.97725, cumulative, grid)
        out[i, 0], out[i, 1], out[i, 2] = mean, 0.25 * (upper - lower), high - low
    return out
