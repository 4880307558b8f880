"""Weighted least squares for the joints' compliance, with gross errors found and rejected."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy

from workbench.api import AnyArray, Float, Shaped
from workbench.plugins.stiffness.equations import Equations, covariances, curvature

GROSS = 1e-4  # chance that a sound set of loads loses one
ITERATIONS = 6
TYPICAL = 1e-6  # rad/Nm, scales the unknowns
SOFTEST = 1e-3  # rad/Nm, three times the softest plausible
WIDE = 1e-3  # rad/Nm, standard deviation of a prior that decides nothing: it keeps what no load determines finite


@dataclass(frozen=True, slots=True, eq=False)
class Estimate:
    """Compliance of the joints and what the loads say about it."""

    compliance: Shaped[Float, " 6"]  # rad/Nm
    covariance: Shaped[Float, "6 6"]
    misfit: Shaped[Float, " L"]  # chi-square of each load
    rows: Shaped[Float, " L"]  # how many rows each has
    residual: Shaped[Float, "L r"]  # measured minus modelled
    scale2: float  # variance of the residuals over what the noise predicts
    freedom: float  # its degrees of freedom

    @property
    def u(self) -> Float:
        """Standard uncertainties (6,), rad/Nm."""
        return np.sqrt(np.diag(self.covariance))


def solve(eq: Equations, use: Float) -> Estimate:
    """Compliance from the loads with `use` (L,) 1; weights and second order follow the estimate until it rests.

    The noise of the wrench acts through the compliance itself, so weights depend on it. A joint that no load turns gets
    a compliance near 0 and a huge variance, not an error.
    """
    compliance: Float = np.full(6, TYPICAL)
    for iteration in range(ITERATIONS):
        whitened = whiten(eq, np.abs(compliance)) * use[:, None, None]
        extra = curvature(eq, compliance) if iteration else 0.0
        a = (whitened @ eq.a).reshape(-1, 6) * TYPICAL
        y = (whitened @ (eq.y - extra)[..., None]).reshape(-1)
        information = a.T @ a + np.eye(6) * (TYPICAL / WIDE) ** 2
        # softer joints than any robot's come of loads that contradict each other: their second order would run away
        found = np.clip(TYPICAL * np.linalg.solve(information, a.T @ y), -SOFTEST, SOFTEST)
        resting = np.abs(found - compliance).max() < 1e-10 * np.abs(found).max()
        compliance = found
        if resting:
            break
    residual = (eq.y - curvature(eq, compliance) - eq.a @ compliance) * eq.seen
    misfit = np.sum((whiten(eq, np.abs(compliance)) @ residual[..., None])[..., 0] ** 2, axis=1)
    rows = eq.seen.sum(axis=1)
    freedom = max(float((rows * use).sum()) - 6, 1.0)
    covariance: AnyArray = np.linalg.inv(information) * TYPICAL**2
    return Estimate(compliance, covariance, misfit, rows, residual, float((misfit * use).sum()) / freedom, freedom)


def whiten(eq: Equations, compliance: Float) -> Float:
    """(L, r, r) that turns rows into independent ones of variance 1; what was not seen becomes 0."""
    covariance = covariances(eq, compliance)
    both = eq.seen[:, :, None] * eq.seen[:, None, :]
    hidden = (1 - eq.seen)[:, :, None] * np.eye(eq.seen.shape[1])
    lower = np.linalg.cholesky(covariance * both + hidden)
    return np.asarray(np.linalg.inv(lower) * eq.seen[:, None, :])


def excess(found: Estimate, use: Float) -> Float:
    """(L,) misfit of each load in use over what chance explains; above 1 it contradicts the others.

    Judged against the noise or, where all loads fit worse than that, against the spread of most of them.
    """
    inside = (use > 0) & (found.rows > 0)
    if not inside.any():
        return np.zeros(len(use))
    level = scipy.special.chdtri(found.rows, GROSS / len(use))
    spread = max(1.0, float(np.median(found.misfit[inside] / scipy.special.chdtri(found.rows[inside], 0.5))))
    return np.asarray(np.where(inside, found.misfit / np.maximum(level * spread, 1e-300), 0.0))


def robust(eq: Equations) -> tuple[Estimate, Float]:
    """The estimate, and which loads it rests on (L,): the worst is rejected as long as chance does not explain it.

    At most a fifth of them: where one more contradicts the rest, see `excess`.
    """
    use = np.ones(len(eq.y))
    found = solve(eq, use)
    for _ in range(len(use) // 5):
        over = excess(found, use)
        if over.max() <= 1:
            break
        use[int(np.argmax(over))] = 0.0
        found = solve(eq, use)
    return found, use
