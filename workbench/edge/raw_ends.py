"""The lower and the upper edge of a raw edge along m: where its end face ends, frame by frame and along the edge."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from workbench.artefacts import ROOT_FACE, Cloud
from workbench.edge.raw_faces import FaceEnds, RawFaces
from workbench.geometry.courses import FLAT, SHAPES, TOGETHER_MM, Course, fit_course
from workbench.geometry.curves import Curve
from workbench.geometry.end_posterior import end_at
from workbench.geometry.ends import Ends, SmoothEnd, fit_end
from workbench.geometry.sections import in_section
from workbench.geometry.settling import settled
from workbench.units import Bool, Float, Int

MIXED = 0.5  # probability that a mixed pixel stands in the place of the face's last return
ROUGH_SLOPE = 2.0  # slope of a rough face over its height, 1/mm: waves of some mm
SAMPLE_FRAMES = 60
SMOOTH_MM = 1.0  # a plate's surfaces are smooth: corners with them scatter by noise alone, frame by frame
COVERS = 0.9  # share of the edge that corners must show for silhouettes to be left aside
CELL_MM = 5.0
NEAR_MM = 1.0
LEAST_CORNERS = 20
PLACE_MM = 4.0  # distance of the places at which the posterior of a silhouette's end is taken
KNOTS_MM = (64.0, 32.0, 16.0)  # of the course along m: a plate's thickness hardly waves


@dataclass(frozen=True, slots=True, eq=False)
class PlacedEnds:
    """One end of the end face in N frames, in the section planes of a curve; NaN where not seen."""

    s: Float  # (N,) arc length, mm
    m: Float  # (N,) distance from the curve along the face, towards the upper side, mm
    step: Float  # (N,) the next column would meet the face this much further; 0: a corner
    sigma: Float  # (N,) noise of m, mm
    missing: Float  # (N,) probability that a column at the end has no return
    column: Float  # (N,) of the last return, counted outwards
    outward: float  # +1: the upper end, -1: the lower end


@dataclass(frozen=True, slots=True, eq=False)
class EndCourse:
    """One edge along the other: its distance from the reference curve along m."""

    used: Bool  # (N,) frames that it rests on
    outward: float
    course: Course
    residual: Float  # (n,) of the course
    s: Float  # (n,) of the course
    ends: Ends | None = None  # silhouettes: what the likelihood has to say
    likely: SmoothEnd | None = None
    shared_u: Float | None = None  # (n,) of the frames' own shift

    def at(self, s: Float) -> tuple[Float, Float]:
        """Distance along m and its standard uncertainty at arc lengths s (m,), mm."""
        if self.ends is None or self.likely is None:
            return self.course.spline(s)[:, 0], self.course.u(self.s, s, self.residual)
        first, last = self.ends.s[[0, -1]]
        places = np.linspace(s.min(), s.max(), max(3, int(np.ptp(s) / PLACE_MM)))
        value, u = end_at(self.ends, self.likely, np.clip(places, first, last))
        off = value - self.likely.spline(np.clip(places, first, last))
        good = np.isfinite(off)
        smooth = self.likely.spline(np.clip(s, first, last)) + np.interp(s, places[good], off[good])
        shared = 0.0 if self.shared_u is None else np.interp(s, self.s, self.shared_u)
        return self.outward * smooth, np.hypot(np.interp(s, places[good], u[good]), shared)

    def rough(self, s: Float) -> Float:
        """Distance along m at s (m,), mm, without the likelihood's own effort."""
        return np.asarray(self.course.spline(s)[:, 0])


def place_ends(cloud: Cloud, found: RawFaces, ends: FaceEnds, outward: float, curve: Curve, s_guess: Float,
               tilt: float, range_sigma_mm: float) -> PlacedEnds:  # fmt: skip
    """One end of the face in the section planes of `curve`."""
    here = np.isfinite(ends.point[:, 0]) & np.isfinite(s_guess)
    pose = cloud.base_from_profiler[here, :3]
    point = pose[:, :, 3] + ends.point[here, :1] * pose[:, :, 0] + ends.point[here, 1:] * pose[:, :, 2]
    s, place = in_section(point, curve, s_guess[here])
    _, a, b = curve.frame(s)
    m = np.cos(tilt) * a + np.sin(tilt) * b
    n = np.cos(tilt) * b - np.sin(tilt) * a
    slope = np.where(ends.corner, 0.0, ends.slope)[here, None]
    step = ends.pitch[here] * np.abs(((pose[:, :, 0] + slope * pose[:, :, 2]) * m).sum(axis=1))
    ray_m, ray_n = np.abs((pose[:, :, 2] * m).sum(axis=1)), np.abs((pose[:, :, 2] * n).sum(axis=1))
    face = found.faces[ROOT_FACE]
    rss = np.maximum(face.szz - face.sxz**2 / face.sxx, 0.0)[here]
    rough = np.sqrt(rss / face.count[here]) * ray_n  # height of the face's own roughness and noise
    # On a face that leans by its roughness the next column is that much nearer or farther.
    blur = np.hypot(range_sigma_mm * ray_m, step * ROUGH_SLOPE * rough * ray_m / ray_n / 4.0)
    out = np.full((5, here.size), np.nan)
    out[:, here] = (
        s,
        place @ [math.cos(tilt), math.sin(tilt)],
        step,
        blur,
        _missing(found, ends, cloud.pass_index)[here],
    )
    return PlacedEnds(out[0], out[1], out[2], np.maximum(out[3], 1e-3), out[4], ends.column, outward)


def _missing(found: RawFaces, ends: FaceEnds, pass_index: Int) -> Float:
    """Probability that a column at the face's end has no return (N,): as inside the face, MIXED at a mixed pixel."""
    face = found.faces[ROOT_FACE]
    share = np.full(face.count.shape, np.nan)
    for p in np.unique(pass_index):
        mine = (pass_index == p) & (face.count > 2)
        if mine.any():
            columns = (face.columns[mine, 1] - face.columns[mine, 0] + 1).sum()
            share[pass_index == p] = 1.0 - face.count[mine].sum() / columns
    return np.where(ends.alone, MIXED, np.clip(share, 0.02, 0.6))


@dataclass(frozen=True, slots=True, eq=False)
class FrameShift:
    """What shifts each frame as a whole along m (N,), mm: `known` by a corner, up to `u`; else of this `spread`."""

    known: Float
    u: Float
    spread: Float


def frame_shift(placed: tuple[PlacedEnds, PlacedEnds], vibration: Float) -> FrameShift:
    """How far each frame as a whole lies off along m; vibration (N,): how far frames may.

    A surface that joins the face is smooth, so what a frame's corner with it is off its course is the frame's own.
    """
    shift, u, spread = np.zeros(vibration.size), np.zeros(vibration.size), vibration.copy()
    for ends in placed:
        corner = np.isfinite(ends.m) & (ends.step == 0.0)
        if corner.sum() >= LEAST_CORNERS:
            s = ends.s[corner]
            course = fit_course(s, ends.m[corner, None], together_mm=SMOOTH_MM)
            off = ends.m[corner] - course.spline(s)[:, 0]
            shift[corner], u[corner], spread[corner] = off, course.u(s, s, off), 0.0
    return FrameShift(shift, u, spread)


def end_course(ends: PlacedEnds, shift: FrameShift, pass_index: Int, whole: bool) -> EndCourse:
    """The course of one edge: by its corners where they show enough of it, else by the silhouettes' likelihood.

    whole: False takes the silhouettes' middles instead, which is quick and half as good.
    """
    out, silhouette = ends.outward, ends.step > 0
    low = out * (ends.m - np.where(silhouette, shift.known, 0.0))
    sigma = np.hypot(ends.sigma, np.where(silhouette, shift.spread, 0.0))
    low, step, sigma, weight = settled(low, ends.step, sigma, np.where(silhouette, ends.column, 0).astype(np.int64),
                                       pass_index)  # fmt: skip
    mine = np.flatnonzero(np.isfinite(ends.m))
    alone, covered = _beyond_corners(ends.s[mine], ~silhouette[mine])
    if covered:
        mine = mine[~silhouette[mine] | alone]
    mine = mine[np.argsort(ends.s[mine], kind="stable")]
    corner = ~silhouette[mine]
    shapes, together_mm = (SHAPES, SMOOTH_MM) if covered else (FLAT, TOGETHER_MM)
    middle = out * (low + 0.5 * step)[mine]
    course = fit_course(ends.s[mine], middle[:, None], shapes, together_mm)
    residual = middle - course.spline(ends.s[mine])[:, 0]
    used, kept = np.zeros(ends.m.size, bool), course.kept | (covered & ~corner)
    used[mine[kept]] = True
    if covered:  # silhouettes that were left aside show the edge too
        used |= silhouette & np.isfinite(ends.m)
    found = EndCourse(used, out, course, residual, ends.s[mine])
    if not whole or corner.all():
        return found
    if corner.any():
        sigma[mine[corner]] = max(float(np.median(np.abs(residual[corner]))) / 0.6745, 1e-3)
    on = mine[kept]
    known = Ends(ends.s[on], low[on], step[on], sigma[on], ends.missing[on], weight[on])
    shared_u = np.where(corner, 0.0, shift.u[mine])
    return replace(found, ends=known, likely=fit_end(known, KNOTS_MM), shared_u=shared_u)


def _beyond_corners(s: Float, corner: Bool) -> tuple[Bool, bool]:
    """Which places s (k,) lie where no corner is near, and whether corners show (nearly) all of the edge."""
    if not corner.any():
        return ~corner, False
    cell, at = np.floor(s / CELL_MM), np.sort(s[corner])
    after = np.clip(np.searchsorted(at, s), 1, max(at.size - 1, 1))
    away = np.minimum(np.abs(s - at[after - 1]), np.abs(s - at[np.minimum(after, at.size - 1)]))
    return away > NEAR_MM, bool(np.unique(cell[corner]).size >= COVERS * np.unique(cell).size)


def range_noise(cloud: Cloud, found: RawFaces) -> float:
    """Standard deviation of the range noise on the end face, mm: from second differences, median over some frames."""
    face, values = found.faces[ROOT_FACE], []
    frames = np.flatnonzero(face.count >= 16)
    for i in frames[np.unique(np.linspace(0, frames.size - 1, SAMPLE_FRAMES).round().astype(int))]:
        first, last = face.columns[i]
        on = np.flatnonzero(found.labels[i, first : last + 1] == ROOT_FACE) + first
        line = face.z_mean[i] + face.sxz[i] / face.sxx[i] * (cloud.x_mm[i, on].astype(float) - face.x_mean[i])
        values.append(float(np.median(np.abs(np.diff(cloud.z_mm[i, on] - line, 2)))))
    return float(np.median(values)) / 0.6745 / math.sqrt(6.0)
