"""Orthogonal least-squares fits of line, plane, circle, sphere and cylinder to points in space.

What is least is the sum of squared distances from the points to the shape (ISO 10360-6, ISO/TS 15530; Forbes,
"Least-squares best-fit geometric elements", NPL Report DITC 140/89, 1991). Points are centred and scaled first, so an
origin that lies far off costs no digits.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from workbench.units import Float, Shaped

MOST_STEPS = 200
DONE = 1e-15  # of the extent: a step below changes nothing
OPEN = 1e-7  # ratio of singular values of the Jacobian below which the points leave a parameter open
Shape = Literal["line", "plane", "circle", "sphere", "cylinder"]

LEAST_POINTS: dict[Shape, int] = {"line": 2, "plane": 3, "circle": 3, "sphere": 4, "cylinder": 5}
FLAT = 1e-10  # of the extent: below, points lie on a line, or are one


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


@dataclass(frozen=True, slots=True, eq=False)
class Fit:
    """A fitted shape. Directions are unit vectors, their largest component positive."""

    shape: Shape
    point_mm: Shaped[Float, " 3"]  # centre; or the centroid's foot on line, plane or axis
    direction: Shaped[Float, " 3"] | None  # along a line or an axis, normal of a plane or a circle; None: a sphere
    radius_mm: float | None  # None: line, plane
    residuals_mm: Shaped[Float, " n"]  # distances; signed (outside positive) where the shape has two sides

    @property
    def rms_mm(self) -> float:
        """Root mean square of the distances."""
        return float(np.sqrt(np.mean(self.residuals_mm**2)))


def fit(shape: Shape, points_mm: Float) -> Fit:
    """The shape of one kind that fits points (n, 3) best.

    Raises:
        ValueError: too few points, or points that leave the shape open (collinear ones for a plane); in words.
    """
    points = np.asarray(points_mm, float)
    if points.ndim != 2 or points.shape[1] != 3 or not np.isfinite(points).all():
        raise ValueError("expected finite points (n, 3)")
    if len(points) < LEAST_POINTS[shape]:
        raise ValueError(f"expected at least {LEAST_POINTS[shape]} points for a {shape}, found {len(points)}")
    if shape != "line" and _on_one_line(points):
        raise ValueError(f"the points lie on one line: they leave a {shape} open")
    return FITS[shape](points)


def fit_line(points_mm: Float) -> Fit:
    """Line through the centroid along the largest principal axis of points (n, 3)."""
    middle, off, size, axes = _principal(points_mm)
    if size[0] == 0.0:
        raise ValueError("all points are one: they leave the direction of a line open")
    distances = np.linalg.norm(off - np.outer(off @ axes[0], axes[0]), axis=1)
    return Fit("line", middle, positive(axes[0]), None, distances)


def fit_plane(points_mm: Float) -> Fit:
    """Plane through the centroid normal to the smallest principal axis of points (n, 3); steep ones like any other."""
    middle, off, _, axes = _principal(points_mm)
    normal = positive(axes[2])
    return Fit("plane", middle, normal, None, off @ normal)


def fit_circle(points_mm: Float) -> Fit:
    """Circle in space: distances to the curve itself, in its plane and off it, both at once. Points (n, 3)."""
    return _round("circle", round_circle(points_mm))


def fit_sphere(points_mm: Float) -> Fit:
    """Sphere through points (n, 3)."""
    return _round("sphere", round_sphere(points_mm))


def fit_cylinder(points_mm: Float) -> Fit:
    """Circular cylinder through points (n, 3), its axis sought over all directions."""
    return _round("cylinder", round_cylinder(points_mm))


FITS: dict[Shape, Callable[[Float], Fit]] = {
    "line": fit_line,
    "plane": fit_plane,
    "circle": fit_circle,
    "sphere": fit_sphere,
    "cylinder": fit_cylinder,
}


def positive(direction: Float) -> Float:
    """The same direction with its largest component positive."""
    return np.asarray(direction * np.sign(direction[np.argmax(np.abs(direction))]))


def _round(shape: Shape, found: RoundFit) -> Fit:
    direction = None if found.axis is None else positive(found.axis)
    return Fit(shape, found.centre_mm, direction, found.radius_mm, found.residuals_mm)


def _on_one_line(points_mm: Float) -> bool:
    size = _principal(points_mm)[2]
    return bool(size[1] <= FLAT * size[0])


def _principal(points_mm: Float) -> tuple[Float, Float, Float, Float]:
    """Centroid, points less it, their principal extents (3,), largest first, and axes (3, 3), one a row."""
    middle, off, _ = centred(points_mm)
    _, size, axes = np.linalg.svd(off, full_matrices=True)
    return middle, off, np.r_[size, np.zeros(3 - len(size))], axes


# Circle, sphere and cylinder of least squared distances: an algebraic start, then Gauss-Newton steps.

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
