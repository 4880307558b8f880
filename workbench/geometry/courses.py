"""Smooth courses along an edge by regression splines, and the curve that they make.

A raw edge is rough: its points scatter about the edge in waves of up to a few centimetres that neighbours share, which
cross-validation over neighbours would take for the edge itself. So the course is a least-squares spline, a line if
that will do, else with knots far apart: as far as the measured points allow (a criterion that counts them by the length over which they hang
together), and never nearer than the shortest wave that a course may have.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import BSpline

from workbench.geometry.curves import Curve, with_frame
from workbench.units import Bool, Float

# Degree and distance of knots to choose from; 20 mm carry waves from 60 mm on.
SHAPES = ((1, math.inf), (2, math.inf), (3, math.inf), (3, 60.0), (3, 40.0), (3, 28.0), (3, 20.0))
BIN_MM = 2.0
TOGETHER_MM = 10.0  # length over which the scatter of a rough face hangs together
PRICE = 5.0  # of a coefficient, in the unit of twice the log-likelihood
OUTLIER_SIGMAS = 5.0


@dataclass(frozen=True, slots=True, eq=False)
class Course:
    """A smooth course of d values along an edge."""

    spline: BSpline  # s (mm) -> (d,)
    kept: Bool  # (n,) points that it rests on; the others are outliers
    knots: Float

    def u(self, s: Float, at: Float, residual: Float) -> Float:
        """Standard uncertainty (m,) of one of the values at places `at` (m,), from its residuals (n,) at s (n,).

        Residuals that hang together over a distance count once over it.
        """
        return _propagated(s[self.kept], residual[self.kept], self.knots, at)


def fit_course(s: Float, values: Float, weight: Float | None = None) -> Course:
    """The smooth course through values (n, d) at s (n,), mm; outliers beyond OUTLIER_SIGMAS left out."""
    weight = np.ones(len(s)) if weight is None else weight
    kept = weight > 0
    knots = _knots(s[kept], 1, math.inf)
    for _ in range(3):
        at, mean, count = _bin_means(s[kept], values[kept], weight[kept])
        knots = _choice(at, mean, count, float(s[kept].max() - s[kept].min()))
        spline = _fit(at, mean, count, knots)
        off = np.linalg.norm(values - spline(s), axis=1)
        scale = float(np.median(off[kept])) / 0.6745 + 1e-9
        kept = (weight > 0) & (off < OUTLIER_SIGMAS * scale)
    at, mean, count = _bin_means(s[kept], values[kept], weight[kept])
    return Course(_fit(at, mean, count, knots), kept, knots)


def fit_course_curve(points_mm: Float, s: Float) -> tuple[Curve, Bool]:
    """The smooth curve through points (n, 3) mm at rough arc lengths s (n,), and which points it rests on."""
    for _ in range(2):  # the spline's own parameter becomes its arc length
        course = fit_course(s, points_mm)
        dense = np.linspace(s.min(), s.max(), max(50, int(s.max() - s.min()) * 2))
        speed = np.linalg.norm(course.spline(dense, 1), axis=1)
        arc = np.concatenate([[0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1]) * np.diff(dense))])
        s = np.asarray(np.interp(s, dense, arc))
    course = fit_course(s, points_mm)
    return with_frame(course.spline, s, math.inf, 0.0), course.kept


def _knots(s: Float, degree: int, distance: float) -> Float:
    """Knots of a spline over s, about `distance` apart."""
    length = float(s.max() - s.min())
    pieces = 1 if math.isinf(distance) else max(1, round(length / distance))
    grid = np.linspace(s.min(), s.max(), pieces + 1)
    return np.asarray(np.r_[[grid[0]] * degree, grid, [grid[-1]] * degree])


def _degree(knots: Float) -> int:
    return int((knots == knots[0]).sum()) - 1


def _basis(s: Float, knots: Float) -> Float:
    """The B-splines (n, size) at s (n,); beyond the knots their values at the ends."""
    return np.asarray(BSpline.design_matrix(np.clip(s, knots[0], knots[-1]), knots, _degree(knots)).toarray())


def _bin_means(s: Float, values: Float, weight: Float) -> tuple[Float, Float, Float]:
    """Mean place and values of bins along s, and their weights: a cubic's least squares in a fraction of the time."""
    number = np.floor((s - s.min()) / BIN_MM).astype(np.int64)
    if len(s) < 4 * (number.max() + 1):
        order = np.argsort(s, kind="stable")
        return s[order], values[order], weight[order]
    _, bin_of = np.unique(number, return_inverse=True)
    total: Float = np.bincount(bin_of, weight).astype(np.float64)
    mean = np.stack([np.bincount(bin_of, weight * v) / total for v in values.T], axis=1)
    return np.bincount(bin_of, weight * s) / total, mean, total


def _fit(at: Float, values: Float, weight: Float, knots: Float) -> BSpline:
    """Weighted least squares; over gaps without points a slight pull against bending carries the spline on."""
    basis = _basis(at, knots)
    bend = np.diff(np.eye(basis.shape[1]), 2, axis=0)
    normal = basis.T @ (weight[:, None] * basis)
    pull = 1e-6 * np.trace(normal) / len(normal)
    right = basis.T @ (weight[:, None] * values)
    if len(bend):
        normal = normal + pull * bend.T @ bend
    return BSpline(knots, np.linalg.solve(normal + 1e-12 * np.trace(normal) * np.eye(len(normal)), right), _degree(knots))


def _choice(at: Float, values: Float, weight: Float, length: float) -> Float:
    """The knots of least score: twice the negative log-likelihood of the residuals, plus the coefficients' price.

    Residuals that hang together over TOGETHER_MM count as one.
    """
    free = min(length / TOGETHER_MM, float(at.size))
    best, least = _knots(at, 1, math.inf), math.inf
    for shape in SHAPES:
        knots = _knots(at, *shape)
        size = knots.size - 1 - _degree(knots)
        if size > 4 and size >= free + 1.0:
            break
        left = values - _fit(at, values, weight, knots)(at)
        score = free * math.log(float((weight[:, None] * left**2).sum()) + 1e-12) + PRICE * size
        if score < least:
            best, least = knots, score
    return best


def _propagated(s: Float, residual: Float, knots: Float, at: Float) -> Float:
    """Standard uncertainty (m,) of the spline with these knots at `at` (m,), from the scatter of block means."""
    size, length = knots.size - 1 - _degree(knots), float(knots[-1] - knots[0])
    blocks = max(2 * size, min(round(length / 10.0), s.size // 2))
    number = np.minimum((s - knots[0]) / length * blocks, blocks - 1).astype(np.int64)
    used, block_of = np.unique(number, return_inverse=True)
    count = np.bincount(block_of)
    mean = np.bincount(block_of, residual) / count
    place = np.bincount(block_of, s) / count
    variance = float((mean**2).sum()) / max(used.size - size, 0.3 * used.size)
    basis = _basis(place, knots)
    normal = basis.T @ basis
    normal += 1e-9 * np.trace(normal) * np.eye(size)
    row = _basis(at, knots)
    return np.asarray(np.sqrt(variance * np.einsum("ij,ji->i", row, np.linalg.solve(normal, row.T))))
