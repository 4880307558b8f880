"""A milled edge from its faces: one smooth state along the edge, from what every frame says in the section plane.

The state (docs/method.md) is the lower edge c(s), the direction of the root face and of the bevel face about it, and
the root face, each a `geometry.course`. Each frame contributes the lines of its faces and the place where the root face
ends; nothing else of it is used, so that vibration and the robot's errors cancel in sizes and angles.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from workbench.artefacts import BEVEL_FACE, ROOT_FACE, Cloud
from workbench.edge.broken_end import BrokenEnd, weights, whole_end
from workbench.edge.directions import near_slope, wrapped
from workbench.edge.faces import TrackedFaces
from workbench.edge.frame_ends import FaceCorner, RootEnds, root_ends
from workbench.edge.raw_direction import LEAST_FRAMES, LEAST_LENGTH_MM
from workbench.edge.steps import Readings, own_directions, readings, slow_waves_u
from workbench.errors import InputError
from workbench.geometry.along import between, by_pass, in_order
from workbench.geometry.course import BIN_MM, LEAST_BINS, Course, fit_course
from workbench.geometry.curves import Curve, along_motion, fit_curve
from workbench.geometry.fading import faded_columns
from workbench.geometry.poses import in_planes
from workbench.geometry.processes import ROUGH
from workbench.geometry.sections import SectionLines, crossing, on_line, section_lines
from workbench.geometry.silhouette import EndCourse, Ends, find_end, settled
from workbench.units import Bool, Float, Int, Shaped

UNDETERMINED = (
    "its frames do not determine one smooth edge: do passes overlap, are poses and hand-eye right, is a face only a "
    "few columns wide?"
)
TURNED = 100.0  # times the variance of a direction, of a face whose end is burred
FAR_MM, FAR_TIMES = 5.0, 5.0  # of the root face: frames that say more have lost the faces
LEAST_SIGMA_MM = 1e-3
LEAST_WEIGHT = 0.5  # of a frame that shows the end as well as others beside it do
START_FRAMES = 5  # of each stretch over which a course averages, that the first round takes
# By which the lower edge moves from one round to the next, whose curve lies through that of the round before: over some
# mm it turns the sections by half a degree.
ASTRAY_MM, MOST_ROUNDS = 0.03, 4
MOST_ASTRAY = 0.05  # of the frames, whose corners may lie far off the edge: beside clamps a few do


@dataclass(frozen=True, slots=True, eq=False)
class Faces:
    """Directions of both faces along the edge and each frame's lines, in the section planes of a curve."""

    root: SectionLines  # of N frames
    bevel: SectionLines
    turns: Shaped[Float, "2 N"]  # what obliquity adds to the directions of both, rad: taken off before the courses
    root_course: Course  # direction of the root face, rad
    bevel_course: Course  # direction of the bevel face, rad
    opening_course: Course  # angle between both, rad, as each frame shows it
    own: Shaped[Bool, " N"]  # frames that show the root face's own direction: no burr turns its line
    follows: float  # how likely it is that the angle between the faces runs smoothly, rather than the root face alone


@dataclass(frozen=True, slots=True, eq=False)
class Measured:
    """The milled edge's state."""

    curve: Curve  # the lower edge, from arc length 0
    s_low: Shaped[Float, " N"]  # where each frame shows it; NaN where it does not
    faces: Faces
    ends: RootEnds  # of N frames
    end: EndCourse  # root face, less what stands out of its end or is lost of it
    said: Readings  # of that, at the course's own places
    upper_s: Shaped[Float, " N"]  # where each frame shows the upper edge of the root face
    lever_mm: Shaped[Float, " N"]  # distance of the bevel's measured points from it; NaN: does not see the break
    turns: Shaped[Float, "2 N"]  # what obliquity adds to the directions of root face and bevel face, rad
    root_turn: Shaped[Float, " N"]  # by which the lines of the root face are still turned, rad
    bevel_turn: Shaped[Float, " N"]  # the same of the bevel face
    shift: float  # of all arc lengths above but `s_low`, mm: they count from another place
    # how far each frame's lower edge still moved in the last round, where it did not settle; 0 elsewhere
    unsettled_mm: Shaped[Float, " N"]
    broken: BrokenEnd  # what the frames do not show of the lower end, by the places of all passes as well


def measure_edge(cloud: Cloud, tracked: TrackedFaces, broken: BrokenEnd | None = None) -> Measured:
    """Estimate the state of a milled edge.

    Starts from the corners between root face and bevel face, which every frame shows by itself, and repeats with the
    lower edge that this gives, until it moves by less than ASTRAY_MM: mostly once; again where a first look followed
    what stands out of the end, or ends that the likelihood of the frames tells to be lost. Where it never settles, how
    far the last round moved it is in the uncertainty of the root face's end. For the start, frames are enough that lie
    a fifth of what is averaged apart.
    """
    broken = broken or whole_end(len(tracked.seen))
    if broken.drawn is not None:
        tracked = replace(tracked, end_is_burred=tracked.end_is_burred & ~broken.drawn.is_proven)
    corners, along = _corners(cloud, tracked)
    seen = tracked.seen & np.isfinite(corners).all(axis=1) & np.isfinite(along).all(axis=1)
    check_advance(cloud, corners[seen])
    s = np.full(seen.size, np.nan)
    s[seen] = along_motion(corners[seen], along[seen], cloud.pass_index[seen])
    few = _few(s, cloud.pass_index)
    start = few.start + np.flatnonzero(seen[few]) * few.step
    curve = fit_curve(corners[start], s[start], cloud.pass_index[start])
    s[seen] = curve.project(corners[seen], s[seen])
    first, lower_edge, s_low = _state(cloud, tracked, broken, curve, s, np.zeros((2, s.size)), few)
    turns = first.turns
    good = _sound(cloud, lower_edge, s_low, corners)
    curve = fit_curve(lower_edge[good], s_low[good], cloud.pass_index[good])
    s[good] = curve.project(lower_edge[good], s_low[good])
    s[~good] = np.nan
    for _ in range(MOST_ROUNDS):
        before = lower_edge
        measured, lower_edge, s_low = _state(cloud, tracked, broken, curve, s, turns)
        turns = measured.turns
        astray = float(np.mean(np.isnan(measured.upper_s[np.isfinite(s)])))
        moved = np.linalg.norm(lower_edge - before, axis=1)[good]
        if np.nanmax(moved, initial=0.0) < ASTRAY_MM:
            break
        good = _sound(cloud, lower_edge, s_low, corners)
        curve = fit_curve(lower_edge[good], s_low[good], cloud.pass_index[good])
        s[good] = curve.project(lower_edge[good], s_low[good])
        s[~good] = np.nan
    else:
        still = np.nan_to_num(np.linalg.norm(lower_edge - before, axis=1))
        measured = replace(measured, unsettled_mm=np.where(still < ASTRAY_MM, 0.0, still))
    on = measured.upper_s[np.isfinite(measured.upper_s)]
    if astray > MOST_ASTRAY or not on.size or np.median(curve.u(on)) > FAR_MM:
        raise np.linalg.LinAlgError("corners of the frames lie anywhere")
    return measured


def _few(s: Float, pass_index: Int) -> slice:
    """The frames that a first look takes, of all at s (N,) mm: START_FRAMES in each stretch that is averaged.

    The same from either end: an odd number apart, the first as far from its end as the last.
    """
    steps = np.abs(np.diff(s))[np.diff(pass_index) == 0]
    usual = float(np.median(steps[steps > 0.0])) if np.isfinite(steps).any() else BIN_MM
    width = min(BIN_MM, float(np.nanmax(s) - np.nanmin(s)) / LEAST_BINS)
    most = s.size // (LEAST_BINS * START_FRAMES)  # frames that are stamped in bursts lie anywhere
    step = max(1, min(int(width / START_FRAMES / max(usual, 1e-6)), most) - 1) // 2 * 2 + 1
    return slice((s.size - 1) * (step + 1) // 2 % step, None, step)


def _corners(cloud: Cloud, tracked: TrackedFaces) -> tuple[Float, Float]:
    """Corner of root face and bevel face in the base (N, 3), frame by frame; direction t of the edge there (N, 3)."""
    root, bevel = tracked.faces[ROOT_FACE], tracked.faces[BEVEL_FACE]
    x = root.crossing(bevel)
    corners = in_planes(cloud.base_from_profiler, x, root.z(x))
    # t = m x n, if the laser plane stood square to the edge
    across = (bevel.slope - root.slope)[:, None] * cloud.base_from_profiler[:, :3, 1]
    return corners, edge_direction(corners, across, cloud)


def edge_direction(points: Float, across: Float, cloud: Cloud) -> Float:
    """Unit direction t (N, 3) of the edge at each frame: of the points' (N, 3) motion, in the sense of `across`."""
    out = np.full(points.shape, np.nan)
    for mine in by_pass(cloud.pass_index, np.isfinite(points.sum(axis=1))):
        if mine.size < 2:
            continue
        reach = max(1, min(10, mine.size // 4))
        ahead = mine[np.minimum(np.arange(mine.size) + reach, mine.size - 1)]
        behind = mine[np.maximum(np.arange(mine.size) - reach, 0)]
        motion = points[ahead] - points[behind]
        motion *= np.sign((motion * across[mine]).sum(axis=1, keepdims=True))
        size = np.linalg.norm(motion, axis=1, keepdims=True)
        usual = np.median(size[size > 0]) if (size > 0).any() else 1.0
        direction = np.where(size > 0.2 * usual, motion / np.maximum(size, 1e-9), np.nan)
        known = np.isfinite(direction[:, 0])
        if known.any():
            at = np.flatnonzero(known)
            nearest = at[np.clip(np.searchsorted(at, np.arange(mine.size)), 0, at.size - 1)]
            out[mine] = direction[nearest]
    return out


def check_advance(cloud: Cloud, corners: Float) -> None:
    """Refuse frames that do not run along an edge: angles and lengths need its direction."""
    travelled = np.ptp(corners, axis=0) if len(corners) else np.zeros(3)
    if len(corners) < LEAST_FRAMES or np.linalg.norm(travelled) < LEAST_LENGTH_MM:
        raise InputError(
            cloud.source,
            f"expected at least {LEAST_FRAMES} frames that see the edge along at least "
            f"{LEAST_LENGTH_MM:g} mm of it, found {len(corners)} frames along "
            f"{np.linalg.norm(travelled):.2f} mm",
        )


def _sound(cloud: Cloud, lower_edge: Float, s: Float, corners: Float) -> Bool:
    """Frames (N,) whose lower edge lies about as far from the corner of their faces as elsewhere.

    Raises InputError where too few are left: what was followed is no root face next to a bevel.
    """
    away = np.linalg.norm(lower_edge - corners, axis=1)
    good = np.isfinite(away) & np.isfinite(s)
    if good.any():
        good &= away < max(FAR_MM, FAR_TIMES * float(np.median(away[good])))
    check_advance(cloud, corners[good])
    return np.asarray(good)


def _directions(cloud: Cloud, tracked: TrackedFaces, curve: Curve, s: Float, turns: Float, few: slice | None) -> Faces:
    """Directions of both faces along the edge (eq. (5), (6)), less what obliquity adds: it differs between passes.

    turns (2, N): that, of root face and bevel face, rad.
    few: a first look from these frames, which takes what stands on the root face's ends for the face's own.
    """
    pose, side, sigma, of = cloud.base_from_profiler, tracked.side, tracked.range_sigma_mm, few or slice(None)
    lines = [
        section_lines(
            tracked.faces[label],
            near_slope(tracked.faces[label], s, cloud.pass_index),
            pose,
            side,
            sigma[:, column],
            curve,
            s,
        )
        for label, column in ((ROOT_FACE, 2), (BEVEL_FACE, 1))
    ]
    root, bevel = lines
    about = float(np.angle(np.nanmean(np.exp(1j * root.angle))))
    root_angle = about + wrapped(root.angle - about)
    bevel_angle = root_angle - wrapped(root_angle - bevel.angle) - turns[1]
    root_angle = root_angle - turns[0]
    group, s_root, variance = cloud.pass_index[of], root.s[of], root.angle_variance[of]
    bevel_course = fit_course(bevel.s[of], bevel_angle[of], bevel.angle_variance[of], group, shared=ROUGH)
    root_angle, own = root_angle[of], ~tracked.end_is_burred
    variance = variance * np.where(own[of], 1.0, TURNED)  # a burr's low foot turns the line
    if few is None:
        likely = own_directions(s_root, root_angle, variance, tracked.faces[ROOT_FACE].width_mm)
        variance, own = variance / likely, own & (likely > 0.5)
    root_course = fit_course(s_root, root_angle, variance, group, shared=ROUGH)
    opening_course = fit_course(s_root, root_angle - bevel_course.value(s_root), variance, group, shared=ROUGH)
    follows = 1.0 / (1.0 + math.exp(np.clip(root_course.log_evidence - opening_course.log_evidence, -50.0, 50.0)))
    return Faces(root, bevel, turns, root_course, bevel_course, opening_course, own, follows)


def rocking_u(faces: Faces, pass_index: Int) -> float:
    """Standard uncertainty of the bevel angle, rad, by waves of both directions that their courses do not follow."""
    found = 0.0
    for lines, turn, course, own in (
        (faces.root, faces.turns[0], faces.root_course, faces.own),
        (faces.bevel, faces.turns[1], faces.bevel_course, np.isfinite(faces.bevel.s)),
    ):
        left = wrapped(lines.angle - turn - course.value(np.nan_to_num(lines.s)))
        found = math.hypot(found, slow_waves_u(lines.s, np.where(own, left, np.nan), pass_index))
    return found


def _state(
    cloud: Cloud,
    tracked: TrackedFaces,
    broken: BrokenEnd,
    curve: Curve,
    s: Float,
    turns: Float,
    few: slice | None = None,
) -> tuple[Measured, Float, Float]:
    """The state in the section planes of `curve`; each frame's lower edge in the base (N, 3), and its arc length (N,).

    few: a first look from these frames, which takes the middles of the column steps for the root face's end.
    """
    of = few or slice(None)
    faces = _directions(cloud, tracked, curve, s, turns, few)
    root, none = faces.root, np.zeros_like(s)
    made = _corner(faces, s, none, none)
    ends, agreed = _whole(cloud, tracked, root_ends(cloud, tracked, curve, root, faces.bevel, made, s), made, broken)
    safe = np.where(np.isfinite(made.upper_s), made.upper_s, 0.0)
    middle, spread = ends.low + 0.5 * ends.step, ends.sigma**2 + ends.step**2 / 12.0 + 1e-8
    shows = np.arange(s.size)[of][weights(made.upper_s[of], broken.doubt_mm[of]) > LEAST_WEIGHT]
    if not np.isfinite(made.upper_s[shows] + middle[shows]).any():
        raise np.linalg.LinAlgError("the faces' lines meet nowhere near the frames")
    course = fit_course(made.upper_s[shows], middle[shows], spread[shows], cloud.pass_index[shows])
    made = _corner(faces, s, course.value(safe), course.slope(safe))
    end = said = None
    if few is None:
        ends, agreed = _whole(
            cloud, tracked, root_ends(cloud, tracked, curve, root, faces.bevel, made, s), made, broken
        )
        end = find_end(_as_ends(cloud, tracked, ends, made.upper_s, faces, course, broken), course)
        said = readings(end.s, end.middle, end.middle_u, end.course.at_mm, end.course)
        course = said.moved(end.course)
        end = replace(end, course=course)
        made = _corner(faces, s, course.value(safe), course.slope(safe))
    upper_s, up = made.upper_s, made.up
    safe = np.where(np.isfinite(upper_s), upper_s, 0.0)
    size = course.value(safe)
    s_low = upper_s - root.run * size  # an oblique frame ends there, and the first curve is not parallel to the edge
    low = np.where(np.isfinite(s_low), s_low, 0.0)
    _, a, b = curve.frame(low)
    spot = on_line(root.place, made.tilt, up - size)
    lower_edge = curve.position(low) + spot[:, :1] * a + spot[:, 1:] * b
    lower_edge[~np.isfinite(upper_s)] = np.nan
    shift = float(np.nanmin(s_low))
    measured = Measured(
        curve,
        s_low - shift,
        faces,
        ends,
        end,  # type: ignore[arg-type]
        said,  # type: ignore[arg-type]
        upper_s,
        np.where(weights(upper_s, broken.doubt_mm) < LEAST_WEIGHT, np.nan, made.lever),
        np.nan_to_num(made.turns),
        made.turns[0] - turns[0],
        made.turns[1] - turns[1],
        shift,
        none,
        agreed,
    )
    return measured, lower_edge, s_low


def _whole(
    cloud: Cloud, tracked: TrackedFaces, ends: RootEnds, corner: FaceCorner, broken: BrokenEnd
) -> tuple[RootEnds, BrokenEnd]:
    """The ends, up to the virtual sharp edge; and what lies beyond them, by their places as well."""
    places = ends.low + 0.5 * ends.step
    agreed = broken.agreed(corner.upper_s, places, cloud.pass_index, tracked.end_is_corner)
    low = ends.low + agreed.beyond_mm
    if broken.drawn is not None:
        variance = ends.sigma**2 + ends.step**2 / 12.0
        hangs = broken.drawn.hangs(corner.upper_s, places, variance, cloud.pass_index)
        edge, u = broken.drawn.edge(hangs)
        low, agreed = low + edge, replace(agreed, hidden_u_mm=np.hypot(agreed.hidden_u_mm, u))
    return replace(ends, low=low), agreed


def _corner(faces: Faces, s: Float, size: Float, size_slope: Float) -> FaceCorner:
    """The corner where the root face has a size (N,) that changes by `size_slope` (N,).

    An oblique frame sees each point of a face at another arc length, where the face has turned (eq. (7)).
    """
    root, bevel = faces.root, faces.bevel
    turn, at = face_turns(faces, s), np.where(np.isfinite(s), s, 0.0)
    tilt, beta = face_angles(faces, at)
    _, lever = _crossed(root.place, tilt, bevel.place, beta)
    # By how much the faces' middles move across their lines, a mm along the edge; the bevel's also as the size changes.
    root_moves, bevel_moves = 0.5 * size * turn[0], size * turn[0] * np.cos(beta) + lever * turn[1]
    resized = size_slope * np.sin(beta)
    turns = np.stack([root.run * root_moves, bevel.run * (resized + bevel_moves)])
    left = (between(face.s, of, at) for face, of in zip((root, bevel), turns - faces.turns, strict=True))
    tilt, beta = face_angles(faces, at, *left)
    # Both lines in the section at s, less the bow of the faces; but the size is the corner's own.
    root_off = turn[0] * root.run * root.spread + (root.s - s) * root_moves
    bevel_off = turn[1] * bevel.run * bevel.spread + (bevel.s - s) * bevel_moves + bevel.run * lever * resized
    root_place, bevel_place = _moved(root.place, tilt, root_off), _moved(bevel.place, tilt - beta, bevel_off)
    up, lever = _crossed(root_place, tilt, bevel_place, beta)
    return FaceCorner(tilt, beta, up, root.s + root.run * up, lever, turns)


def _crossed(root_place: Float, tilt: Float, bevel_place: Float, beta: Float) -> tuple[Float, Float]:
    """Distances (N,) of the corner from places on both lines (N, 2), mm."""
    up = crossing(root_place, tilt, bevel_place, tilt - beta)
    far = np.abs(up) > max(FAR_MM, FAR_TIMES * float(np.nanmedian(np.abs(up))))
    up = np.where(far, np.nan, up)  # where the courses run parallel, beyond clamps, corners lie anywhere
    return up, np.linalg.norm(bevel_place - on_line(root_place, tilt, up), axis=1)


def _moved(place: Float, angle: Float, off: Float) -> Float:
    """Places (N, 2) on lines, taken back by what these stand off to their left (N,)."""
    return np.asarray(place - off[:, None] * np.stack([-np.sin(angle), np.cos(angle)], axis=1))


def face_angles(
    faces: Faces, at: Float, root_turn: Float | float = 0.0, bevel_turn: Float | float = 0.0
) -> tuple[Float, Float]:
    """Direction of the root face and bevel angle (m,) at `at`, rad: averaged over what may run smoothly."""
    bevel = faces.bevel_course.value(at)
    beta = (1.0 - faces.follows) * (faces.root_course.value(at) - bevel) + faces.follows * faces.opening_course.value(
        at
    )
    beta = beta + bevel_turn - root_turn
    bevel = bevel - bevel_turn
    return bevel + beta, beta


def face_turns(faces: Faces, s: Float) -> tuple[Float, Float]:
    """Turn of root face and bevel face along the edge at each frame (N,) at s, rad/mm."""
    at = np.where(np.isfinite(s), s, 0.0)
    bevel = faces.bevel_course.slope(at)
    alone, together = faces.root_course.slope(at), bevel + faces.opening_course.slope(at)
    return (1.0 - faces.follows) * alone + faces.follows * together, bevel


def _as_ends(
    cloud: Cloud, tracked: TrackedFaces, ends: RootEnds, upper_s: Float, faces: Faces, size: Course, broken: BrokenEnd
) -> Ends:
    """The frames' ends as the silhouette's likelihood takes them: with the noise that directions and ends show."""
    course = faces.opening_course if faces.follows > 0.5 else faces.root_course
    excess = max(1.0, course.frame_factor)
    share = min(1.0, excess / max(course.noise_factor, 1e-9))
    column = ends.step**2 / 12.0
    shown = size.frame_factor * (ends.sigma**2 + column) - column
    sigma = np.sqrt(np.maximum(np.maximum(ends.sigma**2 * excess, shown), LEAST_SIGMA_MM**2))
    freed = settled(upper_s, ends.low, ends.step, sigma, tracked.end_column, cloud.pass_index)
    silhouette = np.isfinite(ends.low) & (ends.step > 0.0)
    fade = faded_columns(cloud.z_mm, tracked.end_column, silhouette, cloud.pass_index)
    on = in_order(upper_s, freed.low, freed.sigma)
    return Ends(
        upper_s[on],
        freed.low[on],
        freed.step[on],
        np.maximum(freed.sigma[on], LEAST_SIGMA_MM),
        ends.missing[on],
        fade[on],
        share * freed.weight[on] * weights(upper_s[on], broken.doubt_mm[on]),
        freed.doubt[on],
    )
