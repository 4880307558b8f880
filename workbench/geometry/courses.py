"""Smooth courses along an edge by regression splines, and the curve that they make.

A raw edge is rough: its points scatter about the edge in waves of up to a few centimetres that neighbours share, which
cross-validation over neighbours would take for the edge itself. So the course is a least-squares spline, a line if
that will do (a criterion decides that counts points by the length over which they hang together), and never with knots
nearer than the shortest wave that a course may have.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import BSpline
from scipy.linalg import solveh_banded
from scipy.sparse import csr_array

from workbench.geometry.curves import Curve, with_frame
from workbench.units import Bool, Float

Shape = tuple[int, float]  # degree and distance of knots, mm
# Shapes to choose from, the simplest first; knots 20 mm apart carry waves from 60 mm on.
SHAPES: tuple[Shape, ...] = ((1, math.inf), (2, math.inf), (3, math.inf), (3, 40.0), (3, 28.0), (3, 20.0))
FINER: tuple[Shape, ...] = ((3, 14.0), (3, 10.0))  # where nothing but noise scatters: a smooth face
FLAT: tuple[Shape, ...] = ((1, math.inf), (2, math.inf), (3, math.inf), (3, 200.0))  # of what a plate's flatness rules
BIN_MM = 2.0
CARRIED_MM = 7.0  # between the knots of a spline that carries any of these on
TOGETHER_MM = 10.0  # length over which the scatter of a rough face hangs together
CHOICE_MM = 400.0  # the shape is chosen on this much of the edge
FINER_LEAST = 20  # bins, half of which finer knots may take
SMOOTH_MM = 0.004  # bins of a smooth face scatter about its course by less
WHITE = 0.3  # greatest correlation of neighbouring bins that passes for noise
PRICE = 3.0  # of a coefficient, in the unit of twice the log-likelihood
OUTLIER_SIGMAS = 5.0
BEAT = 0.5  # of a step: a uniform phase has a standard deviation of 0.29
PLACES = 200  # at which the uncertainty is computed; linear between them


@dataclass(frozen=True, slots=True, eq=False)
class Course:
    """A smooth course of d values along an edge."""

    spline: BSpline  # s (mm) -> (d,)
    kept: Bool  # (n,) points that it rests on; the others are outliers
    shape: Shape

    def u(self, s: Float, at: Float, residual: Float) -> Float:
        """Standard uncertainty (m,) of one of the values at places `at` (m,), from its residuals (n,) at s (n,).

        Residuals that hang together over a distance count once over it.
        """
        return _propagated(s[self.kept], residual[self.kept], self.spline.t, at)


def fit_course(s: Float, values: Float, shapes: tuple[Shape, ...] = SHAPES, together_mm: float = TOGETHER_MM) -> Course:
    """The smooth course through values (n, d) at s (n,), mm, outliers left out.

    shapes: to choose from. together_mm: length over which the values' scatter hangs together.
    """
    kept = np.ones(len(s), bool)
    for again in (True, True, False):
        at, mean, count = _bin_means(s[kept], values[kept])
        shape = shapes[0] if len(shapes) == 1 else _choice(at, mean, count, shapes, together_mm)
        if len(shapes) > 1 and shape in SHAPES[-3:]:
            shape = _finer(at, mean, count, shape)
        spline = _fit(at, mean, count, _knots(s[kept], shape))
        if again:
            off = np.linalg.norm(values - spline(s), axis=1)
            kept = off < OUTLIER_SIGMAS * (float(np.median(off[kept])) / 0.6745 + 1e-9)
    return Course(spline, kept, shape)


def fit_course_curve(points_mm: Float, s: Float, across: Float, step_mm: float = 0.0) -> Curve:
    """The smooth curve through points (n, 3) mm of a flat plate's edge, at rough arc lengths s (n,).

    across (3,): unit, square to the plate. The height along it has a course of its own: that of a silhouette is known
    but for the step between two columns (`step_mm`; 0: a corner), whose beat must not bend the curve. So it is a line
    unless the heights are off a line by more than such a beat.
    """
    height = points_mm @ across
    flat = fit_course(s, points_mm - height[:, None] * across)
    high = fit_course(s, height[:, None], FLAT)
    line = fit_course(s, height[:, None], FLAT[:1])
    if np.std(high.spline(s) - line.spline(s)) < BEAT * step_mm:
        high = line
    for _ in range(3):  # the spline's own parameter becomes its arc length
        dense = np.linspace(s.min(), s.max(), max(50, int(np.ptp(s)) * 2))
        sites = flat.spline(dense) + high.spline(dense) * across
        spline = _fit(dense, sites, np.ones(dense.size), _knots(dense, (3, CARRIED_MM)))
        speed = np.linalg.norm(spline(dense, 1), axis=1)
        arc = np.concatenate([[0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1]) * np.diff(dense))])
        s = np.asarray(np.interp(s, dense, arc))
        flat = fit_course(s, points_mm - height[:, None] * across, (flat.shape,))
        high = fit_course(s, height[:, None], (high.shape,))
    return with_frame(spline, s, math.inf, 0.0)


def _knots(s: Float, shape: Shape) -> Float:
    """Knots of a spline of this shape over s."""
    degree, distance = shape
    pieces = 1 if math.isinf(distance) else max(1, round(float(np.ptp(s)) / distance))
    grid = np.linspace(s.min(), s.max(), pieces + 1)
    return np.asarray(np.r_[[grid[0]] * degree, grid, [grid[-1]] * degree])


def _degree(knots: Float) -> int:
    return int((knots == knots[0]).sum()) - 1


def _bin_means(s: Float, values: Float) -> tuple[Float, Float, Float]:
    """Mean place and values of bins along s, and how many points each has; few points are left as they are."""
    number = np.floor((s - s.min()) / BIN_MM).astype(np.int64)
    _, bin_of = np.unique(number, return_inverse=True)
    count: Float = np.bincount(bin_of).astype(np.float64)
    if len(s) < 4 * count.size:
        order = np.argsort(s, kind="stable")
        return s[order], values[order], np.ones(len(s))
    mean = np.stack([np.bincount(bin_of, v) / count for v in values.T], axis=1)
    return np.bincount(bin_of, s) / count, mean, count


def _banded(at: Float, weight: Float, knots: Float) -> tuple[Float, csr_array]:
    """Normal equations' matrix of the splines with these knots, in scipy's upper banded form, and their basis.

    Over gaps without points a slight pull against bending carries the spline on.
    """
    degree, size = _degree(knots), knots.size - 1 - _degree(knots)
    basis = BSpline.design_matrix(np.clip(at, knots[0], knots[-1]), knots, degree)
    normal = basis.T @ basis.multiply(weight[:, None])
    band = np.zeros((4, size))
    for d in range(degree + 1):
        band[3 - d, d:] = normal.diagonal(d)
    pull = 1e-6 * float(band[3].mean())
    for shift, factor in ((0, 1.0), (1, 4.0), (2, 1.0)):  # squares of the second differences 1, -2, 1
        band[3, shift : size - 2 + shift] += pull * factor
    for shift in (0, 1):
        band[2, 1 + shift : size - 1 + shift] -= 2.0 * pull
    band[1, 2:] += pull
    band[3] += 1e-12 * float(band[3].mean())
    return band, basis


def _fit(at: Float, values: Float, weight: Float, knots: Float) -> BSpline:
    """Weighted least squares."""
    band, basis = _banded(at, weight, knots)
    return BSpline(knots, solveh_banded(band, basis.T @ (weight[:, None] * values)), _degree(knots))


def _choice(at: Float, values: Float, weight: Float, shapes: tuple[Shape, ...], together_mm: float) -> Shape:
    """The shape of least score: twice the negative log-likelihood of the residuals, plus the coefficients' price.

    Residuals that hang together over together_mm count as one.
    """
    near = np.abs(at - 0.5 * (at[0] + at[-1])) <= 0.5 * CHOICE_MM
    if near.sum() > 20:
        at, values, weight = at[near], values[near], weight[near]
    free = min(float(at[-1] - at[0]) / together_mm, float(at.size))
    best, least = shapes[0], math.inf
    for shape in shapes:
        knots = _knots(at, shape)
        size = knots.size - 1 - shape[0]
        if size > 4 and size >= free + 1.0:
            break
        left = values - _fit(at, values, weight, knots)(at)
        score = free * math.log(float((weight[:, None] * left**2).sum()) + 1e-12) + PRICE * size
        if score < least:
            best, least = shape, score
    return best


def _finer(at: Float, values: Float, weight: Float, shape: Shape) -> Shape:
    """The same shape, or one with nearer knots if with these nothing but white noise is left: a face without waves."""
    best, noise, free = shape, 0.0, float(at.size)
    closest = values - _fit(at, values, weight, _knots(at, FINER[-1]))(at)
    if free < 2.0 * FINER_LEAST or float(np.median(np.linalg.norm(closest, axis=1))) > SMOOTH_MM:
        return shape
    for finer in (shape, *(other for other in (*SHAPES[-2:], *FINER) if other[1] < shape[1])):
        knots = _knots(at, finer)
        size = knots.size - 1 - finer[0]
        if size > free / 2.0:
            break
        left = values - _fit(at, values, weight, knots)(at)
        together = float((left[1:] * left[:-1]).sum()) / float((left**2).sum() + 1e-30)
        score = free * math.log(float((weight[:, None] * left**2).sum()) + 1e-12) + PRICE * size
        if finer is shape or (score < noise and abs(together) < WHITE):
            best, noise = finer, score
    return best


def _propagated(s: Float, residual: Float, knots: Float, at: Float) -> Float:
    """Standard uncertainty (m,) of the spline with these knots at `at` (m,), from the scatter of block means."""
    size, length = knots.size - 1 - _degree(knots), float(knots[-1] - knots[0])
    blocks = max(2 * size, min(round(length / 10.0), s.size // 2))
    number = np.minimum((s - knots[0]) / length * blocks, blocks - 1).astype(np.int64)
    used, block_of = np.unique(number, return_inverse=True)
    count = np.bincount(block_of)
    mean, place = np.bincount(block_of, residual) / count, np.bincount(block_of, s) / count
    variance = float((mean**2).sum()) / max(used.size - size, 0.3 * used.size)
    band, _ = _banded(place, np.ones(place.size), knots)
    places = np.linspace(at[0], at[-1], min(PLACES, at.size))
    inside = np.clip(places, knots[0], knots[-1])
    row = BSpline.design_matrix(inside, knots, _degree(knots)).toarray()
    share = np.einsum("ij,ji->i", row, solveh_banded(band, row.T))
    return np.asarray(np.interp(at, places, np.sqrt(variance * np.maximum(share, 0.0))))
