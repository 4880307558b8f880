"""What straight lines leave of the faces: bows, ghosts and patterns of the sensor, and a rounded end of the root face.

A single frame does not show them under its noise. Its residuals, pooled by their place on the face over many frames,
do (docs/method.md, section 4).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from workbench.artefacts import BEVEL_FACE, ROOT_FACE, Cloud
from workbench.checks.sensor import column_pitch_mm
from workbench.edge.faces import TrackedFaces
from workbench.geometry.blocks import as_input
from workbench.geometry.chains import FaceLines
from workbench.geometry.end_face import BROKEN_MM
from workbench.geometry.medians import median, row_medians
from workbench.kernels import kernel
from workbench.units import AnyArray, Bool, Float, Float32, Int, Shaped

SAMPLE_FRAMES = 480  # evenly over the recording
ASIDE_FRAMES = 120
# Differences of neighbouring returns on a face that tell two levels: how many at least; strays, times their median and
# their standard deviation; by how much less peaked than noise, and by how many of its standard deviations.
LEAST_PAIRS, STRAY_PAIRS, SIGMA_PAIRS, SETTLE_PAIRS, LEAST_EXCESS, SURE_EXCESS = 1000, 9.0, 5.0, 3, 0.05, 4.0
STRETCH_MM = 40.0  # of edge, whose frames are pooled
PLACES = 9  # on a face, from its upper to its lower end
LEAST_FRAMES, FEW_FRAMES = 20, 3  # in a stretch, which is as long as it takes; with fewer in all nothing is known
# A misfit of rms e that lasts, such as a sensor's own error over its columns, is taken for a random walk along the
# face: of such, a straight line turns by sqrt(18) e over the face's width, and lies off at its ends by sqrt(2) e.
TURN, OFFSET = 4.2, 1.4
# Scatter of rms e counts as three independent errors on the face.
SCATTER_TURN, SCATTER_OFFSET = 2.1, 1.2
GRAZING = 3.0  # times the noise of the other face: more is no noise of grazing rays
# A rounded end: the last returns of the root face, each alone, then pooled, how sure their depth must be, and what is
# taken for possible.
LAST, OUTSIDE_MM, DEEP_MM, LEAST_GROUPS = 10, BROKEN_MM, 3.0, 5
STILL = 3.0  # columns: where the end moves by less over the pass, its place within one is not all places in turn
ANYWHERE: Float = (np.arange(20.0)[None] + 0.5) / 20.0  # (1, 20) places of the end within a column, all of them in turn
SOMEWHERE: Float = (np.arange(6.0)[:, None] + 0.5) / 6.0  # (6, 1) one of them, unknown
PLACE_MM, TURN_MM, BOW_MM = 0.3, 0.3, 0.05  # by which the line and a bow may lie off the face without a rounding
PROOF, DEPTH_U_MM, LEAST_MEANS = 3.0, 0.0005, 8
LEAST_RADIUS_MM, HIDDEN_RADIUS_MM, MOST_RADIUS_MM, RADII = 0.005, 0.5, 2.0, 35
INCIDENCES = np.radians(np.arange(56.0, 90.0, 4.0))  # greatest angle of incidence at which a return is kept
MOST_HIDDEN = 0.95  # of roundings that the view does not show: what 2 u holds
UNSEEN_INCIDENCE = math.radians(65.0)  # where no rounding is seen: deep returns of one may go with the stray ones
CHAMFERS = np.radians(np.arange(10.0, 80.0, 2.5))  # by which a chamfer turns from the face
SEEN_MOST = 0.9  # of the frames, in which a face is seen no farther
STEP_COLUMNS = 3  # of a surface beside the face's line: fewer are mixed pixels, and the blur of its end
STEP_MM = 0.15  # between columns of one surface
SHAPE, FLAT = 0.15, 0.05  # of a depth: a rounding need be no quarter circle; and a chamfer not flat
MISFIT, ODD_MM = 5.0, 0.002  # standard deviations of a group's depth; by which the last columns' are off anyway


@dataclass(frozen=True, slots=True, eq=False)
class Form:
    """Misfit of both faces at m places of the edge."""

    root_turn_u: Shaped[Float, " m"]  # standard uncertainty of the root face's direction by its form, rad
    bevel_turn_u: Shaped[Float, " m"]  # the same of the bevel face
    # of the distance from their corner to the end of the root face, by the form of both
    corner_u_mm: Shaped[Float, " m"]


@dataclass(frozen=True, slots=True)
class Rounding:
    """The rounded or chamfered lower end of the root face; radius 0: none is seen."""

    radius_mm: float = 0.0  # or the height of a chamfer
    beyond_mm: float = 0.0  # of the virtual edge, from where the returns on the line end
    u_mm: float = 0.0
    rim_mm: float = 0.0  # of the root face before its last return on the line, that is rounded


NO_ROUNDING = Rounding()


def form_of(
    cloud: Cloud, tracked: TrackedFaces, s_frames: Float, beta: Float, at: Float, rounding: Rounding = NO_ROUNDING
) -> Form:
    """Misfit along the edge; s_frames (N,): where each frame shows it, at (m,): places, beta (m,): bevel angle, rad.

    The columns at the faces' ends count: what they see of something else turns the line of a narrow face. But the rim
    of a root face that is rounded: its line leaves that out, and what it hides is in `rounding`.
    """
    whole = rounding.radius_mm == 0.0
    root = misfit_of(cloud, tracked.labels, tracked.faces[ROOT_FACE], ROOT_FACE, s_frames, at, whole)
    bevel = misfit_of(cloud, tracked.labels, tracked.faces[BEVEL_FACE], BEVEL_FACE, s_frames, at, whole=True)
    sigma = np.nanmedian(tracked.range_sigma_mm[tracked.seen], axis=0)
    rough = [max(sigma[k] ** 2 - (GRAZING * sigma[3 - k]) ** 2, 0.0) ** 0.5 for k in (2, 1)]  # root face, bevel face
    root, bevel = (scattered(one, e) for one, e in zip((root, bevel), rough, strict=True))
    face = tracked.faces[ROOT_FACE]
    steep = float(np.nanmedian(np.abs(face.sxz / face.sxx)))  # the end comes along the rays onto the line
    corner = np.hypot(root.offset_u_mm * (1.0 / np.abs(np.tan(beta)) + steep), bevel.offset_u_mm / np.sin(beta))
    return Form(root.turn_u, bevel.turn_u, corner)


def aside_mm(cloud: Cloud, labels: AnyArray, face: FaceLines, label: int) -> float:
    """How far most returns of a face lie beside its line, mm, for certain: second returns of some columns draw it off.

    The median over frames of that of their residuals; as many lie on both sides where nothing but noise scatters them,
    or where half of the columns have them (`levels_mm`).
    """
    frames = np.flatnonzero(face.count > LEAST_FRAMES)
    frames = (
        frames[np.unique(np.linspace(0, frames.size - 1, ASIDE_FRAMES).astype(np.int64))] if frames.size else frames
    )
    if frames.size < LEAST_FRAMES:
        return 0.0
    slope = (face.sxz[frames] / face.sxx[frames])[:, None]
    off = cloud.z_mm[frames] - face.z_mean[frames, None] - slope * (cloud.x_mm[frames] - face.x_mean[frames, None])
    on = (labels[frames] == label) & cloud.keep[frames]
    off = np.where(on, off / np.hypot(1.0, slope), np.nan)
    middles = row_medians(off)
    middle = float(np.median(middles))
    u = 1.2533 * float(np.median(np.abs(middles - middle))) / 0.6745 / math.sqrt(frames.size)
    return max(abs(middle) if abs(middle) > PROOF * u else 0.0, 0.5 * levels_mm(off))


def levels_mm(off: Float) -> float:
    """How far apart two levels lie between which the residuals (f, M) of a face alternate at random, mm; 0: on one.

    Neighbours then differ by nothing or by all of that: their differences have fewer small and fewer large values than
    noise, which no form of the face changes. Of levels d apart, as many on each, the fourth cumulant is -d^4 / 4.
    """
    apart = np.diff(off, axis=1)
    apart = apart[np.isfinite(apart)]
    if apart.size < LEAST_PAIRS:
        return 0.0
    apart = apart[np.abs(apart) < STRAY_PAIRS * median(np.abs(apart))]
    for _ in range(SETTLE_PAIRS):
        apart = apart[np.abs(apart) < SIGMA_PAIRS * float(apart.std())]
    square = float((apart**2).mean())
    excess = float((apart**4).mean()) / max(square**2, 1e-30) - 3.0
    if excess > -LEAST_EXCESS - SURE_EXCESS * math.sqrt(48.0 / apart.size):  # neighbours share a value
        return 0.0
    return float((-4.0 * excess * square**2) ** 0.25)


def scattered(misfit: Misfit, rms: float) -> Misfit:
    """The misfit with that of points which scatter by `rms` (mm) more than any noise of the other face explains."""
    return replace(
        misfit,
        turn_u=np.hypot(misfit.turn_u, SCATTER_TURN * rms / misfit.width_mm),
        offset_u_mm=np.hypot(misfit.offset_u_mm, SCATTER_OFFSET * rms),
    )


def _sample(s_frames: Float, face: FaceLines) -> Int:
    on = np.flatnonzero(np.isfinite(s_frames) & (face.count > 5))
    return on[np.unique(np.linspace(0, on.size - 1, SAMPLE_FRAMES).round().astype(np.int64))] if on.size else on


@dataclass(frozen=True, slots=True, eq=False)
class Misfit:
    """What the straight line of one face leaves, at m places of the edge."""

    turn_u: Shaped[Float, " m"]  # standard uncertainty of the face's direction, rad
    offset_u_mm: Shaped[Float, " m"]  # of its ends, across the face
    width_mm: float


def misfit_of(
    cloud: Cloud,
    labels: AnyArray,
    face: FaceLines,
    label: int,
    s_frames: Float,
    at: Float,
    whole: bool = False,
    together_mm: float = 0.0,
) -> Misfit:
    """The misfit of the face with this label in `labels` (N, M) of the cloud; s_frames (N,), at (m,): arc lengths, mm.

    whole: with the columns at its ends, which may see half of something else: it pulls the line, and turns it little.
    together_mm: length over which frames share what they leave (a rough face): they count as one, and what lasts
    along the whole edge is told.
    """
    square, bow, width = _left(cloud, labels, face, label, s_frames, at, whole, together_mm)
    rest = np.maximum(square - bow**2 / 5.0, 0.0)
    turn = np.sqrt(TURN**2 * rest + SCATTER_TURN**2 * bow**2 / 5.0)
    return Misfit(turn / width, np.sqrt(OFFSET**2 * rest + bow**2), width)


def _left(
    cloud: Cloud,
    labels: AnyArray,
    face: FaceLines,
    label: int,
    s_frames: Float,
    at: Float,
    whole: bool,
    together_mm: float,
) -> tuple[Float, Float, float]:
    """What the line leaves beyond noise: mean square (m,) mm^2, at its ends by a bow (m,) mm; the face's width, mm."""
    frames = _sample(s_frames, face)
    if frames.size < FEW_FRAMES:
        return np.zeros(at.size), np.zeros(at.size), 1.0
    slope = face.sxz[frames] / face.sxx[frames]
    lean = np.hypot(1.0, slope)
    on = (labels[frames] == label) & cloud.keep[frames]
    column = np.flatnonzero(on.any(axis=0))  # of the rest nothing is asked
    if not column.size:
        return np.zeros(at.size), np.zeros(at.size), 1.0
    column = np.arange(column[0], column[-1] + 1)
    on = on[:, column[0] : column[-1] + 1]
    if not whole:  # the points of its line
        on &= (column >= face.columns[frames, :1]) & (column <= face.columns[frames, 1:])
    here = frames[:, None], column[None, :]
    x = np.where(on, cloud.x_mm[here], np.nan).astype(float)
    off = cloud.z_mm[here] - face.z_mean[frames, None] - slope[:, None] * (x - face.x_mean[frames, None])
    off = off / lean[:, None]
    first, last = np.nanmin(x, axis=1), np.nanmax(x, axis=1)
    if not whole:
        off[(x <= first[:, None]) | (x >= last[:, None])] = np.nan
    place = np.minimum((x - first[:, None]) / np.maximum(last - first, 1e-9)[:, None] * PLACES, PLACES - 1e-9)
    width = float(np.median((last - first) * lean))
    wide = max(1, round(float(np.median(on.sum(axis=1))) / PLACES))
    column = np.broadcast_to(column // wide, x.shape)
    s = s_frames[frames]
    enough_mm = 1.5 * LEAST_FRAMES * float(np.ptp(s)) / frames.size  # long edges and frames far apart
    stretch_mm = max(STRETCH_MM, enough_mm) if together_mm == 0.0 else np.inf
    stretch = np.floor((s - s.min()) / stretch_mm).astype(np.int64)
    unit = np.arange(s.size) if together_mm == 0.0 else np.floor((s - s.min()) / together_mm).astype(np.int64)
    value, ends, middle = [], [], []
    for k in np.unique(stretch):
        mine = stretch == k
        if mine.sum() < min(LEAST_FRAMES, frames.size):
            continue
        value.append(max(_excess(off[mine], where[mine], unit[mine]) for where in (place, column)))
        ends.append(_bow(off[mine], place[mine], unit[mine]))
        middle.append(float(s[mine].mean()))
    if not value:
        return np.zeros(at.size), np.zeros(at.size), width
    return np.interp(at, middle, value), np.interp(at, middle, ends), width


def _bow(off: Float, place: Float, unit: Int | None = None) -> float:
    """How far the ends of a face lie off its line by a bow, mm: of residuals (f, M) at places (f, M), by a parabola.

    Only as far as the units (f,) show it beyond their scatter.
    """
    t = 2.0 * place / PLACES - 1.0
    shape = np.where(np.isfinite(off), 1.5 * t**2 - 0.5, 0.0)  # 1 at the ends, its mean square 1 / 5
    ends = (np.nan_to_num(off) * shape).sum(axis=1) / np.maximum((shape**2).sum(axis=1), 1e-9)
    number = np.arange(len(off)) if unit is None else np.unique(unit, return_inverse=True)[1]
    ends = np.bincount(number, ends) / np.bincount(number)
    mean, noise = float(ends.mean()), float(ends.var()) / max(ends.size - 1, 1)
    return math.sqrt(max(mean**2 - 2.0 * noise, 0.0))


def _excess(off: Float, place: Float, unit: Int | None = None) -> float:
    """Mean square of residuals (f, M), pooled by `place` (f, M), beyond what the scatter of units (f,) makes of it.

    unit: frames that share their residuals; None: each is one.
    """
    seen = np.isfinite(off)
    if not seen.any():
        return 0.0
    frame, _ = np.nonzero(seen)
    number = place[seen].astype(np.int64)
    number -= number.min()
    places = int(number.max()) + 1
    unit = np.arange(len(off)) if unit is None else np.unique(unit, return_inverse=True)[1]
    units = int(unit.max()) + 1
    key = unit[frame] * places + number
    count = np.bincount(key, minlength=units * places).reshape(units, places)
    total = np.bincount(key, off[seen], minlength=units * places).reshape(units, places)
    mean = np.where(count > 0, total / np.maximum(count, 1), np.nan)
    frames = (count > 0).sum(axis=0)
    common = frames > min(0.5 * LEAST_FRAMES, 0.5 * units)
    if not common.any():
        return 0.0
    frames, mean = frames[common], mean[:, common]
    pooled = np.nanmean(mean, axis=0)
    noise = np.nanvar(mean, axis=0) / (frames - 1)
    share = frames / frames.sum()
    free = PLACES - 2  # two of the places' freedom went into the line
    shown = float(share @ (pooled**2 - noise)) * PLACES / free
    shown -= 2.0 * float(share @ noise) / math.sqrt(PLACES)
    return max(shown, 0.0) * free / (free - 2)  # so few places know a variance no better (Student)


@dataclass(frozen=True, slots=True, eq=False)
class FaceRim:
    """The free end of a face in each of N frames."""

    face: FaceLines
    side: Shaped[Float, " N"]  # +1 or -1: the end lies towards rising side * x
    end_x_mm: Shaped[Float, " N"]  # x of the last return on the face's line
    step_mm: Shaped[Float, " N"]  # between columns, along the face
    sense: Shaped[Float, " N"]  # +1: z counts away from the sensor
    on_line: bool  # where that return's ray meets the line, the end is told; False: at the return


def root_rim(tracked: TrackedFaces) -> FaceRim:
    """The lower end of a milled edge's root face."""
    root, bevel = tracked.faces[ROOT_FACE], tracked.faces[BEVEL_FACE]
    sense = np.sign(tracked.side * (root.sxz / root.sxx - bevel.sxz / bevel.sxx))  # they meet in a convex corner
    return FaceRim(root, tracked.side, tracked.root_end[:, 0], tracked.root_end[:, 2], sense, True)


def is_free_end(tracked: TrackedFaces) -> Bool:
    """Frames (N,) in which nothing but its own edge ends the root face.

    A return between it and what lies behind it is mostly far off its line; one that is not may be of a rounding.
    """
    return tracked.seen & ~(tracked.end_is_cut | tracked.end_is_burred | tracked.end_is_corner)


def rounding_of(cloud: Cloud, rim: FaceRim, here: Bool, most_mm: float = HIDDEN_RADIUS_MM) -> Rounding:
    """The rounding of a face's free end, by the pass that shows it best, in the frames `here` (N,).

    most_mm: greatest radius that is declared for one that the view does not show.
    """
    passes = np.unique(cloud.pass_index[here])
    found = [_rounding_of_pass(cloud, rim, here & (cloud.pass_index == p), most_mm) for p in passes]
    known = [one for one in found if one is not NO_ROUNDING]
    return min(known, key=lambda one: (one.radius_mm == 0.0, one.u_mm), default=NO_ROUNDING)


def _rounding_of_pass(cloud: Cloud, rim: FaceRim, here: Bool, most_mm: float) -> Rounding:
    """The same of one pass, from how deep the face's last returns lie under its line.

    On a quarter circle of radius R that leaves the line, returns are seen up to where its normal stands at the greatest
    angle of incidence that the sensor still returns (eq. (12)); a chamfer is seen to its end (eq. (12a)) or not at all.
    All are averaged over what the depths allow: before, the edge is as likely sharp as rounded or chamfered, and sizes
    of all orders are alike likely. Where the rays graze the face, a rounding leaves the view before it leaves the line,
    and only its u tells of it: the root mean square of what they hide, and 2 u no less than what 95 % of roundings do,
    all sizes to `most_mm` alike likely. So it is where the part lies still in the view, for all of a rounding may lie
    between two columns.
    """
    face = rim.face
    frames = _sample(np.where(here, 0.0, np.nan), face)
    is_narrow = frames.size < LEAST_FRAMES  # too few frames, or columns on the face: nothing is known of its end
    frames = np.flatnonzero(here & (face.sxx > 0.0)) if is_narrow else frames
    if not frames.size:
        return NO_ROUNDING
    step = float(np.median(rim.step_mm[frames]))
    slope = float(np.median(np.abs(face.sxz[frames] / face.sxx[frames])))
    width = float(np.median(np.sqrt(12.0 * face.sxx[frames] / face.count[frames]))) * math.hypot(1.0, slope)
    edges = _groups(min(width, DEEP_MM) / step)
    slopes = face.sxz[frames] / face.sxx[frames]
    of_line = [face.x_mean[frames], face.z_mean[frames], slopes, rim.side[frames], rim.end_x_mm[frames]]
    of_line += [rim.step_mm[frames], rim.sense[frames]]
    depth, last = np.full((frames.size, edges.size - 1), np.nan), np.full((frames.size, 2), np.nan)
    x, z, keep = (as_input(of[frames]) for of in (cloud.x_mm, cloud.z_mm, cloud.keep))
    _last_returns(x, z, keep, as_input(np.stack(of_line, axis=1)), as_input(edges), depth, last)
    depth = _between(depth)
    mostly = np.append(np.isfinite(depth).mean(axis=0) > 0.5, False)
    depth = depth[:, : int(mostly.argmin())]
    depth = depth[np.isfinite(depth).all(axis=1)]
    is_shown = not is_narrow and len(depth) >= LEAST_FRAMES and depth.shape[1] >= LEAST_GROUPS
    edges = edges[: depth.shape[1] + 1] if is_shown else edges[:LEAST_GROUPS]
    known = _known_depths(depth, edges * step) if is_shown else _nothing_known(edges.size - 1)
    moved = float(np.diff(np.percentile(rim.end_x_mm[frames], [5.0, 95.0]))[0]) * math.hypot(1.0, slope) / step
    phases: Float = ANYWHERE if moved > STILL else SOMEWHERE
    inclination = math.atan(slope)
    told = _broken_edge(known, edges * step, inclination, INCIDENCES, phases)
    odd = _odd_columns(known, told.fall_mm) * step
    goes_on = _goes_on_columns(last[:, 0]) * step
    if odd > 0.0 or not told.is_proven:  # one that would not show is in u; so is an end that is neither sharp nor round
        shown = told.beyond_mm if told.is_proven else 0.0
        seen = INCIDENCES[INCIDENCES > UNSEEN_INCIDENCE]
        unseen = _broken_edge(known, edges * step, inclination, seen, phases, most_mm)
        hidden = max(0.5 * unseen.hides_mm, math.hypot(unseen.beyond_mm, unseen.beyond_u_mm))
        return Rounding(u_mm=math.hypot(hidden, shown, odd, goes_on))
    further, further_u = _further(last[:, 0])  # returns beyond those on the line
    if not rim.on_line:  # a return under the line lies that much farther along the face
        further -= float(np.nanmean(last[:, 1])) * slope / step
    on = told.fall_mm[0] > PROOF * np.sqrt(np.diag(known.noise))
    rounded = float(np.diff(edges)[on].sum()) * step / math.hypot(1.0, slope)
    u_mm = math.hypot(math.hypot(told.beyond_u_mm, SHAPE * told.beyond_mm), further_u * step)
    return Rounding(told.size_mm, further * step + told.beyond_mm, u_mm, rounded)


def _between(depth: Float) -> Float:
    """Depths (f, g) with what a frame does not show between two groups that it does: its returns may lie at the limits
    of the groups, one by one on this side or that.
    """
    beside = 0.5 * (depth[:, :-2] + depth[:, 2:])
    return np.concatenate([depth[:, :1], np.where(np.isnan(depth[:, 1:-1]), beside, depth[:, 1:-1]), depth[:, -1:]], 1)


def _further(beyond: Float) -> tuple[float, float]:
    """How many columns a face is seen beyond its line, by the returns there in f frames (f,), and its u.

    On average, where none is lost; with the last ones lost here and there, by a mixed pixel, nearly as many as most.
    Which return is the last one on the line is a matter of noise, where it falls off slowly: the end of the line by all
    frames may be that of a few.
    """
    mean, most = float(beyond.mean()), float(np.quantile(beyond, SEEN_MOST))
    return 0.5 * (mean + most), math.hypot(0.5 * (most - mean), float(beyond.std()))


def _goes_on_columns(beyond: Float) -> float:
    """How many columns beyond a face's line returns go on beside it, in f frames (f,), that no rounding explains."""
    usual = float(np.median(beyond))
    return usual if usual >= STEP_COLUMNS else 0.0


def _odd_columns(known: Depths, fall: Float) -> int:
    """How many of the last columns may be no part of the face: 0, if a rounding explains all; fall (2, g), and its u.

    Sharp or round, an end leaves no more than noise. What a sensor's filter makes of it may lie above the line, where
    no rounding lies, and yet be likelier by the widest of roundings than by none.
    """
    left = known.mean - fall[0]
    covariance = known.noise + known.free + np.diag(fall[1] ** 2 + ODD_MM**2)
    lower = np.linalg.cholesky(covariance[::-1, ::-1])  # each group by what the face before it tells
    if np.abs(np.linalg.solve(lower, left[::-1])).max() < MISFIT:
        return 0
    off = np.abs(left) > PROOF * np.sqrt(np.diag(known.noise))
    return int(np.argmin(off)) if not off.all() else off.size


def _groups(columns: float) -> Float:
    """Limits (g + 1,), in columns before the last return, of what is pooled: LAST columns each alone, then tenths."""
    if columns < LAST:  # beyond them lies the next face
        return np.arange(max(math.floor(columns), 1) + 1.0)
    wide = max(1.0, (columns - LAST) / 10.0)
    return np.concatenate([np.arange(LAST), np.arange(LAST, columns + 1e-9, wide)])


@kernel
def _one_surface(along: Float, below: Float, order: Int, step: float, fallen: float) -> tuple[float, float]:
    """How many returns go on in one surface, without gap of columns or jump, from an end `fallen` deep; how far."""
    reach, level, further = 0.0, fallen, 0
    for j in order:
        if along[j] - reach > 2.2 * step or abs(below[j] - level) > STEP_MM + 2.0 * level:
            break
        further += 1
        reach, level = along[j], max(below[j], 0.0)
    return float(further), reach


@kernel
def _group_of(place: float, edges: Float) -> int:
    """Number of the group between `edges` (g + 1,) in which a place lies; -1 before them."""
    group = -1
    while group + 1 < edges.size and edges[group + 1] <= place:
        group += 1
    return group


@kernel
def _last_returns(x: Float32, z: Float32, keep: Bool, known: Float, edges: Float, depth: Float, last: Float) -> None:
    """Fill depth (f, g): mean depths under the line of f frames' returns, by how many columns they lie before the last.

    known (f, 7): x and z of the line's middle, its slope, side, end, step and sense of a FaceRim. last (f, 2): how many
    lie beyond those on the line, and how deep the last of these lies under it.
    """
    columns = x.shape[1]
    along, below, order = np.empty(columns), np.empty(columns), np.empty(columns, np.int64)
    for i in range(x.shape[0]):
        middle_x, middle_z, slope, side = known[i, 0], known[i, 1], known[i, 2], known[i, 3]
        end, step, sense = known[i, 4], known[i, 5], known[i, 6]
        lean = math.sqrt(1.0 + slope * slope)
        outside = 0
        for j in range(columns):
            xj, zj = np.float64(x[i, j]), np.float64(z[i, j])
            along[j] = side * (xj - end) * lean
            below[j] = (zj - middle_z - slope * (xj - middle_x)) / lean * sense
            if keep[i, j] and abs(along[j]) <= 1e-6:
                last[i, 1] = below[j]
            if keep[i, j] and 1e-6 < along[j] < OUTSIDE_MM:
                k = outside
                while k > 0 and along[order[k - 1]] > along[j]:
                    order[k] = order[k - 1]
                    k -= 1
                order[k] = j
                outside += 1
        # Where the end is told on a rounding, what falls to it and what follows it lie deep.
        fallen = last[i, 1] if last[i, 1] > 0.0 else 0.0
        deep = STEP_MM + fallen
        last[i, 0], reach = _one_surface(along, below, order[:outside], step, fallen)
        total, count = np.zeros(edges.size - 1), np.zeros(edges.size - 1)
        for j in range(columns):
            on_line = -edges[-1] * step < along[j] <= 1e-6
            on_line &= -STEP_MM < below[j] < (deep if along[j] > -LAST * step else STEP_MM)
            if keep[i, j] and (on_line or 1e-6 < along[j] <= reach):
                group = _group_of((reach - along[j]) / step + 0.5, edges)
                if 0 <= group < total.size:
                    total[group] += below[j]
                    count[group] += 1.0
        for group in range(total.size):
            if count[group] > 0.0:
                depth[i, group] = total[group] / count[group]


@dataclass(frozen=True, slots=True, eq=False)
class Depths:
    """What the last returns of a face lie under its line, by groups of columns from the last one on."""

    mean: Shaped[Float, " g"]  # mm
    noise: Shaped[Float, "g g"]  # covariance by noise and what patterns of the sensor may feign
    # covariance of what says nothing of a rounding: the line's own place and turn, and a bow
    free: Shaped[Float, "g g"]


def _known_depths(depth: Float, edges_mm: Float) -> Depths:
    """Of depths (f, g) of frames, between the limits (g + 1,) mm before the last return."""
    level = np.sort(depth, axis=0)
    cut = len(depth) // 20
    mean = level[cut : len(depth) - cut].mean(axis=0)
    low, high = level[cut], level[len(depth) - 1 - cut]
    clipped = np.clip(depth, low, high)
    noise = np.cov(clipped.T) * _alike(clipped) / len(depth)
    middle = 0.5 * (edges_mm[1:] + edges_mm[:-1])
    t = 2.0 * middle / edges_mm[-1] - 1.0
    shapes = np.stack([np.ones_like(t), t, t * t - 1.0 / 3.0], axis=1)
    inner = np.arange(t.size) >= min(LAST, t.size - 4)
    weight = np.sqrt(np.diff(edges_mm)[inner])
    fit = np.linalg.lstsq(shapes[inner] * weight[:, None], mean[inner] * weight, rcond=None)[0]
    left = mean[inner] - shapes[inner] @ fit
    pattern = float((left**2 - np.diag(noise)[inner]).sum()) / max(int(inner.sum()) - 3, 1)
    far = np.abs(middle[:, None] - middle[None, :]) / (edges_mm[-1] / PLACES)
    noise = noise + max(pattern, 0.0) * np.exp(-far) + DEPTH_U_MM**2 * np.eye(t.size)
    return Depths(mean, noise, (shapes * [PLACE_MM, TURN_MM, BOW_MM]) @ (shapes * [PLACE_MM, TURN_MM, BOW_MM]).T)


def _alike(values: Float) -> float:
    """How many neighbouring frames count as one, since they share their errors (roughness), of values (f, g) in order.

    By how means of 2, 4, 8, ... frames scatter against single ones; as long as LEAST_MEANS of them are left.
    """
    single, size, most = values.var(axis=0, ddof=1), 2, 1.0
    while len(values) // size >= LEAST_MEANS:
        means = values[: len(values) // size * size].reshape(-1, size, values.shape[1]).mean(axis=1)
        most = max(most, size * float(np.mean(means.var(axis=0, ddof=1) / np.maximum(single, 1e-18))))
        size *= 2
    return most


def _nothing_known(groups: int) -> Depths:
    return Depths(np.zeros(groups), np.eye(groups), np.zeros((groups, groups)))


@kernel
def _log_likelihoods(mean: Float, covariance: Float, expected: Float, u: Float, out: Float) -> None:
    """Fill in those (s,) of means (g,) with a covariance (g, g), by what is expected (s, g), each with its own u.

    Shapes reach from the last returns inwards: behind them nothing is expected, without u. The Cholesky rows of what
    lies there stand first, and are kept from shape to shape.
    """
    size = len(mean)
    lower, white, log = np.zeros((size, size)), np.empty(size), np.zeros(size + 1)
    same = 0  # rows behind the last shape
    for n in range(len(expected)):
        behind = size
        for i in range(size):
            if u[n, i] != 0.0 or expected[n, i] != 0.0:
                behind = size - 1 - i
        for i in range(min(same, behind), size):  # Cholesky, and the forward substitution with it
            row = size - 1 - i
            for j in range(i + 1):
                rest = covariance[row, size - 1 - j]
                for k in range(j):
                    rest -= lower[i, k] * lower[j, k]
                lower[i, j] = rest / lower[j, j] if j < i else math.sqrt(rest + u[n, row] ** 2)
            rest = mean[row] - expected[n, row]
            for k in range(i):
                rest -= lower[i, k] * white[k]
            white[i] = rest / lower[i, i]
            log[i + 1] = log[i] - 0.5 * white[i] ** 2 - math.log(lower[i, i])
        same = behind
        out[n] = log[size]


class _Shapes(NamedTuple):
    """Ends of a face that are alike likely before any return is looked at, s of them."""

    size_mm: Shaped[Float, " s"]  # radius of a rounding, height of a chamfer
    hidden_mm: Shaped[Float, " s"]  # from the last return's step to the virtual edge
    fall_mm: Shaped[Float, "s g"]  # depth under the line, by groups of columns


def _roundings(w_mm: Float, inclination: float, incidences: Float, most_mm: float) -> _Shapes:
    """Quarter circles, seen up to an incidence (eq. (12)); w_mm (p, g, q): q ways before the last return, p phases."""
    incidences = incidences[incidences > inclination]
    number, turn, phase = _grid(RADII, incidences, len(w_mm))
    radius = np.geomspace(LEAST_RADIUS_MM, most_mm, RADII)[number]
    turn = np.minimum(turn - inclination, math.pi / 2.0)
    end = radius * (np.sin(turn) - (1.0 - np.cos(turn)) * math.tan(inclination))  # as the columns count
    on = np.maximum(end[:, None, None] - w_mm[phase], 0.0) / radius[:, None, None] * math.cos(inclination)
    sine = np.minimum(on + math.sin(inclination), 1.0)
    turned = np.sqrt(1.0 - sine**2) * math.cos(inclination) + sine * math.sin(inclination)  # cosine of the turn
    return _Shapes(radius, radius - end, radius[:, None] * (1.0 - turned).mean(axis=2))


def _chamfers(w_mm: Float, inclination: float, most_mm: float) -> _Shapes:
    """Chamfers that the rays see to their end (eq. (12a)); w_mm: see `_roundings`. Of others no return tells."""
    turns = CHAMFERS[CHAMFERS + inclination < INCIDENCES[-1]]
    number, turn, phase = _grid(RADII, turns, len(w_mm))
    height = np.geomspace(LEAST_RADIUS_MM, most_mm, RADII)[number]
    hidden = height * np.tan(turn) * math.tan(inclination)
    falls = np.tan(turn) / (1.0 - np.tan(turn) * math.tan(inclination))  # a column's step along the line
    on = np.maximum((height - hidden)[:, None, None] - w_mm[phase], 0.0)
    return _Shapes(height, hidden, falls[:, None] * on.mean(axis=2))


def _grid(sizes: int, angles: Float, phases: int) -> tuple[Int, Float, Int]:
    """Numbers of sizes, angles and numbers of phases, each with each (s,)."""
    number, angle, phase = np.meshgrid(np.arange(sizes), angles, np.arange(phases))
    return number.ravel(), angle.ravel(), phase.ravel()


class _Broken(NamedTuple):
    """What the depths of a face's last returns tell of its end."""

    is_proven: bool  # a rounding or a chamfer
    size_mm: float
    beyond_mm: float  # from the last return's step to the virtual edge
    beyond_u_mm: float
    hides_mm: float  # what 95 % of roundings hide, of sizes that are alike likely before
    fall_mm: Shaped[Float, "2 g"]  # depth under the line by groups of columns, and what its shape may change of that


def _broken_edge(
    known: Depths,
    edges_mm: Float,
    inclination: float,
    incidences: Float,
    phases: Float,
    most_mm: float = MOST_RADIUS_MM,
) -> _Broken:
    """What depths of groups between `edges_mm` (g + 1,) before the last return tell of roundings and chamfers.

    phases (p, q): p places of the end within its column are alike likely, each of them the mean over q.
    """
    width = np.diff(edges_mm)
    within = np.where((width > 1.5 * edges_mm[1])[:, None], 0.5 if len(phases) > 1 else phases, phases[:, None, :])
    w_mm = edges_mm[:-1, None] + within * width[:, None]
    families = [_roundings(w_mm, inclination, incidences, most_mm), _chamfers(w_mm, inclination, most_mm)]
    size, beyond = (np.concatenate([[0.0], *(of[k] for of in families)]) for k in (0, 1))
    fall = np.concatenate([np.zeros((1, width.size)), *(of.fall_mm for of in families)])  # the first is sharp
    of_shape = [np.full(of.size_mm.size, share) for of, share in zip(families, (SHAPE, FLAT), strict=True)]
    of_depth = np.concatenate([[0.0], *of_shape])
    fall_u = of_depth[:, None] * fall
    # The part of the last column's pixel that the face fills lies before its middle, by f^2 / 16 columns on average.
    part = 0.5 * edges_mm[1] * math.sin(inclination) * math.cos(inclination) / 16.0
    fall[:, 0] -= part
    fall_u[:, 0] = np.hypot(fall_u[:, 0], part)
    score = np.empty(len(fall))
    _log_likelihoods(known.mean, known.noise + known.free, as_input(fall), as_input(fall_u), score)
    is_proven = bool(size.size > 1 and score[1:].max() - score[0] > 0.5 * PROOF**2)
    hides = _hidden_by_most(families[0], score[1 : 1 + families[0].size_mm.size])
    score[1:] -= np.concatenate([np.full(of.size_mm.size, math.log(max(of.size_mm.size, 1))) for of in families])
    share = np.exp(score - score.max())
    share /= share.sum()
    missing = float(share @ beyond)
    u = math.sqrt(float(share @ (beyond - missing) ** 2))
    return _Broken(is_proven, float(share @ size), missing, u, hides, np.stack([share @ fall, share @ fall_u]))


def _hidden_by_most(roundings: _Shapes, score: Float) -> float:
    """What MOST_HIDDEN of roundings hide, mm, by log-likelihoods (s,), all sizes alike likely before (eq. (12b))."""
    if not score.size:
        return 0.0
    order = np.argsort(roundings.hidden_mm)
    share = (roundings.size_mm * np.exp(score - score.max()))[order]  # the grid's steps are shares of the size
    return float(np.interp(MOST_HIDDEN, np.cumsum(share) / share.sum(), roundings.hidden_mm[order]))


def hidden_end_u_mm(cloud: Cloud, face: FaceLines) -> float:
    """Standard uncertainty of where a face ends, mm, by what blind columns may hide (docs/method.md, 3).

    Its end stays in one column, and others are blind elsewhere (check hidden_columns): it goes on by anything between
    none and as many of them.
    """
    columns = next((check.value or 0.0 for check in cloud.checks if check.name == "hidden_columns"), 0.0)
    if not columns:
        return 0.0
    lean = float(np.nanmedian(np.hypot(1.0, face.sxz / face.sxx)))
    return columns * column_pitch_mm(cloud.x_mm) * lean / math.sqrt(3.0)
