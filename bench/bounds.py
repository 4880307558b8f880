"""The Cramer-Rao bound, by differences of what is predicted: nothing is shared with the estimators that it judges."""

from __future__ import annotations

from collections.abc import Callable, Iterable

import numpy as np

from workbench.units import Float

Predict = Callable[[Float], Float]  # of unknowns (P,) about the truth what is seen, (N,) in any shape


def differences(predict: Predict, steps: Float) -> Float:
    """Derivatives (N, P) of `predict` at 0, by central differences of so wide steps (P,)."""
    columns = [(predict(step) - predict(-step)).ravel() / (2 * step.sum()) for step in np.diag(steps)]
    return np.column_stack(columns)


def cramer_rao(predict: Predict, steps: Float, covariance: Iterable[Float], prior: Float) -> Float:
    """The bound (P, P); covariance: blocks of what is seen, in its order, prior (P,): information of each unknown."""
    jacobian, information, at = differences(predict, steps), np.diag(prior), 0
    for block in covariance:
        rows = jacobian[at : at + len(block)]
        information = information + rows.T @ np.linalg.solve(block, rows)
        at += len(block)
    size_of = 1 / np.sqrt(np.diagonal(information))
    return np.asarray(size_of[:, None] * np.linalg.inv(size_of[:, None] * information * size_of) * size_of)
