"""A smooth curve through measured points: position, tangent, curvature and a frame that does not twist."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import BSpline, make_lsq_spline, make_smoothing_spline
from scipy.linalg import eigh
from scipy.optimize import minimize_scalar
from scipy.spatial import cKDTree

from workbench.units import Bool, Float, Int

BIN_MM = 4.0  # longer than the errors of a robot's pose hang together, so that they average like noise
LEAST_BINS, MOST_BINS = 20, 600
LEAST_STEP = 0.25  # of a bin's width, between the means of neighbouring bins
GCV_BINS = 120
SMALL_WAVE_MM = 0.1  # waves of the edge below this rms may as well be the robot's path as the part's


@dataclass(frozen=True, slots=True, eq=False)
class Curve:
    """A space curve c(s), s its arc length in mm, with a rotation-minimising frame (t, a, b), b = t x a.

    A vector at a constant angle from `a` keeps its angle to the plane of a plane curve, and to any fixed direction
    on a straight one: it is what "the same tilt along the edge" means (Wang et al., "Computation of rotation minimizing
    frames", ACM TOG 27, 2008).
    """

    spline: BSpline  # s -> position (3), mm
    stations_mm: Float  # (k,) where the frame was computed
    references: Float  # (k, 3) a at the stations
    stiffness: float  # penalty on the squared second derivative, mm^3
    tangent_u: float  # standard uncertainty of the tangent's direction across itself, each way, rad

    def position(self, s: Float) -> Float:
        """c(s), (n, 3) mm."""
        return np.asarray(self.spline(s))

    def tangent(self, s: Float) -> Float:
        """Unit tangent t, (n, 3)."""
        d = np.asarray(self.spline(s, 1))
        return np.asarray(d / np.linalg.norm(d, axis=-1, keepdims=True))

    def curvature(self, s: Float) -> Float:
        """Curvature vector dt/ds, (n, 3) 1/mm."""
        d1, d2 = np.asarray(self.spline(s, 1)), np.asarray(self.spline(s, 2))
        speed2 = (d1 * d1).sum(-1, keepdims=True)
        return np.asarray((d2 - d1 * (d1 * d2).sum(-1, keepdims=True) / speed2) / speed2)

    def frame(self, s: Float) -> tuple[Float, Float, Float]:
        """(t, a, b), each (n, 3) unit, right-handed and not twisting along the curve."""
        t = self.tangent(s)
        a = np.stack([np.interp(s, self.stations_mm, self.references[:, k]) for k in range(3)], axis=-1)
        a -= t * (a * t).sum(-1, keepdims=True)
        a /= np.linalg.norm(a, axis=-1, keepdims=True)
        return t, a, np.cross(t, a)

    def shifted(self, s0: float) -> Curve:
        """The same curve with its arc length counted from s0."""
        spline = BSpline(self.spline.t - s0, self.spline.c, self.spline.k)
        return Curve(spline, self.stations_mm - s0, self.references, self.stiffness, self.tangent_u)

    def project(self, points_mm: Float, s: Float) -> Float:
        """Arc length (n,) of the feet of points (n, 3) mm, by Newton steps from the guess s."""
        for _ in range(3):
            d1 = np.asarray(self.spline(s, 1))
            off = points_mm - np.asarray(self.spline(s))
            bend = (off * np.asarray(self.spline(s, 2))).sum(-1)
            slope = (d1 * d1).sum(-1) - bend
            s = s + (off * d1).sum(-1) / np.where(slope > 0.2, slope, 1.0)
        return s


def arrange(points_mm: Float, group: Int, forward: Bool) -> Float:
    """A rough arc length (n,) mm for each of n points (n, 3) that several passes measured along one edge.

    Points of a pass (`group`) come in order of time; `forward` says whether that is the direction of rising arc length.
    The longest pass lays down the course, the others are projected on it.
    """
    courses = []
    for g in np.unique(group):
        mine = np.flatnonzero(group == g)
        if mine.size >= 2:
            if np.mean(forward[mine]) < 0.5:
                mine = mine[::-1]
            courses.append(_polyline(points_mm[mine]))
    course = max(courses, key=lambda c: float(np.linalg.norm(c[-1] - c[0])))
    return _along(course, points_mm)


def _polyline(points: Float) -> Float:
    """Points in order, averaged over blocks, as a course along which they advance."""
    length = np.linalg.norm(points[-1] - points[0])
    blocks = int(np.clip(length / 4.0, 2, min(200, len(points))))
    return np.array([part.mean(axis=0) for part in np.array_split(points, blocks)])


def _along(course: Float, points: Float) -> Float:
    """Rough arc length of points (n, 3) along a polyline (k, 3) that goes straight on beyond its ends."""
    s = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(course, axis=0), axis=1))])
    direction = np.gradient(course, axis=0)
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    nearest = cKDTree(course).query(points)[1]
    return np.asarray(s[nearest] + ((points - course[nearest]) * direction[nearest]).sum(axis=1))


def fit_curve(points_mm: Float, s: Float, stiffness: float | None = None) -> Curve:
    """The smooth curve through points (n, 3) mm at rough arc lengths s (n,); s of the result is arc length from 0.

    Points are averaged over bins of a few mm. The curve is a cubic polynomial plus a cubic smoothing spline of what
    that leaves; how smooth follows from generalised cross-validation (Craven and Wahba, 1979) unless `stiffness`, of
    an earlier curve through points of the same noise, says so.
    """
    for _ in range(2):  # the spline's own parameter becomes its arc length
        at, mean, weight = _bin_means(points_mm, s)
        spline, stiffness, _ = _smoothing_spline(at, mean, weight, stiffness)
        dense = np.linspace(at[0], at[-1], 4 * at.size)
        speed = np.linalg.norm(spline(dense, 1), axis=1)
        arc = np.concatenate([[0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1]) * np.diff(dense))])
        s = np.interp(s, dense, arc) + np.minimum(s - dense[0], 0.0) + np.maximum(s - dense[-1], 0.0)
    spline, stiffness, tangent_u = _smoothing_spline(*_bin_means(points_mm, s), stiffness)
    return with_frame(spline, s, stiffness, tangent_u)


def _bin_means(points: Float, s: Float) -> tuple[Float, Float, Float]:
    """Mean s, mean point and count of each bin along s that holds points; the points beyond 5 sigma left out."""
    length = s.max() - s.min()
    width = max(min(BIN_MM, length / LEAST_BINS), length / MOST_BINS)
    number = np.floor((s - s.min()) / width).astype(np.int64)
    _, bin_of = np.unique(number, return_inverse=True)
    count = np.bincount(bin_of)

    def means(values: Float, weights: Float) -> Float:
        return np.bincount(bin_of, weights * values) / np.maximum(np.bincount(bin_of, weights), 1e-9)

    keep = np.ones(len(s))
    if count.max() >= 4:
        for _ in range(2):
            off = np.stack([points[:, k] - means(points[:, k], keep)[bin_of] for k in range(3)], axis=1)
            off -= off.mean(axis=0)
            size = np.linalg.norm(off, axis=1)
            keep = (size < max(5.0 * float(np.median(size)), 0.6 * width)).astype(np.float64)
    mean = np.stack([means(points[:, k], keep) for k in range(3)], axis=1)
    weight: Float = np.bincount(bin_of, keep).astype(np.float64)
    at = means(s, keep)
    good = (weight > 0) & (np.diff(at, prepend=-np.inf) > LEAST_STEP * width)  # spline knots must not crowd
    return at[good], mean[good], weight[good]


def _smoothing_spline(at: Float, values: Float, weight: Float,
                      stiffness: float | None) -> tuple[BSpline, float, float]:  # fmt: skip
    """Cubic polynomial plus smoothing spline through (n, 3) values at `at` (n,), its penalty (mm^3), tangent's u."""
    degree = min(3, at.size - 1)
    trend = [np.polynomial.Polynomial.fit(at, values[:, k], degree, w=np.sqrt(weight)) for k in range(3)]
    knots = np.r_[[at[0]] * 3, at if at.size > 4 else [at[0], at[-1]], [at[-1]] * 3]
    sites = np.linspace(at[0], at[-1], 4 * knots.size)
    smooth = make_lsq_spline(sites, np.stack([p(sites) for p in trend], axis=1), knots)
    if at.size < 8:
        return smooth, np.inf, _tangent_u(at, values - smooth(at), np.inf, np.zeros((2, 3)), np.zeros((2, 3)))
    rest = values - smooth(at)
    if stiffness is None or not math.isfinite(stiffness):
        stiffness = _cross_validated(at, rest)
    wiggle = [make_smoothing_spline(at, rest[:, k], w=weight / weight.mean(), lam=stiffness) for k in range(3)]
    wave = BSpline(knots, np.stack([w.c for w in wiggle], axis=-1), 3)
    tangent_u = _tangent_u(at, rest - wave(at), stiffness, wave(at), wave(at, 1))
    return BSpline(knots, smooth.c + wave.c, 3), stiffness, tangent_u


def _tangent_u(at: Float, residuals: Float, stiffness: float, wave: Float, wave_slope: Float) -> float:
    """Standard uncertainty (rad) of the direction of a smoothing spline through points (n, 3) with these residuals.

    A smoothing spline is a kernel estimate of width h = (penalty * spacing)^(1/4) whose slope has the variance
    noise^2 spacing / (8 sqrt(2) h^3) (Silverman, Ann. Stat. 12, 1984); the cubic polynomial adds its own. Waves too
    small to tell whether part or robot made them count with their whole slope.
    """
    n, length = at.size, float(at[-1] - at[0])
    spacing = length / (n - 1)
    h = min((stiffness * spacing) ** 0.25, length)
    freedom = max(n - 4.0 - length / (2.0 * math.sqrt(2.0) * h), 0.3 * n)
    noise2 = float((residuals**2).sum()) / (2.0 * freedom)
    variance = noise2 * spacing / (8.0 * math.sqrt(2.0) * h**3) + 48.0 * noise2 / (n * length**2)
    if math.sqrt(float((wave**2).sum(axis=1).mean())) < SMALL_WAVE_MM:
        variance += 0.5 * float((wave_slope**2).sum(axis=1).mean())
    return math.sqrt(variance)


def _cross_validated(at: Float, values: Float) -> float:
    """Penalty on the squared second derivative (mm^3) of least generalised cross-validation error over values (n, 3).

    Exact for natural cubic splines (Green and Silverman, "Nonparametric Regression and Generalized Linear Models",
    1994, section 2.3), on at most GCV_BINS neighbouring bins.
    """
    start = max(0, (at.size - GCV_BINS) // 2)
    at, values = at[start : start + GCV_BINS], values[start : start + GCV_BINS]
    n, h = at.size, np.diff(at)
    q = np.zeros((n, n - 2))
    j = np.arange(n - 2)
    q[j, j], q[j + 1, j], q[j + 2, j] = 1.0 / h[:-1], -1.0 / h[:-1] - 1.0 / h[1:], 1.0 / h[1:]
    r = np.diag((h[:-1] + h[1:]) / 3.0) + np.diag(h[1:-1] / 6.0, 1) + np.diag(h[1:-1] / 6.0, -1)
    bend, modes = eigh(q @ np.linalg.solve(r, q.T))
    power = ((modes.T @ values) ** 2).sum(axis=1)
    bend = np.maximum(bend, 0.0)

    def score(log_stiffness: float) -> float:
        left = 1.0 - 1.0 / (1.0 + np.exp(log_stiffness) * bend)
        return float((left**2 * power).sum() / max(left.sum(), 1e-9) ** 2)

    finest = math.log(0.06 * float(np.median(h)) ** 3)  # below, the curve would run through every bin
    grid = np.linspace(finest, finest + 30.0, 16)
    best = grid[np.argmin([score(g) for g in grid])]
    refined = minimize_scalar(score, bounds=(max(best - 2.0, finest), best + 2.0), method="bounded")
    return float(np.exp(refined.x))


def with_frame(spline: BSpline, s: Float, stiffness: float, tangent_u: float) -> Curve:
    """The curve that a spline of arc length makes, its frame from a little before the first s to after the last."""
    stations = np.linspace(s.min() - 5.0, s.max() + 5.0, max(8, int(s.max() - s.min()) + 10))
    if stations.size > 2 * MOST_BINS:
        stations = np.linspace(stations[0], stations[-1], 2 * MOST_BINS)
    t = np.asarray(spline(stations, 1))
    t /= np.linalg.norm(t, axis=1, keepdims=True)
    position = np.asarray(spline(stations))
    a = np.empty_like(t)
    a[0] = np.eye(3)[np.argmin(np.abs(t[0]))]
    a[0] -= t[0] * (a[0] @ t[0])
    a[0] /= np.linalg.norm(a[0])
    for i in range(len(t) - 1):  # double reflection
        v1 = position[i + 1] - position[i]
        c1 = v1 @ v1
        ref = a[i] - (2.0 / c1) * (v1 @ a[i]) * v1
        tan = t[i] - (2.0 / c1) * (v1 @ t[i]) * v1
        v2 = t[i + 1] - tan
        c2 = v2 @ v2
        a[i + 1] = ref - (2.0 / c2) * (v2 @ ref) * v2 if c2 > 0 else ref
    return Curve(spline, stations, a, stiffness, tangent_u)
