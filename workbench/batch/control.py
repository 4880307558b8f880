"""Control charts of single values (I-MR) with their run rules; how well a process keeps a tolerance (Cp, Cpk).

D. C. Montgomery, Introduction to Statistical Quality Control, 8th ed., chapter 6.4; the rules are those of
L. S. Nelson, Journal of Quality Technology 16 (1984) 237-239. 1, 5, 6 and 2 (with eight points) are Western Electric's.

D. C. Montgomery, Introduction to Statistical Quality Control, 8th ed., chapter 8.3; the interval of Cpk is that of
A. F. Bissell, Applied Statistics 39 (1990) 331-340. The variances add up as in any gauge study (there, chapter 8.7).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from workbench.units import Bool, Float, Int, Shaped

D2 = 2.0 / math.sqrt(math.pi)  # mean range of two normal values, in standard deviations
D4 = 1.0 + 3.0 * math.sqrt(2.0 - D2 * D2) / D2  # upper limit of that range, in mean ranges: 3.267
LEAST = 20  # values below which limits are provisional (Montgomery, 6.2)
RULES = {
    1: "one value beyond 3 sigma",
    2: "nine in a row on one side of the mean",
    3: "six in a row rising or falling",
    4: "fourteen in a row up and down in turn",
    5: "two of three beyond 2 sigma on one side",
    6: "four of five beyond 1 sigma on one side",
    7: "fifteen in a row within 1 sigma",
    8: "eight in a row beyond 1 sigma, on either side",
}


class ControlChart(NamedTuple):
    """n values in time order, in their own unit; a moving range is that between a value and the one before."""

    order: Shaped[Int, " n"]  # place of each value among all parts, hidden ones included
    value: Shaped[Float, " n"]
    centre: float
    sigma: float  # from the mean moving range: what varies from part to part, not what drifts
    moving_range: Float  # (n - 1,)
    range_limit: float
    signals: tuple[tuple[int, int], ...]  # (which of the n values, rule); rule 0: its moving range is beyond the limit

    @property
    def limits(self) -> tuple[float, float]:
        """Lower and upper control limit, 3 sigma."""
        return self.centre - 3.0 * self.sigma, self.centre + 3.0 * self.sigma


def individuals(value: Float) -> ControlChart:
    """The I-MR chart of values in time order; NaN, which was not measured, is left out.

    A signal stands at the last value of what a rule describes. By chance alone rule 1 signals once in 370 values.
    """
    order = np.flatnonzero(np.isfinite(value))
    known = value[order]
    ranges = np.abs(np.diff(known))
    mean_range = float(ranges.mean()) if len(ranges) else math.nan
    centre = float(known.mean()) if len(known) else math.nan
    sigma, limit = mean_range / D2, D4 * mean_range
    found = [(int(k), rule) for rule, flags in rules(known, centre, sigma).items() for k in np.flatnonzero(flags)]
    found += [(int(k) + 1, 0) for k in np.flatnonzero(ranges > limit)]
    return ControlChart(order, known, centre, sigma, ranges, limit, tuple(sorted(found)))


def rules(value: Float, centre: float, sigma: float) -> dict[int, Bool]:
    """For each of Nelson's rules: (n,) whether it ends at this value."""
    z = (value - centre) / sigma if sigma > 0 else np.zeros(len(value))
    step = np.sign(np.diff(z))
    turn = step[1:] * step[:-1] < 0
    return {
        1: np.abs(z) > 3,
        2: _one_sided(lambda side: _of(side * z > 0, 9, 9)),
        3: _one_sided(lambda side: _shifted(_of(side * step > 0, 5, 5), 1)),
        4: _shifted(_of(turn, 12, 12), 2),
        5: _one_sided(lambda side: _of(side * z > 2, 2, 3) & (side * z > 2)),
        6: _one_sided(lambda side: _of(side * z > 1, 4, 5) & (side * z > 1)),
        7: _of(np.abs(z) < 1, 15, 15) & (sigma > 0),
        8: _of(np.abs(z) > 1, 8, 8),
    }


def _one_sided(one_side: Callable[[float], Bool]) -> Bool:
    """(n,) whether it holds on the upper side or on the lower one."""
    return np.asarray(one_side(1.0) | one_side(-1.0))


def _of(flag: Bool, least: int, window: int) -> Bool:
    """(n,) whether `least` of the `window` flags that end here are set."""
    count = np.cumsum(np.r_[np.zeros(window, int), flag])
    return np.asarray(count[window:] - count[:-window] >= least)


def _shifted(flag: Bool, by: int) -> Bool:
    """Flags of differences as flags of values."""
    return np.concatenate([np.zeros(by, bool), flag])


CONFIDENCE = 0.95
LEAST_PARTS = 5  # values below which nothing is said


class Capability(NamedTuple):
    """Of one characteristic in one section, over n parts; intervals cover with 95 %. NaN: too few parts."""

    n: int
    mean: float
    s: float  # standard deviation of the measured values
    s_interval: tuple[float, float]
    u: float  # root of the mean squared standard uncertainty of measurement
    s_part: float  # what is left of s without u: sqrt(s^2 - u^2), 0 where u explains it all
    cp: float  # tolerance over 6 s
    cp_interval: tuple[float, float]
    cpk: float  # distance of the mean from the nearer limit over 3 s
    cpk_interval: tuple[float, float]
    slope: float  # of a straight line through the values, a part
    slope_interval: tuple[float, float]

    @property
    def trend(self) -> bool:
        """Whether the interval of the slope leaves out 0."""
        return self.slope_interval[0] > 0 or self.slope_interval[1] < 0


def capability(value: Float, u: Float, lower: float, upper: float) -> Capability:
    """From values in time order with their standard uncertainties and the limits of tolerance; NaN is left out.

    `s_part` takes u as independent from part to part. What all parts share (an error of the hand-eye pose, columns that
    meet the edge alike) is no part of the spread: the parts' own then lies between `s_part` and `s`.
    """
    order = np.flatnonzero(np.isfinite(value) & np.isfinite(u))
    n = len(order)
    if n < LEAST_PARTS:
        none = (math.nan, math.nan)
        mean = float(value[order].mean()) if n else math.nan
        nan = math.nan
        return Capability(n, mean, nan, none, nan, nan, nan, none, nan, none, nan, none)
    known = value[order]
    mean, s, u_rms = float(known.mean()), float((known - known[0]).std(ddof=1)), float(np.sqrt(np.mean(u[order] ** 2)))
    s_low, s_high = spread_interval(s, n)
    cp = (upper - lower) / (6 * s) if s else math.inf
    cpk = min(upper - mean, mean - lower) / (3 * s) if s else math.inf
    return Capability(
        n,
        mean,
        s,
        (s_low, s_high),
        u_rms,
        math.sqrt(max(0.0, s * s - u_rms * u_rms)),
        cp,
        ((upper - lower) / (6 * s_high), (upper - lower) / (6 * s_low)) if s else (cp, cp),
        cpk,
        cpk_interval(cpk, n),
        *line(order.astype(float), known),
    )


def spread_interval(s: float, n: int) -> tuple[float, float]:
    """Of a normal standard deviation estimated from n values, by chi-square."""
    from scipy.special import chdtri

    tail = (1 - CONFIDENCE) / 2
    return s * math.sqrt((n - 1) / chdtri(n - 1, tail)), s * math.sqrt((n - 1) / chdtri(n - 1, 1 - tail))


def cpk_interval(cpk: float, n: int) -> tuple[float, float]:
    """Bissell's normal approximation."""
    from scipy.special import ndtri

    half = float(ndtri((1 + CONFIDENCE) / 2)) * math.sqrt(1 / (9 * n) + cpk**2 / (2 * (n - 1)))
    return cpk - half, cpk + half


def line(x: Float, y: Float) -> tuple[float, tuple[float, float]]:
    """Slope of the least-squares line and its interval, by Student's t."""
    from scipy.special import stdtrit

    away = x - x.mean()
    slope = float(away @ y / (away @ away))
    rest = y - y.mean() - slope * away
    error = math.sqrt(float(rest @ rest) / (len(x) - 2) / float(away @ away))
    half = float(stdtrit(len(x) - 2, (1 + CONFIDENCE) / 2)) * error
    return slope, (slope - half, slope + half)
