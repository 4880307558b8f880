"""How well the frames near a place know where a face ends there: the posterior of its end, given its smooth course.

Near the place the end is the fitted course plus a + b x + c x^2 (x: distance over the window's half width), with flat
priors. What the frames leave open of b and c counts in the uncertainty of a: where all frames cut the face at nearly
the same phase of the column step, that is most of it.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit, prange

from workbench.geometry.ends import MISSES, STRAY, Ends, SmoothEnd, cdf
from workbench.units import Float, Int

GRID = 161  # offsets from the fitted course at which likelihoods are kept
BIN_MM = 1.0  # frames this near to each other share one likelihood
NODES = (21, 7, 5)  # of a, b, c in each round
ROUNDS = 6
REACH_SIGMAS = 4.0  # half width of the next round's box, in posterior standard deviations
WINDOW = 0.7  # half width of the window over the distance of the course's knots


def end_at(ends: Ends, course: SmoothEnd, at_mm: Float) -> tuple[Float, Float]:
    """The end and its standard uncertainty at arc lengths at_mm (m,), mm.

    The uncertainty is half the half-width of the interval that holds 95.45 % of the posterior: a silhouette's is no
    normal distribution.
    """
    expected = course.spline(ends.s)
    reach = max(2.5 * float(np.median(ends.step)), 6.0 * float(np.median(ends.sigma)), 0.02)
    grid = np.linspace(-reach, reach, GRID)
    number = np.floor((ends.s - ends.s[0]) / BIN_MM).astype(np.int64)
    _, bin_of = np.unique(number, return_inverse=True)
    tables = _tables(ends.low - expected, ends.step, ends.sigma, ends.missing, ends.weight, grid, bin_of)
    count = np.bincount(bin_of)
    place = np.bincount(bin_of, ends.s) / count
    half_width = WINDOW * course.knots_mm
    found = _posteriors(place, tables, at_mm, half_width, reach)
    return course.spline(np.clip(at_mm, ends.s[0], ends.s[-1])) + found[:, 0], found[:, 1]


@njit(cache=True, nogil=True)
def _tables(low: Float, step: Float, sigma: Float, missing: Float, weight: Float, grid: Float,
            bin_of: Int) -> Float:  # fmt: skip
    """Log-likelihood of the end on the offsets `grid`, summed over the frames of each bin: (bins, GRID)."""
    out = np.zeros((bin_of[-1] + 1, grid.size))
    for i in range(low.size):
        blur = max(sigma[i], 1e-5)
        row = out[bin_of[i]]
        for g in range(grid.size):
            if step[i] <= 0.0:
                row[g] += weight[i] * math.log(math.exp(-0.5 * ((grid[g] - low[i]) / blur) ** 2) + STRAY)
                continue
            mass = 0.0
            for k in range(MISSES):
                a = (grid[g] - low[i] - k * step[i]) / blur
                if a < -6.0:
                    break
                mass += (1.0 - missing[i]) * missing[i] ** k * (cdf(a) - cdf(a - step[i] / blur))
            row[g] += weight[i] * math.log(mass + STRAY)
    return out


@njit(cache=True, nogil=True, parallel=True)
def _posteriors(place: Float, tables: Float, at: Float, half_width: float, reach: float) -> Float:
    """Mean and uncertainty of a at each of `at` (m,): (m, 2); NaN where no frame is near."""
    out = np.full((at.size, 2), np.nan)
    for i in prange(at.size):
        first = np.searchsorted(place, at[i] - half_width)
        last = np.searchsorted(place, at[i] + half_width)
        if last > first:
            x = (place[first:last] - at[i]) / half_width
            out[i, 0], out[i, 1] = _posterior(x, tables[first:last], reach)
    return out


@njit(cache=True, nogil=True)
def _total(x: Float, tables: Float, a: float, b: float, c: float, reach: float) -> float:
    scale = (tables.shape[1] - 1) / (2.0 * reach)
    total = 0.0
    for j in range(x.size):
        g = (a + b * x[j] + c * x[j] * x[j] + reach) * scale
        k = min(max(int(g), 0), tables.shape[1] - 2)
        f = min(max(g - k, 0.0), 1.0)
        total += (1.0 - f) * tables[j, k] + f * tables[j, k + 1]
    return total


@njit(cache=True, nogil=True)
def _posterior(x: Float, tables: Float, reach: float) -> tuple[float, float]:
    """Mean of a and a quarter of its 95.45 % interval, by grids that close in on the posterior."""
    centre, half = np.zeros(3), np.full(3, reach)
    size = np.array(NODES)
    marginal, nodes = np.zeros(1), np.zeros(1)
    for _ in range(ROUNDS):
        a = np.linspace(centre[0] - half[0], centre[0] + half[0], size[0])
        b = np.linspace(centre[1] - half[1], centre[1] + half[1], size[1])
        c = np.linspace(centre[2] - half[2], centre[2] + half[2], size[2])
        p = np.empty((size[0], size[1], size[2]))
        for i in range(size[0]):
            for j in range(size[1]):
                for k in range(size[2]):
                    p[i, j, k] = _total(x, tables, a[i], b[j], c[k], reach)
        p = np.exp(p - p.max())
        p /= p.sum()
        marginal, nodes = p.sum(axis=2).sum(axis=1), a
        close = True
        for d in range(3):
            axis = a if d == 0 else (b if d == 1 else c)
            along = marginal if d == 0 else (p.sum(axis=2).sum(axis=0) if d == 1 else p.sum(axis=0).sum(axis=0))
            mean = (along * axis).sum()
            spread = math.sqrt(max((along * (axis - mean) ** 2).sum(), 0.0))
            wanted = min(max(REACH_SIGMAS * spread, 2.0 * half[d] / (size[d] - 1)), 1.5 * half[d])
            close = close and abs(wanted / half[d] - 1.0) < 0.3
            centre[d], half[d] = mean, wanted
        if close:
            break
    cumulative = np.cumsum(marginal) - 0.5 * marginal
    lower, upper = np.interp(0.02275, cumulative, nodes), np.interp(0.97725, cumulative, nodes)
    return (marginal * nodes).sum(), 0.25 * (upper - lower)
