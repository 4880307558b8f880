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
from workbench.plugins.calibration.bundle import Fit, fit
from workbench.plugins.calibration.model import SIZE, Noise, dense_covariance, linearise
from workbench.plugins.calibration.observations import Observations

AMPLITUDES_MM = (0.0, *np.geomspace(0.05, 3.0, 10))
LENGTHS_RAD = (0.05, 0.15, 0.4, 1.0)
RAD_PER_MM = 1e-3  # flange positions a metre apart are as far as orientations a radian apart


def correlated(result: Fit, seen: Observations, noise: Noise) -> tuple[Fit, float]:
    """The fit with systematic robot errors allowed for, and their amplitude in mm (RMS over the grid)."""
    here = seen.subset(result.used)
    best_kernel = _likely(result, here, noise)[3]
    start = fit(result.estimate, seen, noise, used=result.used, shared=best_kernel)
    weights, steps, covariances, _, amplitudes = _likely(start, here, noise)
    mean = weights @ steps
    spread = np.einsum("g,gp,gq->pq", weights, steps - mean, steps - mean)
    covariance = np.einsum("g,gpq->pq", weights, covariances) + spread
    answer = replace(start, estimate=start.estimate.moved(mean), covariance=covariance)
    return answer, float(np.sqrt(weights @ amplitudes**2))


def _likely(result: Fit, here: Observations, noise: Noise) -> tuple[Float, Float, Float, Float, Float]:
    """Over the grid: weights (g,), Gauss-Newton steps (g, P), covariances (g, P, P); likeliest kernel; amplitudes."""
    linear = linearise(result.estimate, here, noise)
    pull = np.zeros(SIZE)
    pull[SIZE - 1] = noise.radius_u_mm**-2
    apart = _distances(here)
    logs, steps, covariances, kernels, amplitudes = [], [], [], [], []
    J, r = linear.jacobian.reshape(-1, SIZE), linear.residual.reshape(-1)
    for amplitude in AMPLITUDES_MM:
        for length in LENGTHS_RAD if amplitude > 0 else LENGTHS_RAD[:1]:
            kernel = amplitude**2 * np.exp(-0.5 * (apart / length) ** 2)
            L = np.linalg.cholesky(dense_covariance(linear, here, noise, kernel))
            white = np.linalg.solve(L, np.column_stack([J, r]))
            information = white[:, :-1].T @ white[:, :-1] + np.diag(pull)
            side = white[:, :-1].T @ white[:, -1] + pull * (noise.radius_mm - result.estimate.radius_mm)
            step = np.linalg.solve(information, side)
            cost = white[:, -1] @ white[:, -1] - side @ step
            logs.append(-0.5 * (cost + np.linalg.slogdet(information)[1]) - np.log(np.diagonal(L)).sum())
            steps.append(step)
            covariances.append(np.linalg.inv(information))
            kernels.append(kernel)
            amplitudes.append(amplitude)
    log = np.array(logs)
    log[0] += np.log(len(LENGTHS_RAD))  # no amplitude stands for all lengths
    weights = np.exp(log - log.max())
    return (
        weights / weights.sum(),
        np.array(steps),
        np.array(covariances),
        kernels[int(np.argmax(log))],
        np.array(amplitudes),
    )


def _distances(here: Observations) -> Float:
    """How far apart the postures are (k, k), as rotations in rad."""
    poses = here.base_from_flange
    between = inverse(poses)[:, None] @ poses[None]
    turn = vector_from_rotation(between[..., :3, :3])
    return np.asarray(np.sqrt(np.sum(turn**2, axis=-1) + np.sum((RAD_PER_MM * between[..., :3, 3]) ** 2, axis=-1)))
