"""A raw edge from its end face: one smooth state along the edge, from what every frame says in the section plane.

The state (docs/method.md, section 6) is the lower edge c(s), the direction of the end face about it, how far the face
stands out, and the lower and the upper edge along it, each a `geometry.course`. All is measured relative to a reference
curve, which in the end is the lower edge itself. Roughness and vibration average out along the edge.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
import scipy

from workbench.artefacts import LOWER_SURFACE, ROOT_FACE, UPPER_SURFACE, Cloud
from workbench.edge.directions import near_slope, wrapped
from workbench.edge.form import NO_ROUNDING, FaceRim, Rounding, rounding_of
from workbench.edge.measure import check_advance, edge_direction
from workbench.edge.raw_faces import FaceEnds, RawFaces, middle_of, outward_of
from workbench.errors import InputError
from workbench.geometry.course import Course, fit_course
from workbench.geometry.curves import POSE_MM, Curve, along_motion, fit_curve
from workbench.geometry.sections import SectionLines, in_section, section_lines
from workbench.geometry.settling import settled
from workbench.geometry.silhouette import EndCourse, Ends, find_end
from workbench.units import Bool, Float, Int

MIXED = 0.5  # probability that a mixed pixel stands in the place of the face's last return
ROUGH_SLOPE = 2.0  # slope of a rough face over its height, 1/mm: waves of some mm
# Roughness within frames from which neighbouring frames share it, and their scatter is no course: what turns an end
# face of 8 mm by more than its u, and over the range noise by more than its estimate errs.
ROUGH_MM, ROUGH_SHARE = 0.003, 0.25
TOGETHER_MM = 10.0  # length over which the scatter of a rough face hangs together
RIM_MM, LEAST_GAP_MM = 2.0, 4.0  # frames this near to a hidden stretch (this long) may be hidden in part
LOCAL_MM = 20.0  # of edge, over which nothing proves a course straight
COVERS, CELL_MM = 0.9, 5.0  # share of the edge that corners must show, by stretches, for silhouettes to be left aside
SAMPLE_FRAMES = 60
ALONG_MM = 0.5  # between places at which the reference curve's bend along m is summed up


@dataclass(frozen=True, slots=True, eq=False)
class EndAlong:
    """The lower or the upper edge: its distance from the reference curve along m."""

    course: Course  # of its height: from where a straight line would run that the reference curve leaves by `bend`
    bend: scipy.interpolate.CubicSpline  # arc length -> mm
    s: Float  # (N,) arc length at which each frame shows it; NaN where it does not
    rounding: Rounding
    end: EndCourse | None  # by silhouettes; None: by corners alone

    def value(self, at: Float) -> Float:
        """Distance (k,) at arc lengths `at` (k,), mm."""
        return np.asarray(self.course.value(at) - self.bend(at))


@dataclass(frozen=True, slots=True, eq=False)
class RawMeasured:
    """The raw edge's state in the section planes of `curve`; N frames."""

    curve: Curve
    tilt: Course  # direction of the end face, from the lower to the upper side, against a of the curve's frame; rad
    stands_out_mm: Float  # (N,) of each frame's end face from the curve, along n
    stand_out: Course  # the same along the edge, mm
    lower: EndAlong
    upper: EndAlong
    lean: float  # turn from the end face to the direction of the upper surface into the plate; NaN: not seen; rad
    s_face: Float  # (N,) where each frame shows the end face, mm
    lever_mm: float  # from the lower edge to the middle of what is seen of the end face
    rough: bool
    pose_u_mm: float  # of a place over POSE_MM of edge, by how single frames scatter: robots' errors hang together
    local_turn_u: float  # of the end face's direction over LOCAL_MM of edge, by how single frames scatter, rad


def measure_raw_edge(cloud: Cloud, found: RawFaces) -> RawMeasured:
    """Estimate the state of a raw edge: starts from the faces' middles, repeats with the lower edge that this gives.

    Raises InputError where the frames do not run along an edge.
    """
    middle = middle_of(cloud, found.faces[ROOT_FACE])
    along = edge_direction(middle, np.cross(_upwards(cloud, found), outward_of(cloud, found)), cloud)
    seen = found.seen & np.isfinite(middle).all(axis=1) & np.isfinite(along).all(axis=1)
    check_advance(cloud, middle[seen])
    if (
        not (np.isfinite(found.lower.point[:, 0]) & seen).sum() > 3
        or not (np.isfinite(found.upper.point[:, 0]) & seen).sum() > 3
    ):
        raise InputError(
            cloud.source,
            "the end face is seen, but not both of its edges: is upper_side the direction "
            "from the lower to the upper side in the base?",
        )
    s = np.full(seen.size, np.nan)
    s[seen] = along_motion(middle[seen], along[seen], cloud.pass_index[seen])
    curve = fit_curve(middle[seen], s[seen], cloud.pass_index[seen])
    for whole in (False, True):
        s[seen] = curve.project(middle[seen], s[seen])
        state = _state(cloud, found, curve, s, whole)
        on = np.isfinite(state.lower.s) & np.isfinite(state.stands_out_mm)
        at = state.lower.s[on]
        points = curve.position(at) + _offset(state, at, on)
        curve = fit_curve(points, at, cloud.pass_index[on], None, TOGETHER_MM if state.rough else POSE_MM)
    s[seen] = curve.project(middle[seen], s[seen])
    return _state(cloud, found, curve, s, whole=True)


def axes(measured: RawMeasured, at: Float) -> tuple[Float, Float, Float]:
    """t, n and m (k, 3) at arc lengths `at` (k,) of the curve."""
    t, a, b = measured.curve.frame(at)
    tilt = measured.tilt.value(at)[:, None]
    m = np.cos(tilt) * a + np.sin(tilt) * b
    return t, np.cross(t, m), m


def _offset(state: RawMeasured, at: Float, on: Bool) -> Float:
    """From the reference curve to the lower edge (k, 3) at the arc lengths (k,) of the frames `on`."""
    _, n, m = axes(state, at)
    return state.stands_out_mm[on, None] * n + state.lower.value(at)[:, None] * m


def _state(cloud: Cloud, found: RawFaces, curve: Curve, s: Float, whole: bool) -> RawMeasured:
    """The state in the section planes of `curve`; whole: False takes the middles of the column steps for ends."""
    sigma = _range_noise(cloud, found)
    face = _lines(cloud, found, curve, s, sigma, ROOT_FACE)
    about = float(np.angle(np.nanmean(np.exp(1j * face.angle))))
    angle = about + wrapped(face.angle - about)
    mid = np.where(np.isfinite(face.s), face.s, 0.0)
    tilt = fit_course(face.s, angle, face.angle_variance, cloud.pass_index)
    # An oblique frame sees each point of the face at another arc length, where the face has turned (eq. (7)).
    n = _normal(tilt.value(mid))
    turn = face.run * tilt.slope(mid)
    angle = angle - turn * np.abs((face.place * np.stack([n[:, 1], -n[:, 0]], axis=1)).sum(axis=1))
    face = replace(face, place=face.place - (turn * face.spread)[:, None] * n)
    tilt = fit_course(face.s, angle, face.angle_variance, cloud.pass_index, stiffness=tilt.stiffness)
    n = _normal(tilt.value(mid))
    stand_out = (face.place * n).sum(axis=1)
    out = fit_course(face.s, stand_out, None, cloud.pass_index)
    rough = _roughness(found, sigma) > max(ROUGH_MM, ROUGH_SHARE * sigma)
    if rough:
        tilt = _rough_course(face.s, angle, cloud.pass_index)
        n = _normal(tilt.value(mid))
        stand_out = (face.place * n).sum(axis=1)
        out = _rough_course(face.s, stand_out, cloud.pass_index)
    m = np.stack([n[:, 1], -n[:, 0]], axis=1)
    vibration = _vibration(cloud, stand_out)
    placed = [_placed(cloud, found, ends, curve, s, tilt, sigma) for ends in (found.lower, found.upper)]
    bend = _bend(curve, tilt)
    lower = _end_along(cloud, found, found.lower, placed[0], bend, -1.0, vibration, rough, whole)
    upper = _end_along(cloud, found, found.upper, placed[1], bend, 1.0, vibration, rough, whole)
    lean = _lean(cloud, found, curve, s, tilt, sigma)
    lever = abs(float(np.nanmedian((face.place * m).sum(axis=1))))
    pitch = float(np.ptp(face.s[np.isfinite(face.s)])) / max(int(np.isfinite(face.s).sum()), 1)
    pose_u = math.sqrt(out.frame_factor * max(pitch / LOCAL_MM, POSE_MM / LOCAL_MM)) if not rough else 0.0
    turn_u = math.sqrt(float(np.nanmedian(face.angle_variance)) * tilt.frame_factor * pitch / LOCAL_MM)
    return RawMeasured(curve, tilt, stand_out, out, lower, upper, lean, face.s, lever, rough, pose_u, turn_u)


def _rough_course(s: Float, value: Float, pass_index: Int) -> Course:
    """The course of a value (N,) of a rough face: its scatter hangs together over centimetres, and is no course.

    What the face locally is off its course is in the uncertainty: the scatter of means over TOGETHER_MM.
    """
    on = np.isfinite(s) & np.isfinite(value)
    block = np.floor((s[on] - s[on].min()) / TOGETHER_MM).astype(np.int64)
    _, number = np.unique(block, return_inverse=True)
    count = np.bincount(number)
    trend = np.polyfit(s[on] - s[on].mean(), value[on], 1) if count.size > 3 else np.array([0.0, value[on].mean()])
    left = value[on] - np.polyval(trend, s[on] - s[on].mean())
    local = float(np.var(np.bincount(number, left) / count)) * count.size / max(count.size - 2.0, 1.0)
    variance = np.full(s.shape, max(local, 1e-12) * float(np.median(count)))
    course = fit_course(s, value, variance, pass_index, together_mm=TOGETHER_MM)
    return replace(course, variance=course.variance + local)


def _normal(tilt: Float) -> Float:
    """n (N, 2) in (a, b), m being at the angle `tilt`."""
    return np.stack([-np.sin(tilt), np.cos(tilt)], axis=1)


def _lines(cloud: Cloud, found: RawFaces, curve: Curve, s: Float, sigma: float, label: int) -> SectionLines:
    face = found.faces[label]
    return section_lines(
        face,
        near_slope(face, s, cloud.pass_index),
        cloud.base_from_profiler,
        found.side,
        np.full(s.size, sigma),
        curve,
        s,
    )


def _placed(
    cloud: Cloud, found: RawFaces, ends: FaceEnds, curve: Curve, s_guess: Float, tilt: Course, range_sigma_mm: float
) -> tuple[Float, Float, Float, Float, Float]:
    """One end of the face in the sections of `curve`: arc length, place along m, column step, noise, share missing."""
    here = np.isfinite(ends.point[:, 0]) & np.isfinite(s_guess)
    pose = cloud.base_from_profiler[here, :3]
    point = pose[:, :, 3] + ends.point[here, :1] * pose[:, :, 0] + ends.point[here, 1:] * pose[:, :, 2]
    s, place = in_section(point, curve, s_guess[here])
    _, a, b = curve.frame(s)
    angle = tilt.value(s)
    c, d = np.cos(angle)[:, None], np.sin(angle)[:, None]
    m, n = c * a + d * b, c * b - d * a
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
        place[:, 0] * c[:, 0] + place[:, 1] * d[:, 0],
        step,
        np.maximum(blur, 1e-3),
        _missing(found, ends, cloud.pass_index)[here],
    )
    return out[0], out[1], out[2], out[3], out[4]


def _bend(curve: Curve, tilt: Course) -> scipy.interpolate.CubicSpline:
    """How far the reference curve leaves a straight line along m, mm: what of it is the edge's is told by the ends.

    Else waves of the reference curve, which started from the middles of the face, would pass for the edge's.
    """
    at = np.arange(curve.spline.t[3] - ALONG_MM, curve.spline.t[-4] + 2.0 * ALONG_MM, ALONG_MM)
    _, a, b = curve.frame(at)
    angle = tilt.value(at)[:, None]
    curvature = (curve.curvature(at) * (np.cos(angle) * a + np.sin(angle) * b)).sum(axis=1)
    slope = scipy.integrate.cumulative_trapezoid(curvature, at, initial=0.0)
    bend = scipy.integrate.cumulative_trapezoid(slope - slope.mean(), at, initial=0.0)
    return scipy.interpolate.CubicSpline(at, bend - bend.mean())


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


def _end_along(
    cloud: Cloud,
    found: RawFaces,
    ends: FaceEnds,
    placed: tuple[Float, Float, Float, Float, Float],
    bend: scipy.interpolate.CubicSpline,
    outward: float,
    vibration: Float,
    rough: bool,
    whole: bool,
) -> EndAlong:
    """The course of one edge along m: by its corners where they show enough of it, else by the silhouettes too.

    A frame's own shift scatters its silhouette and its corner alike.
    """
    s, m, step, sigma, missing = placed
    m = m + bend(np.where(np.isfinite(s), s, 0.0))
    together = TOGETHER_MM if rough else None
    m = np.where(_at_rim(s), np.nan, m)
    silhouette = np.isfinite(m) & (step > 0)
    corner = np.isfinite(m) & (step == 0)
    use = corner | (silhouette if not _covered(s, corner) else _alone(s, corner, silhouette))
    spread = np.hypot(sigma, vibration)
    middle = np.where(use, outward * m + 0.5 * step, np.nan)
    if not (np.isfinite(middle) & np.isfinite(s)).any():
        raise InputError(cloud.source, "no frame shows where the end face ends: is upper_side right?")
    course = fit_course(s, middle, spread**2 + step**2 / 12.0, cloud.pass_index, (2, 3), together_mm=together)
    end: EndCourse | None = None
    if whole and (use & silhouette).any():
        column = np.where(silhouette, ends.column, 0).astype(np.int64)
        freed = settled(s, outward * m, step, spread, column, cloud.pass_index)
        on = np.flatnonzero(use & course.kept & np.isfinite(freed.low) & np.isfinite(freed.sigma))
        on = on[np.argsort(s[on], kind="stable")]
        unknown = np.full(on.size, np.nan)
        known = Ends(
            s[on],
            freed.low[on],
            freed.step[on],
            np.maximum(freed.sigma[on], 1e-3),
            missing[on],
            freed.weight[on],
            unknown,
            unknown,
            freed.doubt[on],
        )
        end = find_end(known, course, together, (2, 3))
        course = end.course
    rounding = NO_ROUNDING
    if whole and not rough and not _covered(s, corner):
        rounding = _rounding(cloud, found, ends, outward, silhouette)
        spline = course.spline
        course = replace(course, spline=scipy.interpolate.BSpline(spline.t, spline.c + rounding.beyond_mm, spline.k))
    return EndAlong(_scaled(course, outward), bend, np.where(np.isfinite(placed[1]), s, np.nan), rounding, end)


def _rounding(cloud: Cloud, found: RawFaces, ends: FaceEnds, outward: float, silhouette: Bool) -> Rounding:
    face = found.faces[ROOT_FACE]
    lean = np.hypot(1.0, face.sxz / face.sxx)
    here = silhouette & ~ends.alone & ~ends.burred
    rim = FaceRim(face, -outward * found.side, ends.point[:, 0], ends.pitch * lean, np.full(here.size, found.sense))
    return rounding_of(cloud, rim, here)


def _at_rim(s: Float) -> Bool:
    """Frames (N,) next to a hidden stretch: what hides it may stand before a part of the face there too."""
    seen = np.sort(s[np.isfinite(s)])
    gap = np.flatnonzero(np.diff(seen) > LEAST_GAP_MM)
    out = np.zeros(s.shape, bool)
    for before, after in zip(seen[gap], seen[gap + 1], strict=True):
        out |= (s > before - RIM_MM) & (s < after + RIM_MM)
    return out


def _scaled(course: Course, factor: float) -> Course:
    return replace(course, spline=scipy.interpolate.BSpline(course.spline.t, factor * course.spline.c, course.spline.k))


def _cells(s: Float, chosen: Bool) -> Int:
    return np.unique(np.floor(s[chosen] / CELL_MM).astype(np.int64))


def _covered(s: Float, corner: Bool) -> bool:
    """Do corners show (nearly) all of the edge?"""
    seen = np.isfinite(s)
    return bool(corner.any()) and _cells(s, corner).size >= COVERS * _cells(s, seen).size


def _alone(s: Float, corner: Bool, silhouette: Bool) -> Bool:
    """Silhouettes where no corner is near."""
    cell = np.full(s.shape, -(10**9), np.int64)
    cell[silhouette] = np.floor(s[silhouette] / CELL_MM).astype(np.int64)
    return silhouette & ~np.isin(cell, _cells(s, corner))


def _upwards(cloud: Cloud, found: RawFaces) -> Float:
    """Direction (N, 3) of the end face in each laser plane, from the lower to the upper side; NaN where not seen."""
    face = found.faces[ROOT_FACE]
    slope = (face.sxz / face.sxx)[:, None]
    ex, ez = cloud.base_from_profiler[:, :3, 0], cloud.base_from_profiler[:, :3, 2]
    return np.asarray(-found.side[:, None] * (ex + slope * ez) / np.hypot(1.0, slope))


def _vibration(cloud: Cloud, stand_out: Float) -> Float:
    """Standard deviation of what shifts each frame by itself (N,), pass by pass, from how the end face jumps; mm."""
    out = np.full(stand_out.shape, np.nan)
    for p in np.unique(cloud.pass_index):
        mine = np.flatnonzero((cloud.pass_index == p) & np.isfinite(stand_out))
        second = np.abs(np.diff(stand_out[mine], 2)) if mine.size > 2 else np.zeros(1)
        out[cloud.pass_index == p] = float(np.median(second)) / 0.6745 / math.sqrt(6.0)
    return out


def _roughness(found: RawFaces, sigma: float) -> float:
    """Height of the end face's roughness within frames, beyond the range noise, mm."""
    face = found.faces[ROOT_FACE]
    on = face.count > 5
    if not on.any():
        return 0.0
    rss = np.maximum(face.szz - face.sxz**2 / face.sxx, 0.0)[on] / (face.count[on] - 2)
    return math.sqrt(max(float(np.median(rss)) - sigma**2, 0.0))


def _range_noise(cloud: Cloud, found: RawFaces) -> float:
    """Range noise of single points, mm, from neighbouring columns: roughness is longer than a column."""
    frames = np.flatnonzero(found.seen)
    frames = frames[np.unique(np.linspace(0, frames.size - 1, SAMPLE_FRAMES).round().astype(int))]
    z = np.where(cloud.keep[frames] & (found.labels[frames] == ROOT_FACE), cloud.z_mm[frames], np.nan).astype(float)
    bend = np.abs(z[:, :-3] - 3.0 * z[:, 1:-2] + 3.0 * z[:, 2:-1] - z[:, 3:])
    bend = bend[np.isfinite(bend)]
    return max(float(np.median(bend)) / 0.6745 / math.sqrt(20.0), 1e-3) if bend.size else 0.02


def _lean(cloud: Cloud, found: RawFaces, curve: Curve, s: Float, tilt: Course, sigma: float) -> float:
    """Turn from the end face's direction to that of the upper surface, into the plate; NaN if it is never seen.

    Where only the lower surface is seen, the upper one is taken for parallel to it.
    """
    for label in (UPPER_SURFACE, LOWER_SURFACE):
        if (found.faces[label].count > 0).sum() >= 3:
            lines = _lines(cloud, found, curve, s, sigma, label)
            at = np.where(np.isfinite(lines.s), lines.s, 0.0)
            # A line has two senses; the plate lies at -n.
            turn = float(np.angle(np.nanmean(np.exp(2j * wrapped(lines.angle - tilt.value(at)))))) / 2.0
            return turn if math.sin(turn) < 0.0 else turn - math.pi
    return math.nan
