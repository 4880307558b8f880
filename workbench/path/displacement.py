"""By how much a cut face lies beside its plan along the edge, told apart from what the robot will not repeat.

The values d at arc lengths s are a sum of Gaussian parts (C. E. Rasmussen, C. K. I. Williams, Gaussian Processes for
Machine Learning, 2006, sections 2.2, 2.7 and 5.4.1):

    d(s) = c + a(s) . v + w s + f(s) + g(s) + e(s)

c is an error constant in the tool's frame, v one constant in the base (a: the direction along which it shows), w grows
along the edge (wear); f repeats whenever the robot goes the same way; g, the robot's repeatability, does not; e is the
measurement's, as far as it differs along the edge: what does not, no averaging reduces, and makes `less_sure`. What the
next pass will show again is c + a . v + w s + f: its expectation given d is the estimate. How large e and f are and how
far each reaches, d itself says, by its likelihood: the estimate is the mean over what that leaves open. Beyond the
values w s is held where they end, since f may have passed for it; what it would come to there counts in u.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, replace

import numpy as np
import scipy

from workbench.units import Float, Shaped

MOST_POINTS = 120  # of the edge that count, evenly spread
WEAR_SHARE = 0.1  # of a constant error, that may grow along the edge
LENGTHS_MM = (25.0, 50.0, 100.0, 200.0)  # of f
SHARES = (0.01, 0.02, 0.04, 0.08, 0.16, 0.32)  # its standard deviation, over `varying`
LOCAL_MM = (2.5, 5.0, 10.0, 20.0)  # of e: from the bins of a profile's courses to the longest waves that they hold back
STATED = (0.25, 0.5, 1.0, 2.0)  # its standard deviation, over the stated one
GRAIN = 1e-3  # white noise, over the constant error's: no value is exact
LEAST_SHARE = 1e-3  # of the posterior, to count
SURE = 0.9545  # of what does not repeat, that stays below what is called significant: 2 u of one constant


@dataclass(frozen=True, slots=True, eq=False)
class Estimate:
    """What the next pass will show again, at m places; units are those of the values."""

    value: Shaped[Float, " m"]
    u: Shaped[Float, " m"]
    variation: float  # root mean square of f
    by_chance: Shaped[Float, "m m"]  # covariance that `value` has where nothing repeats

    @property
    def significant(self) -> bool:
        """Whether the values together are more than chance makes of no displacement at all.

        Of their sum of squares, which is by chance a sum of weighted chi-squares (F. E. Satterthwaite, Biometrics 2,
        1946, 110).
        """
        mean, square = float(np.trace(self.by_chance)), float((self.by_chance**2).sum())
        if mean <= 0.0:
            return bool(self.value.any())
        return bool(
            self.value @ self.value > square / mean * 2.0 * scipy.special.gammaincinv(0.5 * mean**2 / square, SURE)
        )

    def less_sure(self, u: Float | float) -> Estimate:
        """The same with one more error of the whole edge, u (m,) or the same everywhere."""
        u = u + np.zeros_like(self.value)
        return replace(self, u=np.hypot(self.u, u), by_chance=self.by_chance + np.outer(u, u))


@dataclass(frozen=True, slots=True)
class Prior:
    """How large errors may be, before any value is seen."""

    largest: float  # standard deviation that a constant error may have
    varying: float  # three times the standard deviation that f may have
    unrepeated: float  # standard deviation of g
    unrepeated_length_mm: float  # its correlation length


def estimate(
    s: Shaped[Float, " n"],
    values: Shaped[Float, " n"],
    u: Shaped[Float, " n"],
    axes: Shaped[Float, "n 3"],
    at: Shaped[Float, " m"],
    axes_at: Shaped[Float, "m 3"],
    prior: Prior,
) -> Estimate:
    """Estimate what repeats from values at arc lengths `s` (n,), finite and in any order, for arc lengths `at` (m,).

    Args:
        s: (n,) mm.
        values: (n,) d.
        u: (n,) their standard uncertainties as far as they differ along the edge: of e.
        axes: (n, 3) the direction a in the base.
        at: (m,) mm.
        axes_at: (m, 3) a there.
        prior: how large they may be.
    """
    largest = prior.largest
    few = np.unique(np.linspace(0, len(s) - 1, min(MOST_POINTS, len(s))).astype(np.int64))
    order = np.argsort(s)[few]
    s, d, u_d, axes = s[order], values[order], u[order], axes[order]
    middle, span = 0.5 * (s[0] + s[-1]), max(float(s[-1] - s[0]), 1.0)
    held = np.clip(at, s[0], s[-1])
    constant, constant_at = _constant(s, axes, middle, span), _constant(held, axes_at, middle, span)
    known = largest**2 * constant @ constant.T
    by_run = (GRAIN * largest) ** 2 * np.eye(len(s)) + prior.unrepeated**2 * _rough(s, prior.unrepeated_length_mm)
    usual = np.minimum(u_d, np.median(u_d))
    spread = np.outer(usual, usual) + np.outer(*2 * [np.sqrt(u_d**2 - usual**2)])  # where u is large, by other causes
    local = {length: spread * _rough(s, length) for length in LOCAL_MM}
    smooth = {length: _alike(s, s, length) for length in LENGTHS_MM}
    chances = [by_run + share**2 * local[length] for share, length in itertools.product(STATED, LOCAL_MM)]
    repeats = [(0.0, LENGTHS_MM[-1]), *itertools.product([share * prior.varying for share in SHARES], LENGTHS_MM)]
    trials = list(itertools.product(range(len(chances)), repeats))
    log = np.array([_likelihood(known + chances[k] + sd**2 * smooth[long], d) for k, (sd, long) in trials])
    log -= np.where([sd > 0.0 for _, (sd, _) in trials], math.log(len(repeats) - 1), 0.0)  # f is as likely as none
    share = np.exp(log - log.max())
    share = np.where(share > LEAST_SHARE * share.sum(), share, 0.0)
    share /= share.sum()
    means, gains, variances, chance, f = [], [], [], np.zeros((len(s), len(s))), np.zeros(len(at))
    growing = 0.0  # expected square of w, over its prior standard deviation
    weights = share[share > 0.0]
    for weight, row in zip(weights, np.flatnonzero(share), strict=True):
        k, (sd, long) = trials[row]
        varied = sd**2 * _alike(s, at, long)
        repeated = largest**2 * constant @ constant_at.T + varied
        factor = scipy.linalg.cho_factor(known + chances[k] + sd**2 * smooth[long])
        gain = scipy.linalg.cho_solve(factor, repeated)
        before = largest**2 * (constant_at**2).sum(axis=1) + sd**2
        means.append(d @ gain)
        gains.append(gain)
        variances.append(np.maximum(before - (repeated * gain).sum(axis=0), 0.0))
        along = largest**2 * constant[:, -1]
        by_w = scipy.linalg.cho_solve(factor, along)
        growing += weight * float((d @ by_w) ** 2 + largest**2 - along @ by_w)
        chance += weight * chances[k]
        f += weight * (scipy.linalg.cho_solve(factor, d) @ varied)
    value, gain = weights @ np.array(means), np.tensordot(weights, np.array(gains), axes=1)
    variance = weights @ (np.array(variances) + (np.array(means) - value) ** 2)
    variance += growing * (WEAR_SHARE * (at - held) / span) ** 2
    return Estimate(value, np.sqrt(variance), float(np.sqrt(np.mean(f**2))), gain.T @ chance @ gain)


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
        lower, side = scipy.linalg.cho_factor(covariance, lower=True)
    except scipy.linalg.LinAlgError:
        return -math.inf
    return float(-0.5 * d @ scipy.linalg.cho_solve((lower, side), d) - np.log(np.diag(lower)).sum())
