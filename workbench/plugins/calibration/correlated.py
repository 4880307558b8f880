"""Systematic robot errors: smooth in the posture, so that near postures share them and repeats do not show them.

A further position error of each posture, in the base, is a Gaussian process over the flange's poses: covariance
s^2 exp(-d^2 / 2 l^2), d the distance of two postures. Amplitude s and length l come from the residuals by restricted
likelihood (Patterson and Thompson 1971); since few postures tell them badly, the answer is the mean over a grid of both
and its covariance that of the mixture.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from workbench.api import Float, inverse, vector_from_rotation
from workbench.plugins.calibration.bundle import Fit, matched, without_gross
from workbench.plugins.calibration.model import SIZE, Estimate, Linear, Noise, linearise
from workbench.plugins.calibration.observations import Observations

AMPLITUDES_MM = (0.0, *np.geomspace(0.05, 3.0, 10))
LENGTHS_RAD = (0.05, 0.15, 0.4, 1.0, 2.5)
LENIENT = 4.0  # what a posture may be off over the robot's noise before it is gross: systematic errors are not
ROUNDS = 2  # of linearisation
HIDDEN = 6.0  # how much larger an error may be than its residuals, before it is unlikely: the pose takes up most
RAD_PER_MM = 1e-3  # flange positions a metre apart are as far as orientations a radian apart


def correlated(result: Fit, seen: Observations, noise: Noise) -> tuple[Fit, float]:
    """The fit with systematic robot errors allowed for, and their amplitude in mm (RMS over the grid)."""
    lenient = replace(noise, pose_mm=LENIENT * noise.pose_mm, pose_deg=LENIENT * noise.pose_deg)
    result = without_gross(result.estimate, seen, lenient)
    here = seen.subset(result.used)
    estimate = result.estimate
    seen_mm = HIDDEN * matched(result, seen, noise)[1].pose_mm
    for _ in range(ROUNDS):
        weights, steps, covariances, amplitudes = _over_grid(estimate, here, noise, seen_mm)
        mean = weights @ steps
        estimate = estimate.moved(mean)
    spread = np.einsum("g,gp,gq->pq", weights, steps - mean, steps - mean)
    covariance = np.einsum("g,gpq->pq", weights, covariances) + spread
    return replace(result, estimate=estimate, covariance=covariance), float(np.sqrt(weights @ amplitudes**2))


def _over_grid(
    estimate: Estimate, here: Observations, noise: Noise, seen_mm: float
) -> tuple[Float, Float, Float, Float]:
    """Weights (g,) of the grid's points, Gauss-Newton steps (g, P), their covariances (g, P, P), amplitudes (g,)."""
    linear = linearise(estimate, here, noise)
    apart = _distances(here)
    grid = [(a, length) for a in AMPLITUDES_MM for length in (LENGTHS_RAD if a > 0 else LENGTHS_RAD[:1])]
    found = [
        _restricted(linear, here, noise, a**2 * np.exp(-0.5 * (apart / length) ** 2), estimate) for a, length in grid
    ]
    log = np.array([one[0] for one in found])
    log += _prior(np.array([max(a, AMPLITUDES_MM[1]) for a, _ in grid]), seen_mm)
    log[0] += np.log(len(LENGTHS_RAD))  # no amplitude stands for all lengths
    weights = np.exp(log - log.max())
    return (
        weights / weights.sum(),
        np.array([one[1] for one in found]),
        np.array([one[2] for one in found]),
        np.array([a for a, _ in grid]),
    )


def _prior(amplitude: Float, seen_mm: float) -> Float:
    """Logarithm of a half-Cauchy prior (Gelman 2006) on a grid of equal ratios; its scale is what the residuals ask.

    An error so smooth that the hand-eye pose takes it up leaves the likelihood flat: without a scale, the largest
    amplitude of the grid would be as likely as that which the residuals show.
    """
    return np.asarray(np.log(amplitude) - np.log1p((amplitude / seen_mm) ** 2))


def _restricted(
    linear: Linear, here: Observations, noise: Noise, kernel: Float, estimate: Estimate
) -> tuple[float, Float, Float]:
    """Restricted log-likelihood of one kernel (k, k), the step to its answer (P,) and the covariance (P, P)."""
    L = np.linalg.cholesky(_covariance(linear, kernel))
    white = np.linalg.solve(L, np.column_stack([linear.jacobian.reshape(-1, SIZE), linear.residual.reshape(-1)]))
    J, r = white[:, :-1], white[:, -1]
    pull = np.zeros(SIZE)
    pull[SIZE - 1] = noise.radius_u_mm**-2
    off = noise.radius_mm - estimate.radius_mm
    information = J.T @ J + np.diag(pull)
    side = J.T @ r + pull * off
    covariance = np.linalg.inv(information)
    step = covariance @ side
    cost = r @ r + off**2 * pull[-1] - side @ step
    log = -0.5 * (cost + np.linalg.slogdet(information)[1]) - np.log(np.diagonal(L)).sum()
    return float(log), step, covariance


def _covariance(linear: Linear, kernel: Float) -> Float:
    """Covariance (3k, 3k) of all observations: their own, and the shared position errors brought to the profiles."""
    by_position = linear.by_pose[..., :3]
    out = np.einsum("ab,aip,bjp->aibj", kernel, by_position, by_position)
    index = np.arange(len(kernel))
    out[index, :, index, :] += linear.covariance
    return np.asarray(out.reshape(3 * len(kernel), -1))


def _distances(here: Observations) -> Float:
    """How far apart the postures are (k, k), as rotations in rad."""
    poses = here.base_from_flange
    between = inverse(poses)[:, None] @ poses[None]
    turn = vector_from_rotation(between[..., :3, :3])
    return np.asarray(np.sqrt(np.sum(turn**2, axis=-1) + np.sum((RAD_PER_MM * between[..., :3, 3]) ** 2, axis=-1)))
