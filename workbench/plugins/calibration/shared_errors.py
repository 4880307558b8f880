"""Robot errors that observations share: all frames of a scan, and near postures.

A robot that stops at a wrong place is as wrong throughout a slow scan; what its recorded poses scatter within the scan
is another matter. So a pose has two errors: one new in every recorded pose, told well by the many frames, and one of
the whole scan, told only by how the scans contradict each other. Both come from the residuals by restricted likelihood
(Patterson and Thompson 1971). Few scans tell the second badly, so the stated repeatability, which is both together, is
taken for right within a factor, and the answer is the mean over a grid of the second and its covariance the mixture's,
widened until its 95 % ellipsoid is that of the mixture too. With errors a (a scan's) and b (a pose's), both over the
stated repeatability, each pair k of a grid has an answer x_k, covariance C_k and restricted likelihood L_k:

    p_k ~ L_k exp(-(ln sqrt(a^2 + b^2) / ln 1.5)^2 / 2),    x = sum p_k x_k,
    C = q sum p_k (C_k + (x_k - x)(x_k - x)^T),    q = max(1, Q95[(y - x)^T C(q=1)^-1 (y - x)] / chi2(6; 0.95)),

the percentile Q95 over y from the mixture of the normal distributions (x_k, C_k) of the hand-eye pose.

Systematic errors are smooth in the posture, so that near postures share them and repeats do not show them. A further
position error of each posture, in the base, is a Gaussian process over the flange's poses: covariance s^2 exp(-d^2 / 2
l^2), d the distance of two postures. Amplitude s and length l come from the residuals by restricted likelihood
(Patterson and Thompson 1971); since few postures tell them badly, the answer is the mean over a grid of both and its
covariance that of the mixture.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy

from workbench.api import Bool, Float, Shaped, estimator, inverse, vector_from_rotation
from workbench.plugins.calibration.model import POSE, SIZE, Estimate, Linear, Noise, Sphere, linearise
from workbench.plugins.calibration.observations import Observations, Timed, sharing

NO_CHANCE = 1e-3  # probability below which a misfit is no chance
MATCHED = 10  # rounds of noise that comes as large as the residuals
RIGHT_WITHIN = 1.5  # factor: one standard deviation of a repeatability as stated
WHOLE = np.concatenate([[0.0], np.geomspace(0.1, 10.0, 36)])  # the grid of a whole scan's error, over the stated one
OWN = np.geomspace(0.01, 10.0, 7)  # of a pose's own error, the coarsest
FINER = (0.4, 0.14, 0.05)  # distances of its logarithms about the likeliest
AROUND = np.linspace(-2.0, 2.0, 5)  # standard deviations about the likeliest, in the grid
WIDEST = 0.5  # such a standard deviation, where the frames hardly tell it
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
    if not sphere.seen.place(found.at.offset_s).here.scans:
        beyond = bool(found.freedom > 0 and scipy.special.chdtrc(found.freedom, found.chi2) < NO_CHANCE)
        noise = sphere.noise
        for _ in range(MATCHED if beyond else 0):  # profiles keep their due weight
            noise = noise.times(float(np.clip(np.sqrt(found.misfit), 0.3, 10.0)))
            found = estimator.sound(sphere.noisy(noise), found.at)
            if abs(found.misfit - 1.0) < 0.02:
                break
        return Settled(found.at, found.inverse, found.used, noise, beyond)
    estimate = _moved(found, sphere)
    likely = _Likelihood(estimate, sphere, found.used)
    owns = likely.owns()
    each = [likely.along(WHOLE, own) for own in owns]
    log = np.concatenate([one.log for one in each])
    believed = log + np.concatenate([_prior_of_scans(WHOLE, one.own) for one in each])
    steps, covariances = (np.concatenate([getattr(one, name) for one in each]) for name in ("step", "covariance"))
    weights, mean, covariance = _mixture(believed, steps, covariances)
    covariance *= max(1.0, _reach(weights, steps - mean, covariances, covariance))
    best = int(np.argmax(believed))
    whole, own = WHOLE[best % len(WHOLE)], each[best // len(WHOLE)].own
    misfit = bool(np.hypot(whole, own) > 1.0 and log[best] > likely.as_stated(owns) + CERTAIN)
    return Settled(estimate.moved(mean), covariance, found.used, likely.noise(whole, own), misfit)


def _mixture(log: Float, steps: Float, covariances: Float) -> tuple[Float, Float, Float]:
    """Weights (g,), mean (P,) and covariance (P, P) of answers (g, P) with logarithms of their likelihood (g,)."""
    weights = np.exp(log - log.max())
    weights /= weights.sum()
    mean = weights @ steps
    spread = np.einsum("g,gp,gq->pq", weights, steps - mean, steps - mean)
    return weights, mean, np.einsum("g,gpq->pq", weights, covariances) + spread


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


def _moved(found: estimator.Fit[Estimate], sphere: Sphere) -> Estimate:
    """The estimate with an error of the whole scan as stated: where to linearise."""
    estimate = found.at
    for _ in range(ROUNDS):
        likely = _Likelihood(estimate, sphere, found.used)
        estimate = estimate.moved(likely.along(np.array([1.0]), 0.5).step[0])
    return estimate


@dataclass(frozen=True)
class _Along:
    """Answers with g errors of a whole scan beside one of the poses' own, P unknowns."""

    own: float
    log: Shaped[Float, " g"]  # likelihood, up to a constant
    step: Shaped[Float, "g P"]
    covariance: Shaped[Float, "g P P"]


class _Likelihood:
    """Restricted likelihood of the two errors, both over the stated repeatability, about an estimate.

    An error of a whole scan adds few columns to what the frames' own errors weight: once these are weighted, it costs
    hardly anything to ask for many. The product of both errors in the square of c_y is left out.
    """

    def __init__(self, estimate: Estimate, sphere: Sphere, used: Bool) -> None:
        stated = sphere.noise
        self._here, self._stated = sphere.seen.place(estimate.offset_s).subset(used), stated
        self._linear = linearise(estimate, self._here, replace(stated, common=1.0), isinstance(sphere.flange, Timed))
        self._off_mm = stated.radius_mm - estimate.radius_mm
        self._spread = self._linear.by_pose * stated.spread
        self._square = np.zeros((len(self._here), 3, 1))  # of a stated error of c_y, in w
        self._square[:, 2, 0] = self._linear.bent / np.sqrt(2.0)
        self._alone = self._linear.covariance - self._spread @ np.swapaxes(self._spread, 1, 2)
        self._alone[:, 2, 2] -= self._linear.bent**2

    def noise(self, whole: float, own: float) -> Noise:
        total = float(np.hypot(whole, own))
        return replace(self._stated.times(total), common=float(whole / total) ** 2)

    def owns(self) -> Float:
        """Poses' own errors (o,) about the likeliest, evenly in standard deviations of their logarithm."""
        at = np.log(OWN)
        middle = float(at[np.argmax([self._all(one) for one in at])])
        width = WIDEST
        for apart in FINER:
            low, here, high = (self._all(middle + k * apart) for k in (-1, 0, 1))
            bend = (2.0 * here - low - high) / apart**2
            width = min(WIDEST, 1.0 / np.sqrt(max(bend, 1e-6)))
            middle += float(np.clip(0.5 * (high - low) / apart * width**2, -2.0 * apart, 2.0 * apart))
            middle = float(np.clip(middle, at[0], at[-1]))
        return np.exp(middle + width * AROUND)

    def as_stated(self, owns: Float) -> float:
        """The greatest log-likelihood of errors that together are as stated."""
        less = (one for one in (*AS_STATED, *owns) if one <= 1.0)
        return float(max(self.along(np.sqrt([1.0 - one**2]), one).log[0] for one in less))

    def _all(self, log_own: float) -> float:
        own = float(np.exp(log_own))
        log = self.along(WHOLE, own).log + _prior_of_scans(WHOLE, own)
        return float(log.max() + np.log(np.exp(log - log.max()).sum()))

    def along(self, whole: Float, own: float) -> _Along:
        """Answers with errors of a whole scan `whole` (g,) beside poses' own errors `own`."""
        joined, log_size = self._weighted(own)
        size = self._linear.jacobian.shape[2] + 1
        into = np.zeros((len(whole), joined.shape[1], size + 7))  # columns: J r, and those that the scan shares
        into[:, np.arange(size), np.arange(size)] = 1.0
        into[:, size, size - 1], into[:, size, size] = whole**2, np.sqrt(2.0) * whole**2
        into[:, size + 1 :, size + 1 :] = whole[:, None, None] * np.eye(6)
        by_scan, log_more = estimator.with_common(np.swapaxes(into, 1, 2)[:, None] @ joined @ into[:, None], 7)
        log_size = log_size + log_more.sum(axis=1)
        return _Along(own, *_answers(by_scan.sum(axis=1), log_size, self._stated, self._off_mm))

    def _weighted(self, own: float) -> tuple[Float, float]:
        """Products (s, c, c) of the columns J, r, square of c_y, errors of a pose, weighted by what frames have alone.

        A posture held still is a scan of one frame. With them the logarithm of the size of what the frames have alone.
        """
        seen, linear = self._here.here, self._linear
        square = own**2 * seen.evened[:, None, None] * self._square
        residual = linear.residual[..., None] - self._square + square
        columns = np.concatenate([linear.jacobian, residual, self._square, self._spread], axis=-1)
        alone = self._alone + 2.0 * square @ np.swapaxes(square, 1, 2)
        still, spread = columns[seen.still], self._spread[seen.still]
        at_rest = alone[seen.still] + own**2 * spread @ np.swapaxes(spread, 1, 2)
        joined = [np.swapaxes(still, 1, 2) @ np.linalg.solve(at_rest, still)]
        log_size = float(np.linalg.slogdet(at_rest)[1].sum())
        for scan in seen.scans:
            more, log = estimator.within_poses(
                columns[scan.rows], sharing(scan, alone, own * self._spread, self._spread[..., :0])
            )
            joined.append(more[None])
            log_size += log
        return np.concatenate(joined), log_size


def _prior_of_scans(whole: Float, own: float) -> Float:
    """Logarithm of what is believed of both errors before: as stated; none in common is as likely as some."""
    total = np.log(np.hypot(whole, own)) / np.log(RIGHT_WITHIN)
    return np.asarray(-0.5 * total**2 + np.where(whole == 0.0, np.log(len(WHOLE) - 1), 0.0))


def correlated(found: Settled, seen: Observations, noise: Noise) -> tuple[Settled, float]:
    """With systematic robot errors allowed for, and their amplitude in mm (RMS over the grid).

    noise: as stated; what the residuals ask of it is in `found`.
    """
    lenient = estimator.sound(Sphere(seen, noise.times(LENIENT)), found.estimate)
    here, estimate = seen.subset(lenient.used), lenient.at
    seen_mm = HIDDEN * settled(estimator.fit(Sphere(here, noise), estimate), Sphere(here, noise)).noise.pose_mm
    for _ in range(ROUNDS):
        step, covariance, amplitude_mm = _over_grid(estimate, here, noise, seen_mm)
        estimate = estimate.moved(step)
    return replace(found, estimate=estimate, covariance=covariance, used=lenient.used), amplitude_mm


def _over_grid(estimate: Estimate, here: Observations, noise: Noise, seen_mm: float) -> tuple[Float, Float, float]:
    """Gauss-Newton step (P,), its covariance (P, P) and the RMS amplitude, mm, of the mixture over the grid."""
    linear, apart = linearise(estimate, here, noise), _distances(here)
    columns = np.concatenate([linear.jacobian, linear.residual[..., None]], axis=2).reshape(-1, SIZE + 1)
    grid = [(a, length) for a in AMPLITUDES_MM for length in (LENGTHS_RAD if a > 0 else LENGTHS_RAD[:1])]
    amplitude, products, sizes = np.array(grid)[:, 0], [], []
    for a, length in grid:
        factor = np.linalg.cholesky(_covariance(linear, a**2 * np.exp(-0.5 * (apart / length) ** 2)))
        white = np.linalg.solve(factor, columns)
        products.append(white.T @ white)
        sizes.append(2.0 * np.log(np.diagonal(factor)).sum())
    log, steps, covariances = _answers(np.array(products), np.array(sizes), noise, noise.radius_mm - estimate.radius_mm)
    log += _prior_of_amplitude(np.maximum(amplitude, AMPLITUDES_MM[1]), seen_mm)
    log[0] += np.log(len(LENGTHS_RAD))  # no amplitude stands for all lengths
    weights, mean, covariance = _mixture(log, steps, covariances)
    return mean, covariance, float(np.sqrt(weights @ amplitude**2))


def _prior_of_amplitude(amplitude: Float, seen_mm: float) -> Float:
    """Logarithm of a half-Cauchy prior (Gelman 2006) on a grid of equal ratios; its scale is what the residuals ask.

    An error so smooth that the hand-eye pose takes it up leaves the likelihood flat: without a scale, the largest
    amplitude of the grid would be as likely as that which the residuals show.
    """
    return np.asarray(np.log(amplitude) - np.log1p((amplitude / seen_mm) ** 2))


def _answers(products: Float, log_size: Float, noise: Noise, off_mm: float) -> tuple[Float, Float, Float]:
    """Restricted log-likelihood (g,), step (g, P) and covariance (g, P, P) of answers, the radius' prior included.

    products (g, P + 1, P + 1): of the weighted columns J, r; log_size (g,): logarithm of their weights' determinant;
    off_mm: from the estimate's radius to the stated one.
    """
    normal, pull = products.copy(), noise.radius_u_mm**-2
    normal[:, SIZE - 1, SIZE - 1] += pull
    normal[:, [SIZE - 1, -1], [-1, SIZE - 1]] += pull * off_mm
    normal[:, -1, -1] += pull * off_mm**2
    matrix, side = normal[:, :-1, :-1], normal[:, :-1, -1]
    covariance = np.asarray(np.linalg.inv(matrix), float)
    step: Float = np.einsum("gpq,gq->gp", covariance, side)
    left = normal[:, -1, -1] - np.sum(side * step, axis=1)
    return np.asarray(-0.5 * (left + np.linalg.slogdet(matrix)[1] + log_size)), step, covariance


def _covariance(linear: Linear, kernel: Float) -> Float:
    """Covariance (3k, 3k) of all observations: their own, and the shared position errors brought to the profiles."""
    by_position = linear.by_pose[..., :3]
    out = np.einsum("ab,aip,bjp->aibj", kernel, by_position, by_position)
    index = np.arange(len(kernel))
    out[index, :, index, :] += linear.covariance
    return np.asarray(out.reshape(3 * len(kernel), -1))


def _distances(here: Observations) -> Float:
    """How far apart the postures are (k, k), as rotations in rad."""
    poses = here.here.base_from_flange
    between = inverse(poses)[:, None] @ poses[None]
    turn = vector_from_rotation(between[..., :3, :3])
    return np.asarray(np.sqrt(np.sum(turn**2, axis=-1) + np.sum((RAD_PER_MM * between[..., :3, 3]) ** 2, axis=-1)))
