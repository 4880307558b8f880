"""How well the frames near a place know where a face ends there: the posterior of its end, given its smooth course.

Near the place the end is the fitted course plus a + b x + c x^2 (x: distance over the window's half width), with flat
priors. What the frames leave open of b and c counts in the uncertainty of a: where all frames cut the face at nearly
the same phase of the column step, that is most of it.
"""

from __future__ import annotations

import math

import numpy as np

from workbench.geometry.blocks import as_input, in_order
from workbench.geometry.ends import FAR_SIGMAS, MISSES, STRAY, Ends, SmoothEnd, cdf, contradicted, local_end
from workbench.kernels import kernel
from workbench.units import Float, Int

GRID = 161  # offsets from the fitted course at which likelihoods are kept
BIN_MM = 1.0  # frames this near to each other share one likelihood
NODES = (21, 7, 5)  # of a, b, c in each round
ROUNDS = 6
REACH_SIGMAS = 4.0  # half width of the next round's box, in posterior standard deviations
NEGLIGIBLE = 25.0  # of log-likelihood below the best
PLACES = 32  # in a block
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
    value, u = course.spline(np.clip(at_mm, ends.s[0], ends.s[-1])) + found[:, 0], found[:, 1]
    off_course = np.flatnonzero(contradicted(ends, expected, at_mm) & np.isfinite(value))
    value[off_course], u[off_course] = local_end(ends, at_mm[off_course])
    return value, u


def _tables(low: Float, step: Float, sigma: Float, missing: Float, weight: Float, grid: Float,
            bin_of: Int) -> Float:  # fmt: skip
    """Log-likelihood of the end on the offsets `grid`, summed over the frames of each bin: (bins, GRID)."""
    out = np.zeros((bin_of[-1] + 1, grid.size))
    start = as_input(np.searchsorted(bin_of, np.arange(len(out) + 1)))
    frames = as_input(low), as_input(step), as_input(sigma), as_input(missing), as_input(weight)
    for _ in in_order(lambda i, j: _add_up(*frames, grid, start, i, j, out), len(out), PLACES):
        pass
    return out


@kernel
def _add_up(low: Float, step: Float, sigma: Float, missing: Float, weight: Float, grid: Float, start: Int, first: int,
            last: int, out: Float) -> None:  # fmt: skip
    """Rows first to last - 1 of `_tables`; start (bins + 1,): first frame of each bin."""
    for b in range(first, last):
        for i in range(start[b], start[b + 1]):
            _add(low[i], step[i], max(sigma[i], 1e-5), missing[i], weight[i], grid, out[b])


@kernel
def _add(low: float, step: float, blur: float, missing: float, weight: float, grid: Float, out: Float) -> None:
    """Add one frame's log-likelihood on the offsets `grid` to `out`."""
    before, log = 1.0, 0.0
    for g in range(grid.size):
        likelihood, a = STRAY, (grid[g] - low) / blur
        if step <= 0.0:
            likelihood += math.exp(-0.5 * a * a)
        else:
            share, above = 1.0 - missing, cdf(a)
            for _ in range(MISSES):
                if a < -FAR_SIGMAS:
                    break
                a -= step / blur
                below = cdf(a)
                likelihood += share * (above - below)
                above, share = below, share * missing
        if likelihood != before:  # far from the limits of columns it is the same at many offsets
            before, log = likelihood, math.log(likelihood)
        out[g] += weight * log


def _posteriors(place: Float, tables: Float, at: Float, half_width: float, reach: float) -> Float:
    """Mean and uncertainty of a at each of `at` (m,): (m, 2); NaN where no frame is near."""
    out = np.full((at.size, 2), np.nan)
    near = np.stack([np.searchsorted(place, at - half_width), np.searchsorted(place, at + half_width)], axis=1)
    most = np.concatenate([[0.0], np.cumsum(tables.max(axis=1))])
    known = as_input(place), as_input(tables), as_input(most), as_input(at), as_input(near)
    for _ in in_order(lambda i, j: _fill(*known, half_width, reach, out, i, j), at.size, PLACES):
        pass
    return out


@kernel
def _fill(place: Float, tables: Float, most: Float, at: Float, near: Int, half_width: float, reach: float, out: Float,
          start: int, stop: int) -> None:  # fmt: skip
    """Rows start to stop - 1 of `_posteriors`; most (bins + 1,): sum of the bins' greatest log-likelihoods so far."""
    for i in range(start, stop):
        first, last = near[i, 0], near[i, 1]
        if last > first:
            x = (place[first:last] - at[i]) / half_width
            out[i, 0], out[i, 1] = _posterior(x, tables, most, first, reach)


@kernel
def _total(x: Float, tables: Float, most: Float, first: int, a: float, b: float, c: float, reach: float,
           least: float) -> float:  # fmt: skip
    """Log-likelihood of a, b, c; -inf as soon as it cannot reach `least` any more."""
    scale = (tables.shape[1] - 1) / (2.0 * reach)
    total, last = 0.0, first + x.size
    for j in range(x.size):
        g = (a + b * x[j] + c * x[j] * x[j] + reach) * scale
        k = min(max(int(g), 0), tables.shape[1] - 2)
        f = min(max(g - k, 0.0), 1.0)
        total += (1.0 - f) * tables[first + j, k] + f * tables[first + j, k + 1]
        if total + most[last] - most[first + j + 1] < least:
            return -math.inf
    return total


@kernel
def _posterior(x: Float, tables: Float, most: Float, first: int, reach: float) -> tuple[float, float]:
    """Mean of a and a quarter of its 95.45 % interval, by grids that close in on the posterior."""
    centre, half = np.zeros(3), np.full(3, reach)
    nodes, along = np.zeros((3, max(NODES))), np.zeros((3, max(NODES)))
    for _ in range(ROUNDS):
        for d in range(3):
            for n in range(NODES[d]):
                nodes[d, n] = centre[d] + half[d] * (2.0 * n / (NODES[d] - 1) - 1.0)
        _marginals(x, tables, most, first, reach, nodes, along)
        close = True
        for d in range(3):
            mean, square = 0.0, 0.0
            for n in range(NODES[d]):
                mean += along[d, n] * nodes[d, n]
            for n in range(NODES[d]):
                square += along[d, n] * (nodes[d, n] - mean) ** 2
            wanted = min(max(REACH_SIGMAS * math.sqrt(square), 2.0 * half[d] / (NODES[d] - 1)), 1.5 * half[d])
            close = close and abs(wanted / half[d] - 1.0) < 0.3
            centre[d], half[d] = mean, wanted
        if close:
            break
    return centre[0], 0.25 * (_quantile(nodes[0], along[0], 0.97725) - _quantile(nodes[0], along[0], 0.02275))


@kernel
def _marginals(x: Float, tables: Float, most: Float, first: int, reach: float, nodes: Float, along: Float) -> None:
    """Fill `along` (3, n): shares of the posterior at the `nodes` (3, n) of a, b and c."""
    p = np.empty(NODES)
    highest = -math.inf
    for n in range(-1, p.size):  # the middle first: what lies far below it need not be summed to its end
        i, j, k = n // (NODES[1] * NODES[2]), n // NODES[2] % NODES[1], n % NODES[2]
        if n < 0:
            i, j, k = NODES[0] // 2, NODES[1] // 2, NODES[2] // 2
        p[i, j, k] = _total(x, tables, most, first, nodes[0, i], nodes[1, j], nodes[2, k], reach, highest - NEGLIGIBLE)
        highest = max(highest, p[i, j, k])
    along[:] = 0.0
    total = 0.0
    for i in range(NODES[0]):
        for j in range(NODES[1]):
            for k in range(NODES[2]):
                mass = math.exp(p[i, j, k] - highest)
                total += mass
                along[0, i] += mass
                along[1, j] += mass
                along[2, k] += mass
    for d in range(3):
        for n in range(NODES[d]):
            along[d, n] /= total


@kernel
def _quantile(nodes: Float, mass: Float, share: float) -> float:
    """Where the cumulated mass, half of each node's own before it, reaches `share`; linear between nodes."""
    before, at = 0.0, 0.5 * mass[0]
    if share <= at:
        return float(nodes[0])
    for n in range(1, nodes.size):
        before, at = at, at + 0.5 * (mass[n - 1] + mass[n])
        if share <= at:
            return float(nodes[n - 1] + (share - before) / (at - before) * (nodes[n] - nodes[n - 1]))
    return float(nodes[-1])
