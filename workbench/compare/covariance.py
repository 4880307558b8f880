"""Covariance of a registration: its normal equations, and residuals that hang together."""

from __future__ import annotations

import numpy as np

from workbench.compare.icp import OPEN, Equations
from workbench.units import Float, Int

LEAST_STRETCHES, STRETCH_MM = 12, 4.0  # residuals of one stretch hang together


def covariance_of(equations: Equations, held_u_mm: float) -> Float:
    """(6, 6) of the shift (mm) and the turn (rad) about the pivot.

    H^-1 V H^-1 with V the variance of the sum of weighted rows times residuals (Huber, Robust Statistics, 1981). A
    residual has an error of its own, and shares with its stretch of the part a displacement in space: robot errors of
    frames, and neighbourhoods that overlap. Open directions get the initial pose's uncertainty instead.
    """
    size, vectors = equations.directions()
    stretch = stretches(equations)
    own, shared = components(equations, stretch)
    rows = (equations.rows * equations.weight[:, None]) @ vectors
    together = np.zeros((int(stretch.max()) + 1, 3, 6))
    for axis in range(3):
        np.add.at(together[:, axis], stretch, rows * equations.rows[:, axis : axis + 1])
    sums = together.reshape(-1, 6)
    variance = own * rows.T @ rows + shared * sums.T @ sums
    known = size > OPEN
    scale = 1.0 / np.maximum(size * equations.weight.sum() * _efficiency(equations), 1e-300) * known
    inside = scale[:, None] * variance * scale
    inside[~known, ~known] = held_u_mm**2
    unit = np.r_[np.ones(3), np.full(3, 1.0 / equations.lever_mm)]
    return np.asarray(unit[:, None] * (vectors @ inside @ vectors.T) * unit)


def components(equations: Equations, stretch: Int) -> tuple[float, float]:
    """Variances (mm^2) of a residual's own error and of each coordinate of its stretch's displacement.

    By moments: sums of squares of residuals, and of their sums along the normals over stretches; both made larger for
    the six parameters that the fit has taken out of the stretches.
    """
    residual, normal = equations.residual_mm * np.sqrt(equations.weight), equations.rows[:, :3]
    count = int(stretch.max()) + 1
    sums, moments = np.zeros((count, 3)), np.zeros((count, 3, 3))
    np.add.at(sums, stretch, normal * residual[:, None])
    np.add.at(moments, stretch, normal[:, :, None] * normal[:, None, :])
    total, spread = float((residual**2).sum()), float((moments**2).sum())
    filled = len(np.unique(stretch))
    excess = float((sums**2).sum()) * filled / max(filled - 3.0, 1.0) - total
    shared = max(0.0, excess / max(spread - len(residual), 1.0))
    return max(total / len(residual) - shared, 0.0), shared


def stretches(equations: Equations) -> Int:
    """The stretch (n,) of every row: equally many frames where they are known, else equal lengths; about STRETCH_MM."""
    along = equations.off_mm @ np.linalg.svd(equations.off_mm, full_matrices=False)[2][0]
    count = max(LEAST_STRETCHES, int(np.ptp(along) / STRETCH_MM))
    if equations.frame is not None:
        along = equations.frame.astype(float)
    number: Int = ((along - along.min()) / (float(np.ptp(along)) or 1.0) * count).astype(np.int64)
    return np.minimum(number, count - 1)


def _efficiency(equations: Equations) -> float:
    """Mean slope of the biweight's influence over its mean weight: an M-estimator's own normal matrix (Huber 1981)."""
    root = np.sqrt(np.clip(equations.weight, 0.0, 1.0))
    slope = root * (5.0 * root - 4.0)
    return float(np.clip(slope.mean() / max(equations.weight.mean(), 1e-9), 0.5, 1.0))
