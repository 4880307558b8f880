"""A raw edge from its end face: one smooth state along the edge, from what every frame says in the section plane.

The state (docs/method.md, section 6) is the lower edge c(s), the direction of the end face about it, how far the face
stands out, and the lower and the upper edge along it, each a `geometry.course`. All is measured relative to a reference
curve, which in the end is the lower edge itself. Roughness and vibration average out along the edge.
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import scipy

from workbench.artefacts import LOWER_SURFACE, ROOT_FACE, UPPER_SURFACE, Cloud
from workbench.edge.broken_end import BrokenEnd, broken_end, weights, whole_end
from workbench.edge.directions import LOCAL_MM, TOGETHER_MM, go_together, near_slope, wrapped
from workbench.edge.drawn_end import HANGS
from workbench.edge.end_templates import EdgeCondition
from workbench.edge.frame_ends import missing_share
from workbench.edge.last_returns import FaceRim
from workbench.edge.measure import ASTRAY_MM, MOST_ROUNDS, check_advance, edge_direction
from workbench.edge.raw_faces import GAP_MM, FaceEnds, RawFaces, middle_of, outward_of
from workbench.edge.raw_local import local_mean
from workbench.edge.steps import readings
from workbench.errors import InputError
from workbench.geometry.along import between, by_pass, in_order, running_median
from workbench.geometry.blocks import evenly
from workbench.geometry.chains import FaceLines
from workbench.geometry.course import CHANCE, Course, fit_course, likely_processes
from workbench.geometry.curves import Curve, along_motion, curve_through, fit_curve
from workbench.geometry.end_face import MARGIN_MM
from workbench.geometry.fading import faded_columns
from workbench.geometry.grids import columns_to_next
from workbench.geometry.moves import within
from workbench.geometry.poses import in_planes
from workbench.geometry.processes import Process, Shared
from workbench.geometry.sections import SectionLines, in_section, section_lines
from workbench.geometry.silhouette import Ends, find_end, reached_mm, settled
from workbench.geometry.splines import Spline, through
from workbench.units import THIRD, TO_SD, Bool, Float, Int, Shaped

ROUGH_SLOPE = 2.0  # slope of a rough face over its height, 1/mm: waves of some mm
# Roughness within frames from which a face is its local plane: beyond texture, which bins average, and over the range
# noise by more than its estimate errs.
ROUGH_MM, ROUGH_SHARE = 0.02, 0.25
SHARED_MM = 0.003  # from here on it is, where directions of frames go together (`go_together`)
FEW_FRAMES = 20  # within 20 mm: the scatter of fewer differs by as much by chance
UNEVEN = 2.0  # times the usual scatter: of frames within 20 mm, which share their errors over 4, chance makes up to 1.7
COVERS, CELL_MM = 0.9, 5.0  # share of the edge that corners must show, by stretches, for silhouettes to be left aside
NEAR_MM, WIDE, HALF = 50.0, 0.9, 0.5  # an end face is nearly as wide as elsewhere on so much of it; else half hidden
SAMPLE_FRAMES = 60
# Errors of a robot's recorded positions, all alike likely before the frames are looked at: as robots have them.
STRENGTHS_MM, LENGTHS_MM = (0.005, 0.012, 0.03, 0.07), (1.5, 3.0, 6.0, 12.0, 24.0, 48.0)
LONG = 3  # so many of them may jerk: shorter ones look alike, jerking or not
BENT_MM = 0.3  # of an arc's middle from its chord: robots do not err so
ALONG_MM = 0.5  # between places at which the reference curve's bend along m is summed up


@dataclass(frozen=True, slots=True, eq=False)
class EndAlong:
    """The lower or the upper edge: its distance from the reference curve along m."""

    course: Course  # of its height: from where a straight line would run that the reference curve leaves by `bend`
    bend: Spline  # arc length -> mm
    s: Shaped[Float, " N"]  # arc length at which each frame shows it; NaN where it does not
    broken: BrokenEnd  # of the N frames
    reached_mm: Shaped[Float, " N"]  # by how much frames near each show the face beyond it
    step_mm: Shaped[Float, " k"]  # by which the edge itself may step at `course.at_mm`, outwards

    def value(self, at: Float) -> Float:
        """Distance (k,) at arc lengths `at` (k,), mm."""
        return np.asarray(self.course.value(at) - self.bend(at))


@dataclass(frozen=True, slots=True, eq=False)
class OutAlong:
    """How far the end face stands out of the reference curve, along n."""

    course: Course  # from where a straight line would run, as that of `EndAlong`
    bend: Spline
    local: Course | None  # of a rough face: its mean over LOCAL_MM, from the curve

    def value(self, at: Float) -> Float:
        """Distance (k,) at arc lengths `at` (k,), mm."""
        return self.smooth(at) if self.local is None else self.local.value(at)

    def smooth(self, at: Float) -> Float:
        """The same without what a rough face does there (k,), mm."""
        return np.asarray(self.course.value(at) - self.bend(at))

    def local_turn(self, robot: Robot, at: Float) -> tuple[Float, Float]:
        """By how much a rough face turns beside the course over LOCAL_MM about places (k,), with its u, rad.

        The robot's errors, any that are possible, turn its local means as well: what of the turns may be theirs is held
        back (Wiener's filter). By how the face stands out they are not told, as roughness does the same.
        """
        if self.local is None:
            return np.zeros(at.size), np.zeros(at.size)
        ends = np.clip(at + 0.5 * LOCAL_MM * np.array([[-1.0], [1.0]]), *self.local.spline.ends)
        (low, high), ways = self.local.value(ends) - self.smooth(ends), np.ptp(ends, axis=0)
        turn, u = (high - low) / ways, np.hypot(*self.local.u(ends)) / ways
        place = np.arange(0.5, 2.0 * LOCAL_MM)  # of both means, mm
        rise = np.sign(place - LOCAL_MM) / LOCAL_MM
        none = np.zeros(place.size)
        robots = [rise @ one.covariance(place, none, none.astype(np.int64)) @ rise for one in robot.possible]
        errors = np.mean(robots) / ways**2
        kept = np.maximum(1.0 - errors / max(float(np.mean(turn**2)), 1e-18), 0.0)
        return kept * turn, np.sqrt(u**2 + errors)


@dataclass(frozen=True, slots=True, eq=False)
class RawMeasured:
    """The raw edge's state in the section planes of `curve`; N frames."""

    curve: Curve
    tilt: Course  # direction of the end face, from the lower to the upper side, against a of the curve's frame; rad
    stands_out_mm: Shaped[Float, " N"]  # of each frame's end face from the curve, along n
    out: OutAlong  # the same along the edge
    lower: EndAlong
    upper: EndAlong
    lean: float  # turn from the end face to the direction of the upper surface into the plate; NaN: not seen; rad
    s_face: Shaped[Float, " N"]  # where each frame shows the end face, mm
    angle: Shaped[Float, " N"]  # its direction there, as `tilt` counts it, rad
    run: Shaped[Float, " N"]  # by how much the section advances along the edge per mm along the face
    bow: Shaped[Float, " N"]  # by which an oblique frame sees it bent along the range axis, times distance^2, 1/mm
    lever_mm: float  # from the lower edge to the middle of what is seen of the end face
    rough: bool
    local_turn_u: float  # of the end face's direction over LOCAL_MM of edge, by how single frames scatter, rad


class Robot(NamedTuple):
    """What is declared of the errors of recorded positions; None: not known."""

    noise_mm: float | None = None
    length_mm: float | None = None

    @property
    def usual_mm(self) -> float:
        """Their standard deviation, on average over what is held possible."""
        return math.sqrt(np.mean(np.square(STRENGTHS_MM))) if self.noise_mm is None else self.noise_mm

    @property
    def before(self) -> Shared:
        """What frames share, before any of them is looked at."""
        if self.noise_mm is None or self.length_mm is None:
            return Shared()
        return Shared(None, (Process(self.noise_mm, self.length_mm),), may_step=True)

    @property
    def possible(self) -> list[Process]:
        """Processes that they may be, before any frame is looked at: alike likely."""
        strengths = STRENGTHS_MM if self.noise_mm is None else (self.noise_mm,)
        lengths = LENGTHS_MM if self.length_mm is None else (self.length_mm,)
        smooth = [Process(strength, length) for strength in strengths for length in lengths]
        return [*smooth, *(one._replace(jerks=True) for one in smooth if one.length_mm in lengths[-LONG:])]

    def shared(self, s: Float, stand_out: Float, pass_index: Int) -> Shared:
        """What frames share: as declared, else by how the end faces (N,) of frames at s (N,) stand out, mm."""
        return Shared(None, likely_processes(s, stand_out, pass_index, self.possible), may_step=True)


def measure_raw_edge(cloud: Cloud, found: RawFaces, condition: EdgeCondition, robot: Robot) -> RawMeasured:
    """Estimate the state of a raw edge: starts from the faces' middles, repeats with the lower edge that this gives.

    Until it lies within ASTRAY_MM of the curve that it was measured from. A first look from the middles tells what the
    robot's errors may be, and is not followed: ends that are lost would bend the curve.

    condition: what is known of its edges before. robot: errors of its recorded positions, where they are declared.

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
    width = found.whole.widths_mm
    seen &= _as_wide(s, width, HALF)  # in a clamp's shadow neither of its ends is the face's
    s[~seen] = np.nan
    own = seen & _as_wide(s, width, WIDE)  # where a part of the face is hidden, so is its middle
    curve = fit_curve(middle[own], s[own], cloud.pass_index[own])
    shared = robot.before
    for k in range(MOST_ROUNDS + 1):
        s[seen] = curve.project(middle[seen], s[seen])
        state = _state(cloud, found, curve, s, k > 0, condition, shared)
        if k == 0:
            counted = state.stands_out_mm + state.out.bend(np.nan_to_num(state.s_face))
            shared = robot.shared(state.s_face, counted, cloud.pass_index)
            continue
        on = np.isfinite(state.lower.s) & np.isfinite(state.stands_out_mm)
        low = state.lower.s[on]
        if k > 1 and np.hypot(state.lower.value(low), state.out.smooth(low)).max() < ASTRAY_MM:
            break
        curve = curve_through(functools.partial(_lower_edge, state), low.min(), low.max())
    return state


def unevenness(measured: RawMeasured, at: Float) -> Float:
    """How many times more the frames' end faces scatter within LOCAL_MM of stations (k,) than on the whole, at least 1.

    By medians of squares; a part that begins to vibrate is known less there.
    """
    s = measured.s_face
    square = (measured.stands_out_mm - measured.out.value(np.nan_to_num(s))) ** 2
    on = np.flatnonzero(np.isfinite(s) & np.isfinite(square))
    if measured.rough or on.size < FEW_FRAMES or on.size * LOCAL_MM < FEW_FRAMES * float(np.ptp(s[on])):
        return np.ones(at.size)
    usual = max(float(np.median(square[on])), 1e-18)
    ratio = np.sqrt(running_median(s[on], square[on], at, 0.5 * LOCAL_MM) / usual)
    return np.where(ratio > UNEVEN, ratio, 1.0)


def axes(measured: RawMeasured, at: Float) -> tuple[Float, Float, Float]:
    """t, n and m (k, 3) at arc lengths `at` (k,) of the curve."""
    t, a, b = measured.curve.frame(at)
    tilt = measured.tilt.value(at)[:, None]
    m = np.cos(tilt) * a + np.sin(tilt) * b
    return t, np.cross(t, m), m


def _lower_edge(state: RawMeasured, at: Float) -> Float:
    """Places of the lower edge (k, 3) at arc lengths (k,) of the reference curve."""
    _, n, m = axes(state, at)
    offset = state.out.smooth(at)[:, None] * n + state.lower.value(at)[:, None] * m
    return state.curve.position(at) + offset


def _state(
    cloud: Cloud,
    found: RawFaces,
    curve: Curve,
    s: Float,
    whole: bool,
    condition: EdgeCondition,
    shared: Shared,
) -> RawMeasured:
    """The state in the section planes of `curve`; whole: False takes the middles of the column steps for ends.

    shared: what the frames share by the robot's errors.
    """
    sigma = _range_noise(cloud, found)
    face = _lines(cloud, found, found.faces[ROOT_FACE], curve, s, sigma)
    about = float(np.angle(np.nanmean(np.exp(1j * face.angle))))
    angle = about + wrapped(face.angle - about)
    mid = np.where(np.isfinite(face.s), face.s, 0.0)
    tilt = fit_course(face.s, angle, face.angle_variance, cloud.pass_index)
    face, angle = _straightened(face, angle, tilt, mid)
    tilt = fit_course(face.s, angle, face.angle_variance, cloud.pass_index, stiffness=tilt.stiffness)
    height = _roughness(found, sigma)
    rough = height > max(ROUGH_MM, ROUGH_SHARE * sigma)
    if not rough and height > max(SHARED_MM, ROUGH_SHARE * sigma):
        rough = go_together(face.s, angle, face.angle_variance, cloud.pass_index)
    if rough:
        face = _lines(cloud, found, found.whole, curve, s, sigma)
        mid = np.where(np.isfinite(face.s), face.s, 0.0)
        face = replace(face, s=np.where(_whole(found), face.s, np.nan))
        inner = local_mean(face.s, angle, cloud.pass_index)
        out = local_mean(face.s, (face.place * _normal(inner.value(mid))).sum(axis=1), cloud.pass_index)
        face, angle = _straightened(face, about + wrapped(face.angle - about), tilt, mid)
        tilt = _squared(local_mean(face.s, angle, cloud.pass_index), out, face)
        turn_mm = float(np.sqrt(np.mean((inner.value(tilt.at_mm) - tilt.value(tilt.at_mm)) ** 2) / MARGIN_MM))
    n = _normal(tilt.value(mid))
    stand_out = (face.place * n).sum(axis=1)
    bend_out, bend = (_bend(curve, tilt, along) for along in (0.5 * math.pi, 0.0))
    counted, group = stand_out + bend_out(mid), cloud.pass_index
    shared = shared._replace(over_mm=TOGETHER_MM) if rough else shared
    course = fit_course(face.s, counted, None, group, (2, 3), shared=shared)
    stands = OutAlong(course, bend_out, local_mean(face.s, stand_out, cloud.pass_index) if rough else None)
    m = np.stack([n[:, 1], -n[:, 0]], axis=1)
    vibration = _vibration(cloud, stand_out)
    sections = _Sections(curve, s, tilt, bend)
    both = [
        _side(cloud, found, ends, outward, sections, sigma, vibration)
        for ends, outward in ((found.lower, -1.0), (found.upper, 1.0))
    ]
    steady = shared._replace(may_step=False)  # ends may be lost: how the face stands out tells a robot's steps
    lower, upper = (_end_along(cloud, found, side, bend, steady, whole, condition) for side in both)
    if rough:
        tilt = _reaching(tilt, found, sigma, turn_mm, lower, upper)
    lean = _lean(cloud, found, curve, s, tilt, sigma)
    lever = abs(float(np.nanmedian((face.place * m).sum(axis=1))))
    pitch = float(np.ptp(face.s[np.isfinite(face.s)])) / max(int(np.isfinite(face.s).sum()), 1)
    turn_u = math.sqrt(float(np.nanmedian(face.angle_variance)) * tilt.frame_factor * pitch / LOCAL_MM)
    shown = face.s, angle, face.run, face.bow_in_range(tilt.slope(mid))
    return RawMeasured(curve, tilt, stand_out, stands, lower, upper, lean, *shown, lever, rough, turn_u)


def _straightened(face: SectionLines, angle: Float, tilt: Course, mid: Float) -> tuple[SectionLines, Float]:
    """Lines and directions (N,) of frames as the sections at their middles, mid (N,), have them.

    An oblique frame sees each point of the face at another arc length, where the face has turned (eq. (7)).
    """
    n = _normal(tilt.value(mid))
    turn = face.run * tilt.slope(mid)
    angle = angle - turn * np.abs((face.place * np.stack([n[:, 1], -n[:, 0]], axis=1)).sum(axis=1))
    return replace(face, place=face.place - (turn * face.spread)[:, None] * n), angle


def _squared(tilt: Course, stand_out: Course, face: SectionLines) -> Course:
    """Local means of the direction over rectangles of a rough face instead of the parallelograms of oblique frames."""
    run = between(face.s, face.run, tilt.at_mm)
    value = tilt.value(tilt.at_mm) - run * stand_out.slope(tilt.at_mm)
    return replace(tilt, spline=through(tilt.at_mm, value))


def _as_wide(s: Float, width: Float, share: float) -> Bool:
    """Frames (N,) at s (N,) mm that show more than a share of the end face that frames show within NEAR_MM."""
    at = np.arange(np.nanmin(s), np.nanmax(s) + CELL_MM, CELL_MM)
    most = scipy.ndimage.maximum_filter1d(running_median(s, width, at, CELL_MM), round(2 * NEAR_MM / CELL_MM) + 1)
    return np.asarray(width > share * np.interp(s, at, most))


def _whole(found: RawFaces) -> Bool:
    """Frames (N,) that show the end face as wide as most of them do."""
    width = found.whole.widths_mm
    with np.errstate(invalid="ignore"):
        return np.asarray(width > np.nanmedian(width) - MARGIN_MM)


def _reaching(tilt: Course, found: RawFaces, sigma: float, strip_u: float, lower: EndAlong, upper: EndAlong) -> Course:
    """The direction of a rough face, uncertain by how far the face reaches: to a column, and as single frames show.

    A strip of width e at both ends turns it by `strip_u` (rad, 1 mm) sqrt(e), a strip at one end that lies r off the
    line by 6 e r / w^2.
    """
    face = found.whole
    on = face.count > 0
    width = float(np.median(face.widths_mm[on]))
    strip = np.full(tilt.at_mm.size, float(np.median(width / face.count[on])))
    for end in (lower, upper):
        strip = np.hypot(strip, between(end.s, end.reached_mm, tilt.at_mm))
    strip = np.minimum(strip, width)
    turn = 6.0 * strip * _roughness(found, sigma) / width**2
    return replace(tilt, variance=tilt.variance + turn**2 + strip_u**2 * strip)


def _normal(tilt: Float) -> Float:
    """n (N, 2) in (a, b), m being at the angle `tilt`."""
    return np.stack([-np.sin(tilt), np.cos(tilt)], axis=1)


def _lines(cloud: Cloud, found: RawFaces, face: FaceLines, curve: Curve, s: Float, sigma: float) -> SectionLines:
    return section_lines(
        face,
        near_slope(face, s, cloud.pass_index),
        cloud.base_from_profiler,
        found.side,
        np.full(s.size, sigma),
        curve,
        s,
    )


@dataclass(frozen=True, slots=True, eq=False)
class _Side:
    """What N frames say of one end of the face, counted outwards from a straight line along the edge; NaN: nothing."""

    ends: FaceEnds
    outward: float  # -1: the lower end, which lies towards falling m
    s: Shaped[Float, " N"]  # arc length, mm
    low: Shaped[Float, " N"]  # the face reaches at least to here, mm
    step: Shaped[Float, " N"]  # and not beyond the next column, mm; 0 at a corner
    sigma: Shaped[Float, " N"]  # noise of low, the frame's own shift included, mm
    missing: Shaped[Float, " N"]  # probability that a column has no return
    fade: Shaped[Float, " N"]  # columns before the end over which returns become rare
    silhouette: Shaped[Bool, " N"]  # frames of which the last return is taken
    by_corners: bool  # corners show nearly all of it

    @property
    def middle(self) -> Float:
        """Middle (N,) of the column step, mm."""
        return self.low + 0.5 * self.step

    @property
    def variance(self) -> Float:
        """Variance (N,) of the middle."""
        return self.sigma**2 + self.step**2 / 12.0


class _Sections(NamedTuple):
    """Where the frames' sections stand, and what turns in them along the edge."""

    curve: Curve
    s: Shaped[Float, " N"]  # about where each frame meets it, mm
    tilt: Course  # direction of the face, rad
    bend: Spline  # of the face along m, mm


def _side(
    cloud: Cloud,
    found: RawFaces,
    ends: FaceEnds,
    outward: float,
    sections: _Sections,
    range_sigma_mm: float,
    vibration: Float,
) -> _Side:
    """One end of the face in the sections of `curve`: its corners where they show enough of it, else silhouettes too.

    A frame's own shift scatters its silhouette and its corner alike.
    """
    curve, s_guess, tilt, bend = sections
    here = np.isfinite(ends.point[:, 0]) & np.isfinite(s_guess)
    pose = cloud.base_from_profiler[here, :3]
    point = in_planes(cloud.base_from_profiler[here], *ends.point[here].T)
    s, place = in_section(point, curve, s_guess[here])
    _, a, b = curve.frame(s)
    angle = tilt.value(s)
    c, d = np.cos(angle)[:, None], np.sin(angle)[:, None]
    m, n = c * a + d * b, c * b - d * a
    slope = np.where(ends.corner, 0.0, ends.slope)[here, None]
    beyond = columns_to_next(cloud.z_mm, np.nan_to_num(ends.column[here]).astype(np.int64))
    step = beyond * ends.pitch[here] * np.abs(((pose[:, :, 0] + slope * pose[:, :, 2]) * m).sum(axis=1))
    ray_m, ray_n = np.abs((pose[:, :, 2] * m).sum(axis=1)), np.abs((pose[:, :, 2] * n).sum(axis=1))
    face = found.faces[ROOT_FACE]
    rough = np.sqrt(face.rss[here] / face.count[here]) * ray_n  # height of the face's own roughness and noise
    # On a face that leans by its roughness the next column is that much nearer or farther.
    blur = np.hypot(range_sigma_mm * ray_m, step * ROUGH_SLOPE * rough * ray_m / ray_n / 4.0)
    where, low, steps, noise, missing = np.full((5, here.size), np.nan)
    where[here], steps[here], noise[here] = s, step, np.maximum(blur, 1e-3)
    low[here] = outward * (place[:, 0] * c[:, 0] + place[:, 1] * d[:, 0] + bend(s))
    missing[here] = missing_share(face, ends.alone, cloud.pass_index)[here]
    silhouette, corner = np.isfinite(low) & (steps > 0), np.isfinite(low) & (steps == 0)
    by_corners = _covered(where, corner)
    used = np.zeros_like(silhouette) if by_corners else _alone(where, corner, silhouette)
    low[silhouette & ~used] = np.nan
    if not (np.isfinite(low) & np.isfinite(where)).any():
        raise InputError(
            cloud.source, "no frame shows where the end face ends: is upper_side right, are axes mirrored?"
        )
    where[~within(where, where[np.isfinite(where + low)], GAP_MM)] = np.nan
    low[~np.isfinite(where)] = np.nan
    column = np.where(silhouette, ends.column, 0).astype(np.int64)
    fade = faded_columns(cloud.z_mm, column, silhouette, cloud.pass_index)
    return _Side(ends, outward, where, low, steps, np.hypot(noise, vibration), missing, fade, used, by_corners)


def _bend(curve: Curve, tilt: Course, turn: float) -> Spline:
    """How far the reference curve leaves a straight line along m, or `turn` rad from it: the frames tell what is true.

    Else waves of the reference curve, which started from the middles of the face, would pass for the edge's.
    """
    at = np.arange(curve.spline.ends[0] - ALONG_MM, curve.spline.ends[1] + 2.0 * ALONG_MM, ALONG_MM)
    _, a, b = curve.frame(at)
    angle = tilt.value(at)[:, None] + turn
    curvature = (curve.curvature(at) * (np.cos(angle) * a + np.sin(angle) * b)).sum(axis=1)
    sagitta_mm = float(curvature.mean()) * (at[-1] - at[0]) ** 2 / 8.0
    arc = curvature.mean() * sagitta_mm**2 / (sagitta_mm**2 + BENT_MM**2)  # which no robot's errors make
    slope = _integral(curvature - arc)
    bend = _integral(slope - slope.mean())
    return through(at, bend - bend.mean())


def _integral(value: Float) -> Float:
    """From the first place on, of values (k,) every ALONG_MM."""
    return ALONG_MM * np.append(0.0, np.cumsum((value[:-1] + value[1:]) / 2))


def _found_end(
    side: _Side,
    pass_index: Int,
    orders: tuple[int, int],
    shared: Shared,
    whole: bool = True,
) -> tuple[Course, Float, Float]:
    """The end of the face along the edge, counted outwards; by how much frames near each (N,) reach beyond it.

    And by how much the edge itself surely leaves its course (k,), if it steps.
    """
    course = fit_course(side.s, side.middle, side.variance, pass_index, orders, shared=shared)
    if not whole or not (side.silhouette & np.isfinite(side.low)).any():
        return course, np.zeros(side.s.size), np.zeros(course.at_mm.size)
    side = replace(side, low=side.low - _apart(side, course, pass_index))
    column = np.where(side.silhouette, side.ends.column, 0).astype(np.int64)
    freed = settled(side.s, side.low, side.step, side.sigma, column, pass_index)
    on = in_order(np.where(course.kept, side.s, np.nan), freed.low, freed.sigma)
    known = Ends(
        side.s[on],
        freed.low[on],
        freed.step[on],
        np.maximum(freed.sigma[on], 1e-3),
        side.missing[on],
        side.fade[on],
        freed.weight[on],
        freed.doubt[on],
    )
    end = find_end(known, course, shared, orders)
    likeliest = max(shared.processes, key=lambda one: one.share, default=None)
    said = readings(end.s, end.middle, end.middle_u, end.course.at_mm, end.course, is_all=False, shared=likeliest)
    step = said.sure_step_mm(end.course)
    u = np.sqrt(said.u_mm**2 + course.between)  # `find_end` takes its frames for those of one pass
    end = replace(end, course=said.moved(end.course).doubted(u, said.turning_u_mm))
    low = np.where(side.silhouette, side.low, np.nan)
    reached = reached_mm(side.s, low, side.step, side.sigma, end.course, end.s)
    return end.course, np.interp(np.nan_to_num(side.s), end.s, reached), step


def _apart(side: _Side, course: Course, pass_index: Int) -> Float:
    """How far each pass lies beside the course of all (N,), mm, but for columns: these pass the end here and there."""
    off, left = np.zeros(side.s.size), side.middle - course.value(side.s)
    for mine in by_pass(pass_index, np.isfinite(left)):
        middle, by_columns = float(np.median(left[mine])), float(np.mean(side.step[mine] ** 2)) / 12.0
        off[mine] = middle * max(1.0 - CHANCE**2 * by_columns / max(middle**2, 1e-12), 0.0)
    return off


def _end_along(
    cloud: Cloud,
    found: RawFaces,
    side: _Side,
    bend: Spline,
    shared: Shared,
    whole: bool,
    condition: EdgeCondition,
) -> EndAlong:
    """The course of one edge along m."""
    broken = whole_end(side.s.size)
    if whole and not side.by_corners:
        broken = _broken(cloud, found, side, condition)
        if shared.over_mm:  # depths of a rough face may feign one
            feigned = np.hypot(broken.beyond_mm, broken.u_mm)
            broken = replace(broken, beyond_mm=np.zeros(feigned.size), u_mm=feigned, size_mm=0.0)
        side = replace(
            side,
            low=side.low + broken.beyond_mm,
            sigma=side.sigma / np.sqrt(np.maximum(weights(side.s, broken.doubt_mm), 1e-6)),
        )
    course, reached, step = _found_end(side, cloud.pass_index, (2, 3), shared, whole)
    return EndAlong(_scaled(course, side.outward), bend, side.s, broken, reached, step)


def _broken(cloud: Cloud, found: RawFaces, side: _Side, condition: EdgeCondition) -> BrokenEnd:
    """What the last returns of silhouettes hide of the edge; a pass's frames with burrs are as its others."""
    face, ends = found.faces[ROOT_FACE], side.ends
    here = side.silhouette & ~ends.alone & ~ends.burred
    sense = np.full(here.size, found.sense)
    rim = FaceRim(face, -side.outward * found.side, ends.point[:, 0], ends.pitch * face.lean, sense, on_line=False)
    broken = broken_end(cloud, rim, here, condition)
    if broken.drawn is not None:
        edge, u = broken.drawn.edge(HANGS)
        broken = replace(broken, beyond_mm=broken.beyond_mm + edge, hidden_u_mm=np.hypot(broken.hidden_u_mm, u))
    likewise = {name: getattr(broken, name).copy() for name in ("beyond_mm", "u_mm", "hidden_u_mm")}
    for p in np.unique(cloud.pass_index[here]):
        of_pass = here & (cloud.pass_index == p)
        for value in likewise.values():
            value[side.silhouette & ~here & (cloud.pass_index == p)] = np.nanmedian(value[of_pass])
    return replace(broken, **likewise)


def _scaled(course: Course, factor: float) -> Course:
    return replace(course, spline=Spline(course.spline.t, factor * course.spline.c, course.spline.k))


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
    slope = face.slope[:, None]
    ex, ez = cloud.base_from_profiler[:, :3, 0], cloud.base_from_profiler[:, :3, 2]
    return np.asarray(-found.side[:, None] * (ex + slope * ez) / np.hypot(1.0, slope))


def _vibration(cloud: Cloud, stand_out: Float) -> Float:
    """Standard deviation of what shifts each frame by itself (N,), pass by pass, from how the end face jumps; mm."""
    out = np.full(stand_out.shape, np.nan)
    for mine in by_pass(cloud.pass_index):
        known = stand_out[mine][np.isfinite(stand_out[mine])]
        second = np.abs(np.diff(known, 2)) if known.size > 2 else np.zeros(1)
        out[mine] = float(np.median(second)) * TO_SD / math.sqrt(6.0)
    return out


def _roughness(found: RawFaces, sigma: float) -> float:
    """Height of the end face's roughness within frames, square to it, beyond the range noise, mm."""
    face = found.faces[ROOT_FACE]
    on = face.count > 5
    if not on.any():
        return 0.0
    height2 = float(np.median(face.rss[on] / (face.count[on] - 2))) - sigma**2
    return math.sqrt(max(height2, 0.0)) / float(np.median(face.lean[on]))


def _range_noise(cloud: Cloud, found: RawFaces) -> float:
    """Range noise of single points, mm, from neighbouring columns: roughness is longer than a column."""
    frames = np.flatnonzero(found.seen)
    frames = frames[evenly(frames.size, SAMPLE_FRAMES)]
    z = np.where(cloud.keep[frames] & (found.labels[frames] == ROOT_FACE), cloud.z_mm[frames], np.nan).astype(float)
    bend = np.abs(z[:, :-3] - 3.0 * z[:, 1:-2] + 3.0 * z[:, 2:-1] - z[:, 3:])
    bend = bend[np.isfinite(bend)]
    return max(float(np.median(bend)) * TO_SD / THIRD, 1e-3) if bend.size else 0.02


def _lean(cloud: Cloud, found: RawFaces, curve: Curve, s: Float, tilt: Course, sigma: float) -> float:
    """Turn from the end face's direction to that of the upper surface, into the plate; NaN if it is never seen.

    Where only the lower surface is seen, the upper one is taken for parallel to it.
    """
    for label in (UPPER_SURFACE, LOWER_SURFACE):
        if (found.faces[label].count > 0).sum() >= 3:
            lines = _lines(cloud, found, found.faces[label], curve, s, sigma)
            at = np.where(np.isfinite(lines.s), lines.s, 0.0)
            # A line has two senses; the plate lies at -n.
            turn = float(np.angle(np.nanmean(np.exp(2j * wrapped(lines.angle - tilt.value(at)))))) / 2.0
            return turn if math.sin(turn) < 0.0 else turn - math.pi
    return math.nan
