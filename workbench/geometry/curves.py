"""A smooth space curve through measured points: position, tangent, curvature, a frame that does not twist, gaps."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import scipy

from workbench.geometry.along import by_pass
from workbench.geometry.blocks import as_input
from workbench.geometry.course import Course, fit_course, stretches
from workbench.geometry.poses import unit
from workbench.geometry.processes import Process, Shared
from workbench.geometry.splines import Spline, derivatives, piece_of, through
from workbench.kernels import kernel
from workbench.units import Bool, Float, Int, Shaped

POSE_MM = 4.0  # longer than the errors of a robot's pose hang together, so that they average like noise
BLOCK_MM = 4.0  # of motion, averaged for the rough course
ACROSS = math.sqrt(1.5)  # points scatter about a curve in two of three components: none of it lies along the curve
# Steps to a point's foot; a curve that bends towards the point as a circle about it has none.
NEWTON, LEAST_SLOPE = 3, 0.2
DOUBTFUL = 2.0  # times the robot's noise: waves of less rms may as well be the robot's path as the part's
LEAST_GAP_MM = 1.5  # frames this near to each other leave no gap between them
GAP_PITCHES = 4.0  # nor do frames within this many of their usual distances


@dataclass(frozen=True, slots=True, eq=False)
class Curve:
    """A space curve c(s), s its arc length in mm, with a rotation-minimising frame (t, a, b), b = t x a.

    A vector at a constant angle from `a` keeps its angle to the plane of a plane curve, and to any fixed direction
    on a straight one (Wang et al., "Computation of rotation minimizing frames", ACM TOG 27, 2008).
    """

    spline: Spline  # s -> position (3), mm
    stations_mm: Shaped[Float, " k"]  # evenly spaced, where the frame was computed
    references: Shaped[Float, "k 3"]  # a at the stations
    course: Course | None  # of the points that it was fitted to; None: it is known

    def position(self, s: Float) -> Float:
        """c(s), (n, 3) mm; beyond the ends of what it was fitted to it goes straight on."""
        return self.spline.straight_on(s)

    def tangent(self, s: Float) -> Float:
        """Unit tangent t, (n, 3)."""
        return unit(self.spline(np.clip(s, *self.spline.ends), 1))

    def u(self, s: Float) -> Float:
        """Standard uncertainty (n,) of the position across the tangent, each way, mm: of what the points show."""
        if self.course is None:
            return np.zeros(np.shape(s))
        return ACROSS * self.course.u(np.asarray(s) + self.course.spline.t[0] - self.spline.t[0])

    def tangent_u(self, s: Float) -> Float:
        """Standard uncertainty (n,) of the tangent's direction, each way, rad: of what the points show."""
        if self.course is None:
            return np.zeros(np.shape(s))
        shift = self.course.spline.t[0] - self.spline.t[0]
        return ACROSS * self.course.slope_u(np.asarray(s) + shift)

    def curvature(self, s: Float) -> Float:
        """Curvature vector dt/ds, (n, 3) 1/mm; 0 beyond the ends."""
        inside = np.clip(s, *self.spline.ends)
        d1, d2 = self.spline(inside, 1), self.spline(inside, 2)
        speed2 = (d1 * d1).sum(-1, keepdims=True)
        bend = (d2 - d1 * (d1 * d2).sum(-1, keepdims=True) / speed2) / speed2
        return np.where((s == inside)[..., None], bend, 0.0)

    def frame(self, s: Float) -> tuple[Float, Float, Float]:
        """(t, a, b), each (n, 3) unit, right-handed and not twisting along the curve."""
        at = np.asarray(s, dtype=float)
        out = np.empty((3, at.size, 3))
        _frames(*self.compiled, as_input(at.reshape(-1)), out)
        t, a, b = out.reshape(3, *at.shape, 3)
        return t, a, b

    @property
    def compiled(self) -> tuple[Float, Float, Float, Float]:
        """As kernels take it: breaks and powers of the pieces, first and last station, references."""
        pieces = self.spline.pieces
        return pieces.breaks, pieces.powers, as_input(self.stations_mm[[0, -1]]), as_input(self.references)

    def project(self, points_mm: Float, s: Float) -> Float:
        """Arc length (n,) of the feet of points (n, 3) mm, by Newton steps from the guess s."""
        out = np.empty(len(s))
        _project(*self.compiled[:2], as_input(points_mm), as_input(s), out)
        return out


@kernel
def foot(breaks: Float, powers: Float, x: float, y: float, z: float, s: float) -> float:
    """Arc length of the foot of a point on the curve that goes straight on beyond its ends."""
    for _ in range(NEWTON):
        inside = min(max(s, breaks[0]), breaks[-1])
        i = piece_of(breaks, inside)
        u, beyond = inside - breaks[i], s - inside
        x0, x1, x2 = derivatives(powers, i, 0, u)
        y0, y1, y2 = derivatives(powers, i, 1, u)
        z0, z1, z2 = derivatives(powers, i, 2, u)
        dx, dy, dz = x - x0 - beyond * x1, y - y0 - beyond * y1, z - z0 - beyond * z1
        slope = x1 * x1 + y1 * y1 + z1 * z1
        if beyond == 0.0:
            slope -= dx * x2 + dy * y2 + dz * z2
        s += (dx * x1 + dy * y1 + dz * z1) / (slope if slope > LEAST_SLOPE else 1.0)
    return s


@kernel
def _project(breaks: Float, powers: Float, points: Float, guess: Float, out: Float) -> None:
    for m in range(out.size):
        out[m] = foot(breaks, powers, points[m, 0], points[m, 1], points[m, 2], guess[m])


@kernel
def frame_at(breaks: Float, powers: Float, limits: Float, references: Float, s: float, out: Float) -> None:
    """Fill t, a, b (3, 3) at s; limits (2,): first and last of the evenly spaced stations of the references."""
    inside = min(max(s, breaks[0]), breaks[-1])
    i = piece_of(breaks, inside)
    place = (min(max(s, limits[0]), limits[1]) - limits[0]) / (limits[1] - limits[0]) * (references.shape[0] - 1)
    k = max(min(int(place), references.shape[0] - 2), 0)
    share = place - k
    size2 = along = 0.0
    for d in range(3):
        out[0, d] = derivatives(powers, i, d, inside - breaks[i])[1]
        out[1, d] = (1.0 - share) * references[k, d] + share * references[k + 1, d]
        size2 += out[0, d] * out[0, d]
        along += out[0, d] * out[1, d]
    left = 0.0
    for d in range(3):
        out[1, d] -= out[0, d] * along / size2
        left += out[1, d] * out[1, d]
    for d in range(3):
        out[0, d] /= math.sqrt(size2)
        out[1, d] /= math.sqrt(left)
    for d in range(3):
        e, f = (d + 1) % 3, (d + 2) % 3
        out[2, d] = out[0, e] * out[1, f] - out[0, f] * out[1, e]


@kernel
def _frames(breaks: Float, powers: Float, limits: Float, references: Float, s: Float, out: Float) -> None:
    one = np.empty((3, 3))
    for m in range(s.size):
        frame_at(breaks, powers, limits, references, s[m], one)
        for k in range(3):
            for d in range(3):
                out[k, m, d] = one[k, d]


def along_motion(points_mm: Float, tangent: Float, group: Int) -> Float:
    """A rough arc length (n,) mm for each of n points (n, 3), in order of time, that passes measured along one edge.

    What counts is the motion along the edge's own direction (n, 3) there: a pass may bend, close, stop and reverse.
    The longest pass lays down the course; the others are placed on it and on each other, the nearest first.
    """
    s = np.zeros(len(points_mm))
    passes = by_pass(group)
    for mine in passes:
        if mine.size > 1:
            ahead = tangent[mine[1:]] + tangent[mine[:-1]]
            ahead /= np.maximum(np.linalg.norm(ahead, axis=1, keepdims=True), 1e-9)
            s[mine[1:]] = np.cumsum((np.diff(points_mm[mine], axis=0) * ahead).sum(axis=1))
    longest = max(passes, key=lambda mine: float(np.ptp(s[mine])))
    placed, rest = longest, [mine for mine in passes if mine is not longest]
    while rest:
        course_s, course = _course(s[placed], points_mm[placed])
        apart, nearest = zip(*map(scipy.spatial.cKDTree(course).query, (points_mm[mine] for mine in rest)), strict=True)
        k = int(np.argmin([one.min() for one in apart]))
        mine, near = rest.pop(k), apart[k] < apart[k].min() + BLOCK_MM
        beside, at = mine[near], nearest[k][near]
        further = ((points_mm[beside] - course[at]) * tangent[beside]).sum(axis=1)
        s[mine] += np.median(course_s[at] + further - s[beside])
        placed = np.concatenate([placed, mine])
    return np.asarray(s - s.min())


def _course(s: Float, points: Float) -> tuple[Float, Float]:
    """Mean arc length and place of the points of each block of motion."""
    _, number = np.unique(stretches(s, BLOCK_MM), return_inverse=True)
    count = np.bincount(number)
    return np.bincount(number, s) / count, np.stack([np.bincount(number, p) / count for p in points.T], axis=1)


DENSE, LEAST_PLACES = 8, 5  # places on each piece of a spline; steps between places that make a curve
ENDLESS = 10.0  # times the points' own way: longer is a curve that swings between points that lie on none


def fit_curve(
    points_mm: Float,
    s: Float,
    group: Int | None = None,
    stiffness: tuple[Float, ...] | None = None,
) -> Curve:
    """The smooth curve through points (n, 3) mm at rough arc lengths s (n,); s of the result is arc length from 0.

    The course of the points (`geometry.course`): straight but for a bend and waves, as stiff as the points say.

    Raises LinAlgError: they lie along no smooth curve.
    """
    for _ in range(2):  # the spline's own parameter becomes its arc length
        course = fit_course(s, points_mm, None, group, (2, 3), stiffness, shared=Shared(POSE_MM))
        stiffness = course.stiffness
        dense, arc = _arc_length(course.spline)
        s = Curve(course.spline, dense, np.zeros((dense.size, 3)), None).project(points_mm, s)  # at its foot
        s = np.interp(s, dense, arc) + np.minimum(s - dense[0], 0.0) + np.maximum(s - dense[-1], 0.0)
    course = fit_course(s, points_mm, None, group, (2, 3), stiffness, shared=Shared(POSE_MM))
    return with_frame(course.spline, s, course)


def curve_through(places: Callable[[Float], Float], first: float, last: float) -> Curve:
    """The curve through places (n, 3) mm of courses, from a first to a last rough arc length: none is a stray."""
    s = np.linspace(first, last, max(math.ceil((last - first) / POSE_MM), LEAST_PLACES) + 1)
    points_mm = places(s)
    for _ in range(2):
        s = np.interp(s, *_arc_length(through(s, points_mm)))
    return with_frame(through(s, points_mm), s)


def _arc_length(spline: Spline) -> tuple[Float, Float]:
    """Places (n,) on a spline by its own parameter, and their arc lengths (n,) from its beginning."""
    dense = np.linspace(*spline.ends, DENSE * (spline.t.size - 7) + 1)
    speed = np.linalg.norm(spline(dense, 1), axis=1)
    arc = np.concatenate([[0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1]) * np.diff(dense))])
    if arc[-1] > ENDLESS * (dense[-1] - dense[0]):
        raise np.linalg.LinAlgError(f"a curve through {dense[-1] - dense[0]:.0f} mm would be {arc[-1]:.0f} mm long")
    return dense, arc


def with_frame(spline: Spline, s: Float, course: Course | None = None) -> Curve:
    """The curve that a spline of arc length makes, its frame from a little before the first s to after the last."""
    stations = np.linspace(s.min() - 5.0, s.max() + 5.0, max(8, int(s.max() - s.min()) + 10))
    bare = Curve(spline, stations, np.zeros((stations.size, 3)), course)
    t, position = bare.tangent(stations), bare.position(stations)
    a = np.zeros_like(t)
    a[0, np.argmin(np.abs(t[0]))] = 1.0
    a[0] -= t[0] * (a[0] @ t[0])
    a[0] /= np.linalg.norm(a[0])
    _reflect_on(as_input(t), as_input(position), a)
    return replace(bare, references=a)


@kernel
def _reflect_on(t: Float, position: Float, a: Float) -> None:
    """Fill a (n, 3) from its first row on by double reflection, t and position (n, 3) given."""
    for i in range(len(t) - 1):
        c1 = d1 = e1 = 0.0
        for d in range(3):
            v1 = position[i + 1, d] - position[i, d]
            c1, d1, e1 = c1 + v1 * v1, d1 + v1 * a[i, d], e1 + v1 * t[i, d]
        c2 = d2 = 0.0
        for d in range(3):
            v1 = position[i + 1, d] - position[i, d]
            a[i + 1, d] = a[i, d] - 2.0 / c1 * d1 * v1
            v2 = t[i + 1, d] - t[i, d] + 2.0 / c1 * e1 * v1
            c2, d2 = c2 + v2 * v2, d2 + v2 * a[i + 1, d]
        for d in range(3):
            v1 = position[i + 1, d] - position[i, d]
            v2 = t[i + 1, d] - t[i, d] + 2.0 / c1 * e1 * v1
            if c2 > 0.0:
                a[i + 1, d] -= 2.0 / c2 * d2 * v2


def turn_by_robot(curve: Curve, length_mm: float, robot_noise_mm: float, robot_length_mm: float | None) -> float:
    """Standard uncertainty (rad) of the direction of a curve by the robot's errors, white or as a process of its way.

    length_mm: of the edge. Errors of a declared length turn what the course can follow of them (FOLLOWED_MM).
    """
    if robot_length_mm is not None:
        return Process(robot_noise_mm, robot_length_mm).slope_u(FOLLOWED_MM)
    return math.hypot(math.sqrt(2.0) * robot_noise_mm / length_mm, doubtful_slope(curve, robot_noise_mm))


FOLLOWED_MM = 8.0  # two bins of an edge's course


def doubtful_slope(curve: Curve, robot_noise_mm: float) -> float:
    """Rms slope (rad) of waves of the edge that may as well be the robot's path as the part's; 0: they are the part's.

    What a cubic polynomial leaves of the curve, if its rms is below DOUBTFUL times the robot's noise on each axis.
    """
    s = np.linspace(*curve.spline.ends, 200)
    line = np.polynomial.Polynomial
    span = [line.fit(s, p, 3) for p in curve.position(s).T]
    wave = np.stack([p - f(s) for p, f in zip(curve.position(s).T, span, strict=True)], axis=1)
    if np.sqrt((wave**2).sum(axis=1).mean()) > DOUBTFUL * robot_noise_mm:
        return 0.0
    slope = np.gradient(wave, s, axis=0)
    return float(np.sqrt(0.5 * (slope**2).sum(axis=1).mean()))


def covered(s_frames: Float, pass_index: Int, at: Float) -> Bool:
    """Was the edge measured at the places `at` (m,), by any pass? s_frames (N,) mm, NaN where not seen."""
    out = np.zeros(at.shape, bool)
    for mine in by_pass(pass_index, np.isfinite(s_frames)):
        s = np.sort(s_frames[mine])
        if s.size < 2:
            continue
        steps = np.diff(s)
        widest = max(LEAST_GAP_MM, GAP_PITCHES * float(np.median(steps)))
        after = np.clip(np.searchsorted(s, at), 1, s.size - 1)
        inside = (at >= s[0] - 1e-6) & (at <= s[-1] + 1e-6)
        out |= inside & (steps[after - 1] <= widest)
    return out
