"""Orthogonal least-squares fits of line, plane, circle, sphere and cylinder to points in space.

What is least is the sum of squared distances from the points to the shape (ISO 10360-6, ISO/TS 15530; Forbes,
"Least-squares best-fit geometric elements", NPL Report DITC 140/89, 1991). Points are centred and scaled first, so an
origin that lies far off costs no digits.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from workbench.geometry.fits_round import RoundFit, round_circle, round_cylinder, round_sphere
from workbench.geometry.fits_steps import centred
from workbench.units import Float

Shape = Literal["line", "plane", "circle", "sphere", "cylinder"]

LEAST_POINTS: dict[Shape, int] = {"line": 2, "plane": 3, "circle": 3, "sphere": 4, "cylinder": 5}
FLAT = 1e-10  # of the extent: below, points lie on a line, or are one


@dataclass(frozen=True, slots=True, eq=False)
class Fit:
    """A fitted shape. Directions are unit vectors, their largest component positive."""

    shape: Shape
    point_mm: Float  # (3,) centre; or the centroid's foot on line, plane or axis
    direction: Float | None  # (3,) along a line or an axis, normal of a plane or a circle; None: a sphere
    radius_mm: float | None  # None: line, plane
    residuals_mm: Float  # (n,) distances; signed (outside positive) where the shape has two sides

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
