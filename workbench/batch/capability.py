"""How well a process keeps a tolerance: Cp and Cpk, and what of the spread is the parts' own.

D. C. Montgomery, Introduction to Statistical Quality Control, 8th ed., chapter 8.3; the interval of Cpk is that of
A. F. Bissell, Applied Statistics 39 (1990) 331-340. The variances add up as in any gauge study (there, chapter 8.7).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from workbench.units import Float

CONFIDENCE = 0.95
LEAST = 5  # values below which nothing is said


@dataclass(frozen=True, slots=True)
class Capability:
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
    if n < LEAST:
        none = (math.nan, math.nan)
        mean = float(value[order].mean()) if n else math.nan
        nan = math.nan
        return Capability(n, mean, nan, none, nan, nan, nan, none, nan, none, nan, none)
    known = value[order]
    mean, s, u_rms = float(known.mean()), float(known.std(ddof=1)), float(np.sqrt(np.mean(u[order] ** 2)))
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
