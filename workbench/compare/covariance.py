"""Covariance of a registration: its normal equations, and residuals that hang together."""

from __future__ import annotations

import numpy as np

from workbench.compare.icp import OPEN, Equations
from workbench.units import Float, Int

LEAST_STRETCHES, STRETCH_MM = 12, 4.0  # residuals of one stretch hang together


def covariance_of(equations: Equations, held_u_mm: float) -> Float:
    """(6, 6) of the shift (mm) and the turn (rad) about the pivot.

    H^-1 (sum of g g^T) H^-1, g a place's weighted row times its residual (Huber, Robust Statistics, 1981), made larger
    by what residuals of one stretch have in common: they share frames, and both surfaces' errors. That factor is, for
    each direction of the normal matrix, the sum over stretches of (sum g)^2 over that of g^2 (Liang and Zeger,
    Biometrika 73, 1986), no less than its mean over all: a direction that few stretches fix says little about it.
    Open directions get the initial pose's uncertainty instead.
    """
    size, vectors = equations.directions()
    scores = (equations.rows * (equations.weight * equations.residual_mm)[:, None]) @ vectors
    stretch = stretches(equations)
    count = int(stretch.max()) + 1
    sums = np.stack([np.bincount(stretch, scores[:, k], count) for k in range(6)], axis=1)
    single = np.maximum((scores**2).sum(axis=0), 1e-300)
    shared = (sums**2).sum(axis=0) / single * count / max(count - 6.0, 1.0)
    known = size > OPEN
    shared = np.maximum(shared, max(1.0, float(shared[known].mean()) if known.any() else 1.0))
    fixed = np.maximum(size * equations.weight.sum() * _efficiency(equations), 1e-300)
    scale = np.where(known, np.sqrt(shared) / fixed, 0.0)
    inside = scale[:, None] * (scores.T @ scores) * scale
    inside[~known, ~known] = held_u_mm**2
    unit = np.r_[np.ones(3), np.full(3, 1.0 / equations.lever_mm)]
    return np.asarray(unit[:, None] * (vectors @ inside @ vectors.T) * unit)


def stretches(equations: Equations) -> Int:
    """The stretch (n,) of every row: along the longest direction, in equal steps of about STRETCH_MM."""
    along = equations.off_mm @ np.linalg.svd(equations.off_mm, full_matrices=False)[2][0]
    length = float(np.ptp(along)) or 1.0
    count = max(LEAST_STRETCHES, int(length / STRETCH_MM))
    number: Int = np.minimum((along - along.min()) / length * count, count - 1).astype(np.int64)
    return number


def _efficiency(equations: Equations) -> float:
    """Mean slope of the biweight's influence over its mean weight: an M-estimator's own normal matrix (Huber 1981)."""
    root = np.sqrt(np.clip(equations.weight, 0.0, 1.0))
    slope = root * (5.0 * root - 4.0)
    return float(np.clip(slope.mean() / max(equations.weight.mean(), 1e-9), 0.5, 1.0))
