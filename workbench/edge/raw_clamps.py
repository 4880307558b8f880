"""Frames in which something stands before the edge: a clamp's own front runs along the end face and hides it."""

from __future__ import annotations

import numpy as np

from workbench.units import Bool, Float, Int

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
    for p in np.unique(pass_index):
        mine = np.flatnonzero((pass_index == p) & seen)
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
    for k in np.unique(part):  # directions are those of a stretch without a jump
        mine = np.flatnonzero(part == k)
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
