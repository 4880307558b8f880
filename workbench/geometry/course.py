"""The one estimator of everything that runs smoothly along an edge: directions, sizes, the edge's own course.

A course f(s) is a cubic spline with the prior of two random walks at once, of its derivatives of two orders
(docs/method.md, eq. (1)): the data say by their marginal likelihood how stiff it is (eq. (3)), and the answer is
averaged over what they leave open (eq. (4)). Noise is that of neighbouring bins, not of a count of frames (eq. (2)).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import BSpline

from workbench.geometry.blocks import as_input
from workbench.geometry.penalised import penalised
from workbench.kernels import kernel
from workbench.units import Bool, Float, Int

BIN_MM, LEAST_BINS = 2.0, 40  # frames are averaged over this much edge, or over this part of a short one
LEAST_PIECES = 5  # of the spline; else its knots are two bins apart
OUTLIER_SIGMAS = 5.0  # of the frames' own scatter; one in two million by chance
STIFFNESSES = 9  # grid of each random walk's strength, from unseen to free, a factor of about 5 apart
STIFFEST_MM = 150.0  # no course is taken for straighter than over this length
LEAST_SHARE = 2e-3  # of the posterior, for a stiffness to count
TEMPER = 1.0
HIDDEN, HIDDEN_MM = 0.3, 20.0  # a walk is assumed that this much edge cannot tell from noise, whatever the data say
PRIOR_FREEDOM = 6.0  # weight, in bins, of the stated noise beside the noise that is found


@dataclass(frozen=True, slots=True, eq=False)
class Course:
    """A smooth function of arc length with its uncertainty: posterior mean and standard deviation."""

    spline: BSpline  # mean; values () or (d,)
    at_mm: Float  # (k,) where the uncertainty was computed
    variance: Float  # (k,) of each component there
    slope_variance: Float  # (k,) of df/ds
    kept: Bool  # (n,) False: outliers, and what was not finite
    frame_factor: float  # variance of single values over the stated one
    noise_factor: float  # the same of bins of values: larger where neighbouring values share noise
    misfit: float  # mean square of the bins' residuals over their variance; 1: as the noise says
    log_evidence: float
    stiffness: Float  # (j, 3) strengths of both random walks and their posterior share

    def value(self, s: Float) -> Float:
        """f(s): (m,) or (m, d). Constant beyond the ends of what was seen."""
        return np.asarray(self.spline(self._inside(s)))

    def slope(self, s: Float) -> Float:
        """df/ds: (m,) or (m, d)."""
        return np.asarray(self.spline(self._inside(s), 1))

    def u(self, s: Float) -> Float:
        """Standard uncertainty (m,) of each component of f(s)."""
        return np.sqrt(np.interp(s, self.at_mm, self.variance))

    def slope_u(self, s: Float) -> Float:
        """Standard uncertainty (m,) of each component of df/ds."""
        return np.sqrt(np.interp(s, self.at_mm, self.slope_variance))

    def _inside(self, s: Float) -> Float:
        return np.clip(s, self.spline.t[3], self.spline.t[-4])


@dataclass(frozen=True, slots=True, eq=False)
class Bins:
    """Values averaged over short stretches of edge, pass by pass."""

    s: Float  # (b,)
    y: Float  # (b, d)
    variance: Float  # (b,) as the stated variances say
    group: Int  # (b,)
    kept: Bool  # (n,)
    frame_factor: float


def fit_course(
    s: Float,
    y: Float,
    variance: Float | None = None,
    group: Int | None = None,
    orders: tuple[int, int] = (1, 2),
    stiffness: Float | None = None,
    least_walk: float = 0.0,
    together_mm: float | None = None,
) -> Course:
    """The smooth course of values y (n,) or (n, d) at arc lengths s (n,) mm, in any order; NaN is left out.

    Args:
        s: arc lengths, mm.
        y: values; components of a vector share stiffness and noise.
        variance: (n,) stated variance of each value; None: unknown and equal. What the bins scatter more is added.
        group: (n,) pass of each value: noise is taken from neighbours in one pass.
        orders: derivatives that walk randomly; (1, 2): constant but for waves; (2, 3): straight but for these.
        least_walk: variance that the first walk has over a millimetre at least: what may go unseen between the values.
        together_mm: length over which values share their scatter: bins are at least this long, waves four times.
        stiffness: that of an earlier course through the same values, which saves the search.

    Example:
        >>> s = np.linspace(0.0, 100.0, 400)
        >>> course = fit_course(s, 2.0 + 0.01 * s)
        >>> bool(abs(course.value(np.array([50.0]))[0] - 2.5) < 1e-3)
        True
    """
    stated = variance is not None
    bins, between = _aligned(binned(s, y, variance, group, together_mm or BIN_MM))
    noise_factor = max(_noise_factor(bins, stated), 1.0) if stated else _noise_factor(bins, stated)
    weight = 1.0 / (bins.variance * noise_factor)
    knots = _knots(np.asarray(s)[bins.kept], 2.0 * (together_mm or BIN_MM))  # bins end before the values do
    trend = _trend(bins, weight, min(orders))  # what no walk holds back; taken off, since sums of squares lose digits
    problem = penalised(np.clip(bins.s, knots[3], knots[-4]), bins.y - trend(bins.s), weight, knots, orders)
    grid = _grid(bins, weight, orders, least_walk) if stiffness is None else stiffness[:, :2]
    scores = problem.evidence(grid)
    share = np.exp(TEMPER * (scores - scores.max()))
    share /= share.sum()
    counts = share > LEAST_SHARE
    share = share[counts] / share[counts].sum()
    stations = np.linspace(knots[3], knots[-4], min(4 * (knots.size - 7), knots.size + 200))
    coefficients, value, slope = problem.average(grid[counts], share, stations)
    coefficients = coefficients + trend(knots[2:-2])  # of a straight line these are its values at the knots' averages
    mean = coefficients if np.ndim(y) > 1 else coefficients[:, 0]
    spline = BSpline(knots, mean, 3)
    left = bins.y - spline(np.clip(bins.s, knots[3], knots[-4])).reshape(bins.y.shape)
    spent = float((weight * np.interp(bins.s, stations, value)).sum())
    misfit = float((weight[:, None] * left**2).sum()) / (left.shape[1] * max(weight.size - spent, 1.0))
    raised, value = max(1.0, misfit), value + between / max(1.0, misfit)
    found = np.column_stack([grid[counts], share])
    return Course(
        spline,
        stations,
        value * raised,
        slope * raised,
        bins.kept,
        bins.frame_factor,
        noise_factor,
        misfit,
        float(scores.max() + math.log(np.exp(scores - scores.max()).mean())),
        found,
    )


def binned(s: Float, y: Float, variance: Float | None = None, group: Int | None = None, bin_mm: float = BIN_MM) -> Bins:
    """Means of y (n,) or (n, d) over bins along s (n,), outliers left out, each pass by itself."""
    values = np.asarray(y, dtype=float).reshape(len(s), -1)
    stated = np.ones(len(s)) if variance is None else np.asarray(variance, dtype=float)
    passes = np.zeros(len(s), np.int64) if group is None else np.asarray(group)
    kept = np.isfinite(s) & np.isfinite(values).all(axis=1) & np.isfinite(stated) & (stated > 0)
    if not kept.any():
        raise ValueError("expected a finite value")
    least = LEAST_BINS if bin_mm <= BIN_MM else LEAST_BINS // 4
    width = min(bin_mm, max(float(np.ptp(s[kept])), 1e-6) / least)
    kept &= _inliers(s, values, stated, passes, kept, width)
    return _means(s, values, stated, passes, kept, width)


def _aligned(bins: Bins) -> tuple[Bins, float]:
    """The bins with each pass's own offset taken off (they still average to 0), and the variance that this leaves.

    Passes differ by what the robot repeats within a pass and not between passes: that is no wave of the course.
    """
    passes = np.unique(bins.group)
    if passes.size < 2:
        return bins, 0.0
    width = 4.0 * float(np.median(np.diff(np.unique(bins.s)))) + 1e-9
    cell = np.floor((bins.s - bins.s.min()) / width).astype(np.int64)
    off, weight = np.zeros((passes.size, bins.y.shape[1])), np.zeros(passes.size)
    for k, p in enumerate(passes):  # against the mean of all passes, where it shares a stretch with another
        mine = bins.group == p
        shared = mine & np.isin(cell, cell[~mine])
        for i in np.flatnonzero(shared):
            there = ~mine & (cell == cell[i])
            off[k] += bins.y[i] - bins.y[there].mean(axis=0)
        weight[k] = shared.sum()
    if not (weight > 0).any():
        return bins, 0.0
    # Each difference is against the others' mean: of g passes, g / (g - 1) times the pass's own offset.
    off = off / np.maximum(weight, 1.0)[:, None] * (passes.size - 1) / passes.size
    off -= np.average(off, axis=0, weights=weight)
    number = np.searchsorted(passes, bins.group)
    seen = weight > 0
    between = float((off[seen] ** 2).mean(axis=1).sum()) / max(seen.sum() * (seen.sum() - 1), 1)
    return replace(bins, y=bins.y - off[number]), between


def _number(s: Float, passes: Int, width: float) -> Int:
    """Number of each value's bin; bins of a pass follow each other."""
    along = np.floor((s - s.min()) / width).astype(np.int64)
    _, which = np.unique(passes, return_inverse=True)
    _, number = np.unique(which * (along.max() + 2) + along, return_inverse=True)
    return np.asarray(number)


def _inliers(s: Float, y: Float, variance: Float, passes: Int, kept: Bool, width: float) -> Bool:
    """Values within OUTLIER_SIGMAS of the running median of their neighbouring bins' medians."""
    out = kept.copy()
    on = np.flatnonzero(kept)
    order = on[np.lexsort((s[on], passes[on]))]
    number = _number(s[order], passes[order], 2.0 * width)
    first = np.flatnonzero(np.diff(number, prepend=-1))
    place = _medians(s[order], first)
    of_pass = passes[order[first]]
    for k in range(y.shape[1]):
        middle = _medians(y[order, k], first)
        for p in np.unique(of_pass):
            mine = of_pass == p
            values = middle[mine]
            if values.size >= 3:
                inner = np.median(np.stack([values[:-2], values[1:-1], values[2:]]), axis=0)
                values = np.concatenate([[values[0]], inner, [values[-1]]])
            here = order[passes[order] == p]
            if here.size < 5:
                continue
            off = np.abs(y[here, k] - _interpolated(s[here], place[mine], values)) / np.sqrt(variance[here])
            out[here] &= off <= OUTLIER_SIGMAS * max(float(np.median(off)) / 0.6745, 1e-12)
    return out


def _medians(values: Float, first: Int) -> Float:
    """Medians of the runs of values (n,) that begin at `first` (r,)."""
    out = np.empty(first.size)
    _fill_medians(as_input(values), as_input(np.append(first, values.size)), out)
    return out


@kernel
def _fill_medians(values: Float, edges: Int, out: Float) -> None:
    for k in range(out.size):
        run = np.sort(values[edges[k] : edges[k + 1]])
        out[k] = 0.5 * (run[(run.size - 1) // 2] + run[run.size // 2])


def _interpolated(s: Float, at: Float, values: Float) -> Float:
    """Linear interpolation, going on in a straight line beyond the outer places."""
    if at.size < 2:
        return np.full(s.shape, values[0])
    i = np.clip(np.searchsorted(at, s), 1, at.size - 1)
    share = (s - at[i - 1]) / np.maximum(at[i] - at[i - 1], 1e-9)
    return np.asarray(values[i - 1] + np.clip(share, -1.0, 2.0) * (values[i] - values[i - 1]))


def _means(s: Float, y: Float, variance: Float, passes: Int, kept: Bool, width: float) -> Bins:
    on = np.flatnonzero(kept)
    number = _number(s[on], passes[on], width)
    weight = 1.0 / variance[on]
    total = np.bincount(number, weight)
    place = np.bincount(number, weight * s[on]) / total
    mean = np.stack([np.bincount(number, weight * y[on, k]) / total for k in range(y.shape[1])], axis=1)
    group = np.zeros(total.size, np.int64)
    group[number] = passes[on]
    count = np.bincount(number)
    near = np.diff(place, prepend=-np.inf, append=np.inf)  # slope within the bin, from the bins beside it
    slope = np.zeros_like(mean)
    for k in range(mean.shape[1]):
        step = np.diff(mean[:, k], prepend=np.nan, append=np.nan)
        joined = (np.abs(near) < 3.0 * width) & (near > 0)
        both = np.where(joined, step, 0.0) / np.where(joined, near, 1.0)
        slope[:, k] = (both[:-1] + both[1:]) / np.maximum(joined[:-1].astype(float) + joined[1:], 1.0)
    off = y[on] - mean[number] - slope[number] * (s[on] - place[number])[:, None]
    free = max(float((count - 1).sum()), 0.0) * y.shape[1]
    factor = float((weight[:, None] * off**2).sum()) / free if free >= 10 else 1.0
    return Bins(place, mean, 1.0 / total, group, kept, factor)


def _noise_factor(bins: Bins, stated: bool) -> float:
    """Variance of the bins' means over the stated one, from what each differs from its neighbours' line (eq. (2))."""
    between = np.zeros(bins.s.size, bool)
    gap = np.diff(bins.s)
    widest = 2.5 * float(np.median(gap[gap > 0])) if (gap > 0).any() else 0.0
    joined = (np.diff(bins.group) == 0) & (gap > 0) & (gap <= widest)
    between[1:-1] = joined[:-1] & joined[1:]
    k = np.flatnonzero(between)
    known = max(1.0, bins.frame_factor) if stated else bins.frame_factor
    if k.size < 4:
        return known if stated or bins.s.size > 4 else max(known, 1e-12)
    share = (bins.s[k] - bins.s[k - 1]) / (bins.s[k + 1] - bins.s[k - 1])
    off = bins.y[k] - (1.0 - share)[:, None] * bins.y[k - 1] - share[:, None] * bins.y[k + 1]
    expected = bins.variance[k] + (1.0 - share) ** 2 * bins.variance[k - 1] + share**2 * bins.variance[k + 1]
    z2 = off**2 / expected[:, None]
    typical = float(np.median(z2)) / 0.4549
    bounded = np.minimum(z2, 9.0 * typical)
    free = k.size * z2.shape[1] / 2.0  # neighbours share values
    prior = PRIOR_FREEDOM if stated else 0.0
    return float(max((free * float(bounded.mean()) + prior * known) / (free + prior), 1e-12))


def _knots(s: Float, knots_mm: float) -> Float:
    first, last = float(s.min()), float(s.max())
    last = max(last, first + 1e-3)
    pieces = max(LEAST_PIECES, math.ceil((last - first) / knots_mm))
    step = (last - first) / pieces
    return np.asarray(first + step * np.arange(-3, pieces + 4))


def _trend(bins: Bins, weight: Float, order: int) -> Callable[[Float], Float]:
    """The least-squares constant (order 1) or straight line (order 2) through the bins."""
    middle = float(np.average(bins.s, weights=weight))
    mean = np.average(bins.y, axis=0, weights=weight)
    off = bins.s - middle
    spread = float((weight * off**2).sum())
    slope = (weight * off) @ (bins.y - mean) / spread if order > 1 and spread > 0 else np.zeros(mean.size)
    return lambda s: np.asarray(mean + (s - middle)[:, None] * slope)


def _grid(bins: Bins, weight: Float, orders: tuple[int, int], least_walk: float) -> Float:
    """Strengths (j, 2) of both random walks to choose from.

    A walk of order d with strength q takes a course about q^(1/2) length^(d - 1/2) away over a length: from a tenth of
    what all bins together resolve to ten times their spread.
    """
    least = 0.1 / math.sqrt(float(weight.sum()))
    most = 10.0 * max(float(np.max(np.std(bins.y, axis=0))), least)
    whole = max(float(np.ptp(bins.s)), 1e-3)
    length = min(whole, STIFFEST_MM)
    away = np.geomspace(least, max(most, 10.0 * least), STIFFNESSES)
    hidden = HIDDEN / math.sqrt(HIDDEN_MM * float(weight.sum()) / whole)  # what HIDDEN_MM of edge cannot tell
    least_one = max(hidden**2 / min(HIDDEN_MM, length) ** (2 * orders[0] - 1), least_walk)
    one = np.geomspace(least_one, max(away[-1] ** 2 / length ** (2 * orders[0] - 1), 10.0 * least_one), STIFFNESSES)
    least_two = hidden**2 / (2.0 * min(HIDDEN_MM, length)) ** (2 * orders[1] - 1)
    most_two = away[-1] ** 2 / (2.0 * BIN_MM) ** (2 * orders[1] - 1)
    two = np.geomspace(least_two, max(most_two, 10.0 * least_two), 2 * STIFFNESSES)
    return np.array([(a, b) for a in one for b in two])
