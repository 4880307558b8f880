"""Scans over the sphere: how much of the robot's pose error do all frames of a scan have in common?

A robot that stops at a wrong place is as wrong throughout a slow scan; what its recorded poses scatter within the scan
is another matter. So a pose has two errors: one new in every recorded pose, told well by the many frames, and one of
the whole scan, told only by how the scans contradict each other. Both come from the residuals by restricted likelihood
(Patterson and Thompson 1971). Few scans tell the second badly, so the stated repeatability, which is both together, is
taken for right within a factor, and the answer is the mean over a grid of the second and its covariance the mixture's,
widened until its 95 % ellipsoid is that of the mixture too.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy

from workbench.api import Float
from workbench.plugins.calibration.bundle import Fit
from workbench.plugins.calibration.model import Estimate, Noise, linearise, normal_equations
from workbench.plugins.calibration.observations import Observations, Passes

RIGHT_WITHIN = 1.5  # factor: one standard deviation of a repeatability as stated
POSE = 6  # unknowns of the hand-eye pose, the first
OWN = (0.01, 10.0)  # bounds of a pose's own error, over the stated one
COARSE = np.array([0.0, 0.1, 0.3, 1.0, 3.0, 10.0])  # errors of a whole scan, over the stated one, with their own search
FINE = np.concatenate([[0.0], np.geomspace(0.1, 10.0, 36)])  # the grid of the mixture
DRAWS = 4000  # of the mixture: its 95 % ellipsoid is told within some 2 % of its size
LEVEL = 0.95
CERTAIN = 5.4  # log-likelihood that a larger error must gain: half of chi-square's 0.001 with one degree of freedom


@dataclass(frozen=True)
class Settled:
    """A fit with both errors as the data tell them."""

    fit: Fit  # the mixture's mean and covariance
    noise: Noise  # the most probable
    misfit: bool  # the poses err more than stated, beyond chance


def settled(result: Fit, seen: Observations | Passes, noise: Noise, with_offset: bool = False) -> Settled:
    """The fit of scans with the errors of their poses estimated.

    Args:
        result: a fit with errors that are new in each recorded pose.
        seen: what it was fitted to.
        noise: as stated.
        with_offset: whether the clock's offset is among the unknowns.
    """
    estimate = _moved(result, seen, noise, with_offset)
    likely = _Likelihood(estimate, seen, result, noise, with_offset)
    own = np.exp(np.interp(np.arcsinh(FINE / 0.1), np.arcsinh(COARSE / 0.1), [likely.own(one) for one in COARSE]))
    found = [likely.at(a, b) for a, b in zip(FINE, own, strict=True)]
    total = np.log(np.hypot(FINE, own))
    log = np.array([one[0] for one in found])
    prior = -0.5 * (total / np.log(RIGHT_WITHIN)) ** 2
    prior[0] += np.log(len(FINE) - 1)  # none in common is as likely as some
    weights = np.exp(log + prior - (log + prior).max())
    weights /= weights.sum()
    steps, covariances = np.array([one[1] for one in found]), np.array([one[2] for one in found])
    mean = weights @ steps
    spread = np.einsum("g,gp,gq->pq", weights, steps - mean, steps - mean)
    covariance = np.einsum("g,gpq->pq", weights, covariances) + spread
    covariance *= max(1.0, _reach(weights, steps - mean, covariances, covariance))
    best = int(np.argmax(log + prior))
    as_stated = max(likely.at(a, np.sqrt(1.0 - a**2))[0] for a in FINE[FINE < 1.0])
    fit = replace(result, estimate=estimate.moved(mean), covariance=covariance)
    return Settled(fit, likely.noise(FINE[best], own[best]), bool(total[best] > 0 and log[best] > as_stated + CERTAIN))


def _reach(weights: Float, off: Float, covariances: Float, together: Float) -> float:
    """By how much `together` (P, P) is too small for its 95 % ellipsoid of the hand-eye pose to be the mixture's.

    A size that few scans tell makes the errors' tails longer than normal (Student's): a covariance says nothing of it.
    weights (g,), off (g, P) means and covariances (g, P, P) of the parts.
    """
    rng = np.random.default_rng(0)
    pick = rng.choice(len(weights), DRAWS, p=weights)
    normal = rng.standard_normal((DRAWS, POSE))
    factor = np.linalg.cholesky(covariances[:, :POSE, :POSE])
    drawn = off[pick, :POSE] + np.einsum("kpq,kq->kp", factor[pick], normal)
    distance = np.einsum("kp,pk->k", drawn, np.linalg.solve(together[:POSE, :POSE], drawn.T))
    return float(np.quantile(distance, LEVEL) / (2.0 * scipy.special.gammaincinv(0.5 * POSE, LEVEL)))


def _moved(result: Fit, seen: Observations | Passes, noise: Noise, with_offset: bool) -> Estimate:
    """The estimate with an error of the whole scan as stated: where to linearise."""
    estimate = result.estimate
    for _ in range(2):
        likely = _Likelihood(estimate, seen, result, noise, with_offset)
        estimate = estimate.moved(likely.at(1.0, 0.5)[1])
    return estimate


class _Likelihood:
    """Restricted likelihood of the two errors, both over the stated repeatability, about an estimate."""

    def __init__(
        self, estimate: Estimate, seen: Observations | Passes, result: Fit, stated: Noise, with_offset: bool
    ) -> None:
        here = seen.place(estimate.offset_s) if isinstance(seen, Passes) else seen
        self._here = here.subset(result.used)
        self._estimate, self._stated, self._with_offset = estimate, stated, with_offset

    def noise(self, whole: float, own: float) -> Noise:
        total = float(np.hypot(whole, own))
        return replace(
            self._stated,
            pose_mm=total * self._stated.pose_mm,
            pose_deg=total * self._stated.pose_deg,
            common=float(whole / total) ** 2,
        )

    def at(self, whole: float, own: float) -> tuple[float, Float, Float]:
        """Log-likelihood, the step to its answer (P,) and the covariance (P, P)."""
        noise = self.noise(whole, own)
        linear = linearise(self._estimate, self._here, noise, self._with_offset)
        now = normal_equations(linear, self._here, noise, self._estimate.radius_mm)
        covariance = np.linalg.inv(now.matrix)
        step = covariance @ now.side
        log = -0.5 * (now.chi2 - now.side @ step + np.linalg.slogdet(now.matrix)[1] + now.log_size)
        return float(log), step, np.asarray(covariance, float)

    def own(self, whole: float) -> float:
        """Logarithm of the likeliest error of a pose's own beside that of the whole scan."""
        prior = 0.5 / np.log(RIGHT_WITHIN) ** 2

        def cost(log_own: float) -> float:
            own = float(np.exp(log_own))
            return float(prior * np.log(np.hypot(whole, own)) ** 2) - self.at(whole, own)[0]

        return float(
            scipy.optimize.minimize_scalar(cost, bounds=np.log(OWN), method="bounded", options={"xatol": 0.02}).x
        )
