"""The end face of a raw edge, its two ends and the plate's surfaces in every frame."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from workbench.artefacts import LOWER_SURFACE, ROOT_FACE, UPPER_SURFACE, Cloud
from workbench.edge.faces import face_lines
from workbench.errors import InputError
from workbench.geometry import end_face, tracking
from workbench.geometry.along import by_pass
from workbench.geometry.blocks import as_input, as_rows, over_blocks
from workbench.geometry.chains import FaceLines
from workbench.geometry.poses import in_planes
from workbench.units import AnyArray, Bool, Float, Int, Shaped

LABELS = np.array([ROOT_FACE, UPPER_SURFACE, LOWER_SURFACE])  # in the order of geometry.end_face
BURR_POINTS = 3  # that stand out in a frame
# What stands beside the face in more frames in a row, over more of the way, is no streak; nor in so many of all frames.
STREAK_FRAMES, STREAK_MM, LONG_MM, MOST_STREAKS = 8, 2.0, 10.0, 0.25
STREAK_GAP = 3  # frames between those of one


@dataclass(frozen=True, slots=True, eq=False)
class FaceEnds:
    """One end of the end face in each of N frames; NaN where the frame does not show it."""

    corner: Shaped[Bool, " N"]  # the surface that joins the face there is seen
    point: Shaped[Float, "N 2"]  # x, z: the corner's virtual sharp edge, or the face's last return; profiler frame, mm
    column: Shaped[Float, " N"]  # of the last return, counted outwards
    pitch: Shaped[Float, " N"]  # distance of the columns in x, mm; 0 at a corner
    slope: Shaped[Float, " N"]  # dz/dx of the face next to its last return
    alone: Shaped[Bool, " N"]  # the next column saw both the face and what lies behind it
    burred: Shaped[Bool, " N"]  # points stand out beside the edge
    goes_on: Shaped[Bool, " N"]  # a further surface begins where the face ends, and leads away from it
    # by how much the face ends above what the plate lies on, whose crossing with it is then the corner, mm; else NaN
    gap_mm: Shaped[Float, " N"]


@dataclass(frozen=True, slots=True, eq=False)
class RawFaces:
    """What the frames show of a raw edge, for all N frames of a cloud."""

    faces: dict[int, FaceLines]  # by label; of the end face without its margins
    whole: FaceLines  # the end face from edge to edge
    lower: FaceEnds
    upper: FaceEnds
    seen: Shaped[Bool, " N"]  # the end face is seen
    side: Shaped[Float, " N"]  # the upper side lies towards falling side * x
    sense: float  # +1: z counts away from the sensor
    labels: Shaped[AnyArray, "N M"]  # uint8


def find_end_face(cloud: Cloud, along: Float, sense: float) -> RawFaces:
    """Read the end face in every frame; along (N, 2): its rough direction there, towards the upper side.

    Raises InputError where no frame shows it, or where one of its ends is never seen.
    """
    n, columns = cloud.x_mm.shape
    sums, ends = np.zeros((n, 4, 8)), np.full((n, 2, 9), np.nan)
    seen, labels = np.zeros(n, bool), np.zeros((n, columns), np.uint8)
    grid = as_rows(cloud.x_mm), as_input(cloud.z_mm), as_input(cloud.keep)
    streaks = np.isfinite(along[:, 0])

    def read(along: Float) -> None:
        known = as_input(along), sense, as_input(LABELS)
        over_blocks(
            lambda i, j: end_face.read_frames(*grid, *known, sums, ends, seen, labels, streaks, i, j), (n, columns)
        )

    read(along)
    part = lasting(streaks, seen, cloud)
    if part.any():  # steps of the end face, no streaks: they are in it, or it is none
        sums[part], ends[part], seen[part], labels[part], streaks[part] = 0.0, np.nan, False, 0, False
        read(np.where(part[:, None], along, np.nan))
    found = _gather(sums, ends, seen, -np.sign(along[:, 0]), sense, labels)
    hidden = seen & ~not_in_front(
        middle_of(cloud, found.faces[ROOT_FACE]), outward_of(cloud, found), seen, cloud.pass_index
    )
    labels[hidden] = 0
    found = _gather(sums, ends, seen & ~hidden, found.side, sense, labels)
    for name, end in (("lower", found.lower), ("upper", found.upper)):
        if np.isfinite(end.point[:, 0]).sum() < 3:
            raise InputError(
                cloud.source,
                f"{name} edge not in view: the end face runs out of the field of view, behind something or into "
                "another face in every frame; or are axes mirrored, or is the edge prepared already (edge.segment)?",
            )
    return found


def lasting(streaks: Bool, seen: Bool, cloud: Cloud) -> Bool:
    """Frames (N,) in which what stands beside the face lasts too long along the edge for a streak of stray returns.

    streaks (N,): where something does, of the frames that are `seen` (N,).
    """
    if streaks.sum() > MOST_STREAKS * max(int(seen.sum()), 1):
        return np.ones(streaks.size, bool)
    out, place = np.zeros(streaks.size, bool), cloud.base_from_profiler[:, :3, 3]
    at = np.flatnonzero(streaks)
    for run in np.split(at, np.flatnonzero((np.diff(at) > STREAK_GAP) | (np.diff(cloud.pass_index[at]) != 0)) + 1):
        way = float(np.linalg.norm(place[run[-1]] - place[run[0]])) if run.size > 1 else 0.0
        if way > LONG_MM or (run.size > STREAK_FRAMES and way > STREAK_MM):
            out[run[0] : run[-1] + 1] = True
    return out


def _gather(sums: Float, ends: Float, seen: Bool, side: Float, sense: float, labels: AnyArray) -> RawFaces:
    """What the kernel reports, for the frames `seen`."""
    faces = {int(label): face_lines(sums[:, f], seen) for f, label in enumerate(LABELS)}
    lower, upper = (_ends(sums, ends[:, k], seen, f) for k, f in enumerate((end_face.LOWER, end_face.UPPER)))
    return RawFaces(faces, face_lines(sums[:, end_face.WHOLE], seen), lower, upper, seen, side, sense, labels)


def middle_of(cloud: Cloud, face: FaceLines) -> Float:
    """A face's centroid in the base (N, 3), mm; NaN where it is not seen."""
    pose = cloud.base_from_profiler
    return in_planes(pose, face.x_mean, face.z_mean)


def outward_of(cloud: Cloud, found: RawFaces) -> Float:
    """The direction (N, 3) in each laser plane square to the end face, out of the plate; NaN where it is not seen."""
    face = found.faces[ROOT_FACE]
    slope = face.slope[:, None]
    x, z = cloud.base_from_profiler[:, :3, 0], cloud.base_from_profiler[:, :3, 2]
    return np.asarray(found.sense * (slope * x - z) / np.hypot(1.0, slope))


def _ends(sums: Float, ends: Float, seen: Bool, surface: int) -> FaceEnds:
    """One end of the face: the crossing with its surface where that is seen, else the last return."""
    kind = np.where(seen, ends[:, end_face.KIND], end_face.HIDDEN)
    corner = kind == end_face.CORNER
    with np.errstate(divide="ignore", invalid="ignore"):
        slope = sums[:, :, tracking.SXZ] / sums[:, :, tracking.SXX]
        offset = sums[:, :, tracking.Z_MEAN] - slope * sums[:, :, tracking.X_MEAN]
        x = (offset[:, surface] - offset[:, end_face.FACE]) / (slope[:, end_face.FACE] - slope[:, surface])
        crossing = np.stack([x, slope[:, end_face.FACE] * x + offset[:, end_face.FACE]], axis=1)
    point = np.where(corner[:, None], crossing, ends[:, [end_face.END_X, end_face.END_Z]])
    goes_on = kind == end_face.GOES_ON
    point[(kind == end_face.HIDDEN) | goes_on] = np.nan
    pitch = np.where(corner, 0.0, ends[:, end_face.PITCH])
    burred = seen & (ends[:, end_face.PROUD] >= BURR_POINTS)
    alone = ends[:, end_face.ALONE] == 1.0
    gap = np.where(corner, ends[:, end_face.GAP], np.nan)
    return FaceEnds(
        corner, point, ends[:, end_face.COLUMN], pitch, ends[:, end_face.SLOPE], alone, burred, goes_on, gap
    )


# Frames in which something stands before the edge: a clamp's own front runs along the end face and hides it.

NEAR_FRAMES = 10  # on each side, that say which way the edge runs
ONE_WAY = 0.95  # length of the mean of the unit directions out of the plate: they turn by some 35 deg at most
JUMP = 4.0  # times the usual step from frame to frame
STEP_MM, STEEPEST = 0.4, 0.6  # from frame to frame, and per mm of the way, that one face may jump
GAP_MM = 4.0  # frames further apart than this belong to different stretches
REACH_MM = 6.0  # of a stretch's end that says where it goes on
SAME_MM = 1.2  # stretches within this of each other may be one face
LEAST_FRAMES, LEAST_MM = 3, 2.0  # of the stretches on the edge's own level


def not_in_front(middle: Float, outward: Float, seen: Bool, pass_index: Int) -> Bool:
    """Which frames (N,) show the face that stands furthest back: a clamp over the edge stands before it.

    middle (N, 3): the found face's centroid in the base, mm; outward (N, 3): out of the plate, unit. The frames of a
    pass fall into stretches without a jump; each stretch is compared with where the one before it would go on.
    """
    out = seen.copy()
    for mine in by_pass(pass_index, seen):
        if mine.size < LEAST_FRAMES:
            continue
        height, way = _along(middle[mine], outward[mine])
        out[mine] = _back(height, way)
    return out


def _along(middle: Float, outward: Float) -> tuple[Float, Float]:
    """How far each point (n, 3) stands out of the first one, and its way along the edge (n,), mm, by the steps between.

    outward (n, 3): out of the plate there. An edge may bend and close: what counts is each step's own direction.
    """
    axis, travelled = outward.mean(axis=0), middle[-1] - middle[0]
    if np.linalg.norm(axis) > ONE_WAY and np.linalg.norm(travelled) > 0:  # one direction serves all frames
        travelled /= np.linalg.norm(travelled)
        axis -= travelled * (axis @ travelled)
        axis /= np.linalg.norm(axis) + 1e-12
        return middle @ axis, middle @ travelled
    step = np.diff(middle, axis=0)
    size = np.linalg.norm(step, axis=1)
    part = np.concatenate([[0], np.cumsum(size > JUMP * float(np.median(size)) + STEP_MM)])
    normal, travel = np.empty_like(middle), np.empty_like(middle)
    for mine in by_pass(part):  # directions are those of a stretch without a jump
        at = np.arange(mine.size)
        ahead, behind = np.minimum(at + NEAR_FRAMES, mine.size - 1), np.maximum(at - NEAR_FRAMES, 0)
        total = np.cumsum(np.vstack([np.zeros((1, 3)), outward[mine]]), axis=0)
        travel[mine] = middle[mine[ahead]] - middle[mine[behind]]
        normal[mine] = total[ahead + 1] - total[behind]
    between, along = normal[1:] + normal[:-1], travel[1:] + travel[:-1]  # by their frames: few of them say little
    along /= _size(along)
    between -= along * (between * along).sum(axis=1, keepdims=True)
    between /= _size(between)
    height, way = (np.concatenate([[0.0], np.cumsum((step * v).sum(axis=1))]) for v in (between, along))
    return height, way


def _size(vectors: Float) -> Float:
    return np.asarray(np.linalg.norm(vectors, axis=1, keepdims=True) + 1e-12)


def _back(height: Float, way: Float) -> Bool:
    """Points (n,) of the stretches that lie furthest back, of a profile height(way) in order of time, mm."""
    step = np.abs(np.diff(way))
    cuts = np.flatnonzero((np.abs(np.diff(height)) > STEP_MM + STEEPEST * step) | (step > GAP_MM)) + 1
    stretches = np.split(np.arange(height.size), cuts)
    level = np.zeros(len(stretches))
    for k in range(1, len(stretches)):
        level[k] = level[k - 1] + _jump(height, way, stretches[k - 1], stretches[k])
    sound = np.array([part.size >= LEAST_FRAMES and np.ptp(way[part]) >= LEAST_MM for part in stretches])
    lowest = level[sound].min() if sound.any() else 0.0
    chosen = np.zeros(height.size, bool)
    for part, here in zip(stretches, level, strict=True):
        chosen[part] = abs(here - lowest) < SAME_MM  # further back: the end of the plate, seen for a few frames
    return chosen


def _jump(height: Float, way: Float, before: Int, after: Int) -> float:
    """How far the stretch `after` stands outside of where the stretch `before` goes on, half-way between both."""
    middle = 0.5 * (way[before[-1]] + way[after[0]])
    ends = []
    for part, end in ((before, before[-1]), (after, after[0])):
        near = part[np.abs(way[part] - way[end]) <= REACH_MM]
        slope = 0.0
        if np.ptp(way[near]) > 0.4 * REACH_MM:
            slope = float(np.polyfit(way[near], height[near], 1)[0])
        ends.append(float(np.median(height[near] + slope * (middle - way[near]))))
    return ends[1] - ends[0]
