"""By how much a cut face lies beside its plan along the edge, told apart from what the robot will not repeat.

The values d at arc lengths s are a sum of five Gaussian parts (C. E. Rasmussen, C. K. I. Williams, Gaussian Processes
for Machine Learning, 2006, sections 2.2, 2.7 and 5.4.1):

    d(s) = c + a(s) . v + w s + f(s) + g(s) + e(s)

c is an error constant in the tool's frame, v one constant in the base (a: the direction along which it shows), w grows
along the edge (wear); f repeats whenever the robot goes the same way; g, the robot's repeatability, does not; e is the
measurement's. What the next pass will show again is c + a . v + w s + f: its expectation given d is the estimate.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import numpy as np
from scipy.linalg import LinAlgError, cho_factor, cho_solve

from workbench.units import Float

MOST_POINTS = 200  # of the edge that count, evenly spread
TOGETHER_MM = 10.0  # over which errors of a profile hang together: its values share frames (inspect.sections)
WEAR_SHARE = 0.1  # of a constant error, that may grow along the edge
LENGTHS_MM = (25.0, 50.0, 100.0, 200.0)  # of f
SHARES = (0.01, 0.02, 0.04, 0.08, 0.16, 0.32)  # its standard deviation, over that of a constant error
BETTER = 6.0  # twice the gain in log-likelihood that speaks for f: chi^2 with 2 degrees of freedom, 95 %
GRAIN = 1e-3  # white noise, over the constant error's: no value is exact


@dataclass(frozen=True, slots=True, eq=False)
class Estimate:
    """What the next pass will show again, at m places; units are those of the values."""

    value: Float  # (m,)
    u: Float  # (m,) the measurement's own uncertainty included, which no averaging along the edge reduces
    variation: float  # standard deviation of f
    length_mm: float  # its correlation length

    @property
    def significant(self) -> bool:
        """Whether the values differ from 0 by more than 2 u, as a root mean square along the edge."""
        return bool(np.sqrt(np.mean((self.value / self.u) ** 2)) > 2.0)


def estimate(
    s: Float,
    values: Float,
    u: Float,
    axes: Float,
    at: Float,
    axes_at: Float,
    largest: float,
    unrepeated: float,
    unrepeated_length_mm: float,
) -> Estimate:
    """Estimate what repeats from values at arc lengths `s` (n,), finite and in any order, for arc lengths `at` (m,).

    Args:
        s: (n,) mm.
        values: (n,) d.
        u: (n,) their standard uncertainties.
        axes: (n, 3) the direction a in the base.
        at: (m,) mm.
        axes_at: (m, 3) a there.
        largest: standard deviation that a constant error may have.
        unrepeated: standard deviation of g.
        unrepeated_length_mm: its correlation length.
    """
    few = np.unique(np.linspace(0, len(s) - 1, min(MOST_POINTS, len(s))).astype(np.int64))
    order = np.argsort(s)[few]
    s, d, u_d, axes = s[order], values[order], u[order], axes[order]
    middle, span = 0.5 * (s[0] + s[-1]), max(float(s[-1] - s[0]), 1.0)
    constant, constant_at = _constant(s, axes, middle, span), _constant(at, axes_at, middle, span)
    known = largest**2 * constant @ constant.T + (GRAIN * largest) ** 2 * np.eye(len(s))
    known += unrepeated**2 * _rough(s, unrepeated_length_mm) + np.outer(u_d, u_d) * _rough(s, TOGETHER_MM)
    best, variation, length = _likelihood(known, d) + 0.5 * BETTER, 0.0, LENGTHS_MM[-1]
    for share, long in itertools.product(SHARES, LENGTHS_MM):
        found = _likelihood(known + (share * largest) ** 2 * _alike(s, s, long), d)
        if found > best:
            best, variation, length = found, share * largest, long
    factor = cho_factor(known + variation**2 * _alike(s, s, length))
    shared = largest**2 * constant @ constant_at.T + variation**2 * _alike(s, at, length)
    before = largest**2 * (constant_at**2).sum(axis=1) + variation**2
    left = np.maximum(before - (shared * cho_solve(factor, shared)).sum(axis=0), 0.0)
    measured = np.interp(at, s, u_d)
    return Estimate(shared.T @ cho_solve(factor, d), np.sqrt(left + measured**2), variation, length)


def _constant(s: Float, axes: Float, middle_mm: float, span_mm: float) -> Float:
    """Columns (n, 5): what c, v and w show at s, each of unit size."""
    return np.column_stack([np.ones(s.size), axes, WEAR_SHARE * (s - middle_mm) / span_mm])


def _alike(a: Float, b: Float, length_mm: float) -> Float:
    """Squared exponential correlation (n, m)."""
    return np.asarray(np.exp(-0.5 * ((a[:, None] - b[None, :]) / length_mm) ** 2))


def _rough(s: Float, length_mm: float) -> Float:
    """Exponential correlation (n, n): of g and e, whose short waves must not be taken for f."""
    return np.asarray(np.exp(-np.abs(s[:, None] - s[None, :]) / length_mm))


def _likelihood(covariance: Float, d: Float) -> float:
    """Log-likelihood of d (n,), but for a constant."""
    try:
        lower, side = cho_factor(covariance, lower=True)
    except LinAlgError:
        return -math.inf
    return float(-0.5 * d @ cho_solve((lower, side), d) - np.log(np.diag(lower)).sum())
