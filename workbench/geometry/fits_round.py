"""Circle, sphere and cylinder of least squared distances: an algebraic start, then Gauss-Newton steps."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from workbench.geometry.fits_steps import Guess, across, centred, minimise
from workbench.units import Float

DIRECTIONS = 400  # over the half sphere, where a cylinder's axis is sought
STARTS = 6  # of them that are followed up,
ROUGHLY = 20  # by so many steps; the best of them is followed to the end
NONE = 1e-300  # a point on the centre or the axis has no direction from it
SOUGHT = 400  # points that the search for the axis looks at


@dataclass(frozen=True, slots=True, eq=False)
class RoundFit:
    """Centre (3,), radius and, but for a sphere, axis (3,); distances (n,), outside positive where there is one."""

    centre_mm: Float
    axis: Float | None
    radius_mm: float
    residuals_mm: Float


def round_sphere(points_mm: Float) -> RoundFit:
    """Sphere through points (n, 3)."""
    middle, off, extent = centred(points_mm)
    points = off / extent
    centre, radius = _algebraic(points)
    guess, residual = minimise(points, Guess(centre, np.array([0.0, 0.0, 1.0]), radius), _sphere, "sphere")
    return RoundFit(middle + extent * guess.centre, None, extent * guess.radius, extent * residual)


def round_circle(points_mm: Float) -> RoundFit:
    """Circle in space through points (n, 3); residuals are distances to the curve, all positive."""
    middle, off, extent = centred(points_mm)
    points = off / extent
    across = np.linalg.svd(points, full_matrices=True)[2]
    flat, radius = _algebraic(points @ across[:2].T)
    guess, residual = minimise(points, Guess(flat @ across[:2], across[2], radius), _circle, "circle")
    distance = np.hypot(*residual.reshape(2, -1))
    return RoundFit(middle + extent * guess.centre, guess.axis, extent * guess.radius, extent * distance)


def round_cylinder(points_mm: Float) -> RoundFit:
    """Cylinder through points (n, 3); the centre is the foot of their centroid on the axis."""
    middle, off, extent = centred(points_mm)
    points = off / extent
    found = []
    for start in _axes(points):
        try:
            found.append(minimise(points, start, _cylinder, "cylinder", ROUGHLY))
        except ValueError as error:
            why = error
    if not found:
        raise why
    best = min(found, key=lambda one: float(one[1] @ one[1]))[0]
    guess, residual = minimise(points, best, _cylinder, "cylinder")
    centre = guess.centre - guess.axis * (guess.centre @ guess.axis)
    return RoundFit(middle + extent * centre, guess.axis, extent * guess.radius, extent * residual)


def _sphere(points: Float, guess: Guess) -> tuple[Float, Float, Float]:
    away = points - guess.centre
    distance = np.maximum(np.linalg.norm(away, axis=1), NONE)
    jacobian = np.column_stack([-away / distance[:, None], -np.ones(len(points))])
    return distance - guess.radius, jacobian, np.eye(3)


def _circle(points: Float, guess: Guess) -> tuple[Float, Float, Float]:
    """Residuals in the plane (n,), then off it (n,); unknowns: centre, tilt of the axis (2), radius."""
    basis = np.vstack([across(guess.axis), guess.axis])
    away = points - guess.centre
    height, turned = away @ guess.axis, away @ basis[:2].T
    distance = np.maximum(np.linalg.norm(turned, axis=1), NONE)
    radial = (turned @ basis[:2]) / distance[:, None]
    inside = np.column_stack([-radial @ basis.T, -(height / distance)[:, None] * turned, -np.ones(len(points))])
    off = np.column_stack([np.tile([0.0, 0.0, -1.0], (len(points), 1)), turned, np.zeros(len(points))])
    return np.r_[distance - guess.radius, height], np.vstack([inside, off]), basis


def _cylinder(points: Float, guess: Guess) -> tuple[Float, Float, Float]:
    """Unknowns: centre across the axis (2), tilt of the axis (2), radius."""
    basis = across(guess.axis)
    away = points - guess.centre
    turned = away @ basis.T
    distance = np.maximum(np.linalg.norm(turned, axis=1), NONE)
    radial = turned / distance[:, None]
    height = (away @ guess.axis)[:, None]
    return distance - guess.radius, np.column_stack([-radial, -height * radial, -np.ones(len(points))]), basis


def _algebraic(points: Float) -> tuple[Float, float]:
    """Centre (k,) and radius of the circle or sphere of least |p|^2 - 2 c p - w, for points (n, k)."""
    unknown = np.linalg.lstsq(np.column_stack([2 * points, np.ones(len(points))]), (points**2).sum(axis=1), rcond=None)[
        0
    ]
    centre = unknown[:-1]
    return centre, math.sqrt(max(float(unknown[-1] + centre @ centre), 1e-12))


def _axes(points: Float) -> list[Guess]:
    """Starts for a cylinder: the principal directions, and those along which the points look most like a circle."""
    golden = np.arange(DIRECTIONS) * math.pi * (3 - math.sqrt(5))
    height = (np.arange(DIRECTIONS) + 0.5) / DIRECTIONS
    wide = np.sqrt(1 - height**2)
    tried = np.column_stack([wide * np.cos(golden), wide * np.sin(golden), height])
    best = tried[np.argsort(_misfits(points[:: max(1, len(points) // SOUGHT)], tried))[:STARTS]]
    found = []
    for axis in [*np.linalg.svd(points, full_matrices=True)[2], *best]:
        basis = across(axis)
        flat, radius = _algebraic(points @ basis.T)
        found.append(Guess(flat @ basis, axis, radius))
    return found


def _misfits(points: Float, axes: Float) -> Float:
    """Mean squared misfit (k,) of the algebraic circle to points (n, 3) seen along each of k axes (k, 3)."""
    off = points - points.mean(axis=0)
    flat = np.einsum("nj,kij->kni", off, across(axes))
    square = (flat**2).sum(axis=2)
    moment = np.einsum("kni,knj->kij", flat, flat) + 1e-12 * len(off) * np.eye(2)
    centre = 0.5 * np.linalg.solve(moment, np.einsum("kni,kn->ki", flat, square)[..., None])[..., 0]
    distance = np.linalg.norm(flat - centre[:, None], axis=2)
    return np.asarray(distance.var(axis=1))
