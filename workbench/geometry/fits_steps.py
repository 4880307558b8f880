"""Gauss-Newton steps towards the shape of least squared distances, on points about their centroid."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from workbench.units import Float

MOST_STEPS = 200
DONE = 1e-15  # of the extent: a step below changes nothing
OPEN = 1e-7  # ratio of singular values of the Jacobian below which the points leave a parameter open


@dataclass(frozen=True, slots=True, eq=False)
class Guess:
    """The unknowns, for points about their centroid and of extent 1."""

    centre: Float
    axis: Float
    radius: float


Model = Callable[[Float, Guess], tuple[Float, Float, Float]]  # points, guess -> residuals (m,), Jacobian, steps' basis


def centred(points_mm: Float) -> tuple[Float, Float, float]:
    """Centroid (3,), points less it (n, 3), their RMS extent. Differences first: a far-off origin cancels exactly."""
    off = points_mm - points_mm[0]
    middle = off.mean(axis=0)
    off = off - middle
    return points_mm[0] + middle, off, float(np.sqrt((off**2).sum() / len(off))) or 1.0


def minimise(points: Float, guess: Guess, model: Model, name: str, most: int = MOST_STEPS) -> tuple[Guess, Float]:
    """Gauss-Newton with halved steps while they lead uphill; ValueError where the points leave an unknown open."""
    residual, jacobian, basis = model(points, guess)
    last = math.inf
    for _ in range(most):
        scale = np.linalg.norm(jacobian, axis=0)
        scale[scale == 0.0] = 1.0
        step, _, _, singular = np.linalg.lstsq(jacobian / scale, -residual, rcond=None)
        if not singular[-1] > OPEN * singular[0]:
            raise ValueError(f"the points leave a parameter of the {name} open")
        step /= scale
        size = float(np.abs(step).max()) / (1.0 + guess.radius)
        trial = _moved(guess, step, basis)
        found = model(points, trial)
        for _ in range(30):
            if found[0] @ found[0] <= (residual @ residual) * (1 + 1e-9) or size < 1e-9:
                break
            step *= 0.5
            trial = _moved(guess, step, basis)
            found = model(points, trial)
        guess, (residual, jacobian, basis) = trial, found
        if size < DONE or (size < 1e-12 and size >= last):
            break
        last = size
    if not (np.isfinite(residual).all() and guess.radius < 1e7):
        raise ValueError(f"the points lie too flat for a {name}")
    return guess, residual


def _moved(guess: Guess, step: Float, basis: Float) -> Guess:
    """Centre along `basis`, then (if any) the axis tilted towards the first two of it, last the radius."""
    k = len(basis)
    centre = guess.centre + step[:k] @ basis
    axis = guess.axis + step[k:-1] @ basis[: len(step) - k - 1]
    return Guess(centre, axis / np.linalg.norm(axis), guess.radius + float(step[-1]))


def across(axis: Float) -> Float:
    """Two unit vectors (..., 2, 3) that make a right-handed frame with the unit vectors `axis` (..., 3)."""
    first = np.eye(3)[np.argmin(np.abs(axis), axis=-1)]
    first = first - axis * (first * axis).sum(axis=-1, keepdims=True)
    first /= np.sqrt((first * first).sum(axis=-1, keepdims=True))
    x, y, z = axis[..., 0], axis[..., 1], axis[..., 2]
    u, v, w = first[..., 0], first[..., 1], first[..., 2]
    return np.stack([first, np.stack([y * w - z * v, z * u - x * w, x * v - y * u], axis=-1)], axis=-2)
