"""Robot errors that observations share: all frames of a scan, and near postures.

A robot that stops at a wrong place is as wrong throughout a slow scan; what its recorded poses scatter within the scan
is another matter. So a pose has two errors: one new in every recorded pose, which the many frames tell well, and one of
the whole scan, told only by how the scans contradict each other. Systematic errors are smooth in the posture: near
postures share them, and repeats do not show them. They are a Gaussian process over the flange's poses, a position error
in the base of covariance s^2 exp(-d^2 / 2 l^2), d the distance of two postures.

Few scans or postures tell such sizes badly. So the answer is the mean over a grid of them and its covariance that of
the mixture, each part weighted by its restricted likelihood and by what is believed before: of scans that both errors
a, b together, over the stated repeatability, are right within a factor. A size that is told badly makes the tails of
scans longer than normal: the covariance is widened until its 95 % ellipsoid is that of the mixture,

    p_k ~ L_k exp(-(ln sqrt(a^2 + b^2) / ln 1.5)^2 / 2),    x = sum p_k x_k,
    C = q sum p_k (C_k + (x_k - x)(x_k - x)^T),    q = max(1, Q95[(y - x)^T C(q=1)^-1 (y - x)] / chi2(6; 0.95)).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy

from workbench.api import Bool, Float, Shaped, estimator, inverse, vector_from_rotation
from workbench.plugins.calibration.model import POSE, Estimate, Noise, Sphere, linearise, rows_of
from workbench.plugins.calibration.observations import Observations, Timed

NO_CHANCE = 1e-3  # probability below which a misfit is no chance
MATCHED = 10  # rounds of noise that comes as large as the residuals
RIGHT_WITHIN = 1.5  # factor: one standard deviation of a repeatability as stated
WHOLE = np.concatenate([[0.0], np.geomspace(0.1, 10.0, 24)])  # the grid of a whole scan's error, over the stated one
OWN = (0.01, 10.0)  # between which a pose's own error is sought, likewise
FEWER = 6  # every so many of the grid are enough to find it
NEAR = 0.05  # of its logarithm, that is near enough
AROUND = np.exp(np.linspace(-0.6, 0.6, 5))  # the grid of it, over the likeliest
NO_WEIGHT = 20.0  # of a logarithm below the likeliest: nothing of the mixture
AS_STATED = (0.01, 0.2, 0.5, 0.8, 1.0)  # a pose's own error, the whole scan's making up the stated one
DRAWS = 4000  # of the mixture: its 95 % ellipsoid is told within some 2 % of its size
LEVEL = 0.95
CERTAIN = 5.4  # log-likelihood that a larger error must gain: half of chi-square's 0.001 with one degree of freedom
AMPLITUDES_MM = (0.0, *np.geomspace(0.05, 3.0, 10))
LENGTHS_RAD = (0.05, 0.15, 0.4, 1.0, 2.5)
LENIENT = 4.0  # what a posture may be off over the robot's noise before it is gross: systematic errors are not
ROUNDS = 2  # of linearisation
HIDDEN = 6.0  # how much larger an error may be than its residuals, before it is unlikely: the pose takes up most
RAD_PER_MM = 1e-3  # flange positions a metre apart are as far as orientations a radian apart


@dataclass(frozen=True)
class Settled:
    """An estimate with the errors of its poses as the data tell them."""

    estimate: Estimate
    covariance: Shaped[Float, "P P"]  # of scans the mixture's
    used: Shaped[Bool, " k"]
    noise: Noise  # the most probable
    misfit: bool  # the poses err more than stated, beyond chance


def settled(found: estimator.Fit[Estimate], sphere: Sphere) -> Settled:
    """A fit with the errors of its poses as large as the residuals say; of scans, with those that they share.

    Args:
        found: with the noise as stated, errors new in each recorded pose.
        sphere: what it was fitted to.
    """
    if sphere.seen.place(found.at.offset_s).here.scans:
        return _of_scans(found, sphere)
    beyond = bool(found.freedom > 0 and scipy.special.chdtrc(found.freedom, found.chi2) < NO_CHANCE)
    noise = sphere.noise
    for _ in range(MATCHED if beyond else 0):  # profiles keep their due weight
        noise = noise.times(np.clip(np.sqrt(found.misfit), 0.3, 10.0))
        found = estimator.sound(sphere.noisy(noise), found.at)
        if abs(found.misfit - 1.0) < 0.02:
            break
    return Settled(found.at, found.inverse, found.used, noise, beyond)


def _of_scans(found: estimator.Fit[Estimate], sphere: Sphere) -> Settled:
    """The mixture over errors of a whole scan and of its poses."""
    estimate = found.at
    for _ in range(ROUNDS):  # to where an error of the whole scan as stated leads
        estimate = estimate.moved(_Scans(estimate, sphere, found.used).by(1.0, 0.5).step())
    scans = _Scans(estimate, sphere, found.used)
    owns = scans.owns()
    grid = [(whole, own) for own in owns for whole in WHOLE]
    parts = [scans.by(*one) for one in grid]
    log = np.array([one.restricted for one in parts])
    believed = log + np.array([_prior_of_scans(*one) for one in grid])
    mixture, best = _Mixture(parts, believed), int(believed.argmax())
    less = (one for one in (*AS_STATED, *owns) if one <= 1.0)
    as_stated = max(scans.by(np.sqrt(1.0 - one**2), one).restricted for one in less)
    misfit = bool(np.hypot(*grid[best]) > 1.0 and log[best] > as_stated + CERTAIN)
    covariance, noise = mixture.covariance * max(1.0, mixture.reach()), scans.noise(*grid[best])
    return Settled(estimate.moved(mixture.step), covariance, found.used, noise, misfit)


class _Mixture:
    """Answers of g normal equations, each as likely as its logarithm (g,) says."""

    def __init__(self, parts: Sequence[estimator.Normal], log: Float) -> None:
        self.weights = scipy.special.softmax(log)
        steps = np.array([one.step() for one in parts])
        self.covariances = np.array([estimator.inverse_information(one.information) for one in parts])
        self.step = self.weights @ steps
        self.off = steps - self.step
        self.covariance = np.einsum("g,gpq->pq", self.weights, self.covariances)
        self.covariance += np.einsum("g,gp,gq->pq", self.weights, self.off, self.off)

    def reach(self) -> float:
        """By how much the covariance is too small for its 95 % ellipsoid of the hand-eye pose to be the mixture's."""
        rng = np.random.default_rng(0)
        pick = rng.choice(len(self.weights), DRAWS, p=self.weights)
        factor = np.linalg.cholesky(self.covariances[:, :POSE, :POSE])
        drawn = self.off[pick, :POSE] + np.einsum("kpq,kq->kp", factor[pick], rng.standard_normal((DRAWS, POSE)))
        distance = np.einsum("kp,pk->k", drawn, np.linalg.solve(self.covariance[:POSE, :POSE], drawn.T))
        return float(np.quantile(distance, LEVEL) / scipy.special.chdtri(POSE, 1.0 - LEVEL))


class _Scans:
    """The model about an estimate, by errors of a whole scan and of each of its poses, over those stated."""

    def __init__(self, estimate: Estimate, sphere: Sphere, used: Bool) -> None:
        self.estimate, self.stated = estimate, sphere.noise
        self.here = sphere.seen.place(estimate.offset_s).subset(used)
        self.with_offset = isinstance(sphere.flange, Timed)

    def noise(self, whole: float, own: float) -> Noise:
        total = np.hypot(whole, own)
        return replace(self.stated.times(total), common=(whole / total) ** 2)

    def by(self, whole: float, own: float) -> estimator.Normal:
        noise = self.noise(whole, own)
        linear = linearise(self.estimate, self.here, noise, self.with_offset)
        return rows_of(linear, self.here, noise, self.estimate).normal()

    def log_likelihood(self, own: float) -> float:
        """Logarithm of how likely an error of the poses' own is, whatever the whole scan's."""
        each = [self.by(whole, own).restricted + _prior_of_scans(whole, own) for whole in WHOLE[::FEWER]]
        return float(np.logaddexp.reduce(each))

    def owns(self) -> list[float]:
        """Poses' own errors about the likeliest, those that have a weight."""
        found = scipy.optimize.minimize_scalar(
            lambda log_own: -self.log_likelihood(np.exp(log_own)), bounds=np.log(OWN), options={"xatol": NEAR}
        )
        return [one for one in np.exp(found.x) * AROUND if self.log_likelihood(one) > -found.fun - NO_WEIGHT]


def _prior_of_scans(whole: float, own: float) -> float:
    """Logarithm of what is believed of both errors before: as stated; none in common is as likely as some."""
    total = np.log(np.hypot(whole, own)) / np.log(RIGHT_WITHIN)
    return float(-0.5 * total**2 + (np.log(len(WHOLE) - 1) if whole == 0.0 else 0.0))


def correlated(found: Settled, seen: Observations, noise: Noise) -> tuple[Settled, float]:
    """With systematic robot errors allowed for, and their amplitude in mm (RMS over the grid).

    noise: as stated; what the residuals ask of it is in `found`.
    """
    lenient = estimator.sound(Sphere(seen, noise.times(LENIENT)), found.estimate)
    here, estimate = seen.subset(lenient.used), lenient.at
    seen_mm = HIDDEN * settled(estimator.fit(Sphere(here, noise), estimate), Sphere(here, noise)).noise.pose_mm
    grid = [(a, length) for a in AMPLITUDES_MM for length in (LENGTHS_RAD if a > 0 else LENGTHS_RAD[:1])]
    amplitude, poses = np.array(grid)[:, 0], here.here.base_from_flange
    between = inverse(poses)[:, None] @ poses[None]
    turn, way = vector_from_rotation(between[..., :3, :3]), RAD_PER_MM * between[..., :3, 3]
    apart = np.sqrt(np.sum(turn**2, axis=-1) + np.sum(way**2, axis=-1))  # of postures (k, k), as rotations in rad
    for _ in range(ROUNDS):
        parts = [_over_postures(estimate, here, noise, a**2 * np.exp(-0.5 * (apart / b) ** 2)) for a, b in grid]
        log = np.array([one.restricted for one in parts])
        # half-Cauchy prior (Gelman 2006) on a grid of equal ratios; its scale is what the residuals ask: an error so
        # smooth that the hand-eye pose takes it up leaves the likelihood flat
        size = np.maximum(amplitude, AMPLITUDES_MM[1])
        log += np.log(size) - np.log1p((size / seen_mm) ** 2)
        log[0] += np.log(len(LENGTHS_RAD))  # no amplitude stands for all lengths
        mixture = _Mixture(parts, log)
        estimate = estimate.moved(mixture.step)
    size_mm = np.sqrt(mixture.weights @ amplitude**2)
    return replace(found, estimate=estimate, covariance=mixture.covariance, used=lenient.used), size_mm


def _over_postures(estimate: Estimate, here: Observations, noise: Noise, kernel: Float) -> estimator.Normal:
    """The model about an estimate where position errors of a covariance (k, k), along each axis, are common to all."""
    linear, count = linearise(estimate, here, noise), len(here)
    own = linear.by_pose * noise.spread
    ways, size, _ = np.linalg.svd(kernel, hermitian=True)
    whole = np.einsum("kij,kb->kibj", linear.by_pose[..., :3], ways * np.sqrt(size)).reshape(count, 3, -1)
    alone = linear.covariance - own @ own.mT
    shared = estimator.Shared(np.arange(count), alone, own, np.arange(count), np.zeros(count), count, whole)
    return replace(rows_of(linear, here, noise, estimate), shared=(shared,)).normal()
