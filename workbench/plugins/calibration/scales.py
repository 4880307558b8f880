"""Are the profiler's own scales right? A wrong scale of z or x leaves residuals in proportion to the sphere's place."""

from __future__ import annotations

import numpy as np
from scipy.special import stdtr

from workbench.api import Float
from workbench.plugins.calibration.bundle import Fit
from workbench.plugins.calibration.model import Noise, linearise
from workbench.plugins.calibration.observations import Observations

SURE = 1e-4  # probability, two-sided, below which a scale is called wrong
SPARE = 4  # degrees of freedom below which the question is not asked


def wrong_scales(result: Fit, seen: Observations, noise: Noise) -> tuple[tuple[str, float, float], ...]:
    """Axes whose scale the residuals contradict: name, relative error and its standard uncertainty.

    One column more in the linear model, with x_c or z_c in proportion to itself; Student's t against the residuals that
    would be left, so a misfit of another kind does not pass for this.
    """
    here = seen.subset(result.used)
    if result.freedom < SPARE or here.scans:
        return ()
    linear = linearise(result.estimate, here, noise)
    white = np.linalg.inv(np.linalg.cholesky(linear.covariance))
    r, J = (white @ linear.residual[..., None]).ravel(), (white @ linear.jacobian).reshape(-1, linear.jacobian.shape[2])
    found = []
    for name, row in (("x", 0), ("z", 1)):
        column = np.zeros((len(here), 3, 1))
        column[:, row, 0] = here.circle[:, row]
        error, u = _score(r, J, (white @ column).ravel(), noise)
        if 2 * stdtr(result.freedom - 1, -abs(error) / u) < SURE:
            found.append((name, error, u))
    return tuple(found)


def _score(r: Float, J: Float, column: Float, noise: Noise) -> tuple[float, float]:
    """Estimate and uncertainty of one parameter more."""
    prior = np.zeros((1, J.shape[1]))
    prior[0, 9] = 1 / noise.radius_u_mm
    J = np.concatenate([J, prior])
    column = np.append(column, 0.0)
    apart = column - J @ np.linalg.lstsq(J, column, rcond=None)[0]
    power = float(apart @ apart)
    error = float(apart[:-1] @ r) / power
    rest = r - apart[:-1] * error  # what a right scale would leave
    return error, float(np.sqrt(rest @ rest / max(len(r) - J.shape[1] - 1, 1) / power))
