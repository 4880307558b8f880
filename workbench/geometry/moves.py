"""Runs of poses replaced by the straight and circular moves of a robot's controller.

A controller moves the position along a line, or along the circle through start, via and target, and turns the
orientation by slerp from start to target, in step with the length of path. Poses may be left out where it passes all
of them, in their order, within tolerances, and an arc stays as near to the chords between them. Positions in mm,
quaternions w x y z, angles in rad.

And of a path: how far rounding its corners off leaves it, how long it takes, feeds that respect an acceleration.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from workbench.geometry.blocks import as_input
from workbench.geometry.poses import slerp
from workbench.kernels import kernel
from workbench.units import Bool, Float, Int, Shaped

MOST_SWEEP = 170.0 * math.pi / 180.0  # of one arc: slerp takes the short way, and controllers end at 240 deg
LEAST_CHORD_MM = 1.0  # of an arc, from start to target; ABB's own limit is 0.1 mm
BACKWARDS = 1e-9  # rounding of the place along a move that still counts as the same place
CENTRE, RADIUS, ALONG, INWARD, NORMAL, CIRCLE = 0, 3, 4, 7, 10, 13  # a circle as one row of numbers
ON_A_LINE = 1e-12  # square of a sine


class PoseRun(NamedTuple):
    """Poses in their order, as the kernels take them."""

    position: Shaped[Float, "n 3"]
    quaternion: Shaped[Float, "n 4"]
    feed: Shaped[Float, "n 2"]  # towards each pose, and the share by which others may exceed it
    length: Shaped[Float, " n"]  # of the path up to each


class Tolerances(NamedTuple):
    """What a controller's move may leave out or turn."""

    chord_mm: float  # greatest distance of a pose that is left out from the line or circle
    angle: float  # greatest angle of its orientation to the one that the controller has there
    least_sweep: float  # of an arc; what turns less stays straight. Infinite: no arcs
    # From the poses' origin to another point of the tool, which a controller may move straight instead: over a straight
    # move that turns by t, the origin then leaves its line by lever t^2 / 8 at most.
    lever_mm: float = 0.0


def merge_poses(
    position_mm: Shaped[Float, "n 3"],
    quaternion_wxyz: Shaped[Float, "n 4"],
    feed: Shaped[Float, " n"],
    feed_share: Shaped[Float, " n"],
    label: Shaped[Int, " n"],
    allowed: Tolerances,
) -> tuple[Int, Bool, Float, Float]:
    """The moves through n >= 2 poses: each reaches as far as it fits from where the one before it ended.

    Args:
        position_mm: (n, 3), no two in a row alike in position and orientation.
        quaternion_wxyz: (n, 4), unit length.
        feed: (n,) towards each pose.
        feed_share: (n,) share by which the fastest feed within a move that ends there may exceed the slowest.
        label: (n,) of the way towards each pose; it does not change within a move.
        allowed: what a move may leave out or turn.

    Returns:
        Indices of the targets (k,), the first is 0; whether each move is circular (k,); the middle of each arc, its
        position (k, 3) and orientation (k, 4), NaN for straight moves.
    """
    p, q = np.ascontiguousarray(position_mm, float), np.ascontiguousarray(quaternion_wxyz, float)
    last = np.append(np.flatnonzero(np.diff(label)), len(label) - 1)  # of each stretch of one label
    stop = last[np.searchsorted(last, np.arange(len(label)))]
    length = arc_lengths_mm(p)
    chord = 2.0 * math.sin(min(allowed.angle, math.pi) / 4.0)  # of two unit quaternions that differ by `angle`
    feeds = np.stack([feed, np.broadcast_to(feed_share, len(p))], axis=1)
    most_turn = math.sqrt(8.0 * allowed.chord_mm / allowed.lever_mm) if allowed.lever_mm > 0 else math.inf
    tolerances = np.array([allowed.chord_mm, chord, most_turn / 2.0])  # the last: between quaternions
    targets, circular, via = _merge(PoseRun(p, q, feeds, length), stop, tolerances, allowed.least_sweep)
    via_turn = np.full((len(targets), 4), np.nan)
    start, end = targets[:-1][circular[1:]], targets[circular]
    via_turn[circular] = slerp(q[start], q[end], np.full(len(end), 0.5))
    return targets, circular, via, via_turn


@kernel
def _merge(run: PoseRun, stop: Int, tolerances: Float, least_sweep: float) -> tuple[Int, Bool, Float]:
    """Targets, whether circular, and the middles of the arcs."""
    n = len(run.position)
    targets, circular, via = np.zeros(n, np.int64), np.zeros(n, np.bool_), np.full((n, 3), np.nan)
    circle = np.zeros(CIRCLE)
    k, i = 1, 0
    while i < n - 1:
        end = _farthest(False, run, i, stop[i + 1], tolerances, circle)
        if least_sweep < np.inf:
            arc_end = _farthest(True, run, i, stop[i + 1], tolerances, circle)
            if arc_end > end:
                sweep = circle_through(run.position, i, _middle(run.length, i, arc_end), arc_end, circle)
                if sweep >= least_sweep and 2.0 * circle[RADIUS] * math.sin(sweep / 2.0) >= LEAST_CHORD_MM:
                    end, circular[k] = arc_end, True
                    _on_circle(circle, sweep / 2.0, via, k)
        targets[k] = end
        k, i = k + 1, end
    return targets[:k], circular[:k], via[:k]


@kernel
def _farthest(arc: bool, run: PoseRun, i: int, last: int, tolerances: Float, circle: Float) -> int:
    """The farthest pose up to `last` that one move from pose i reaches: steps that double, then bisection."""
    reached, beyond, step = i + 1, last + 1, 2
    while i + step <= last:
        if not _fits(arc, run, i, i + step, tolerances, circle):
            beyond = i + step
            break
        reached, step = i + step, 2 * step
    while beyond - reached > 1:
        j = (reached + beyond) // 2
        if _fits(arc, run, i, j, tolerances, circle):
            reached = j
        else:
            beyond = j
    return reached


@kernel
def _fits(arc: bool, run: PoseRun, i: int, j: int, tolerances: Float, circle: Float) -> bool:
    """Whether one move from pose i to pose j passes all poses between them."""
    p, q, feed = run.position, run.quaternion, run.feed
    slowest, fastest = feed[j, 0], feed[j, 0]
    for k in range(i + 1, j):
        slowest, fastest = min(slowest, feed[k, 0]), max(fastest, feed[k, 0])
    if fastest > (1.0 + feed[j, 1]) * slowest * (1.0 + 1e-12):
        return False
    sweep = circle_through(p, i, _middle(run.length, i, j), j, circle) if arc else 0.0
    if sweep > MOST_SWEEP:
        return False
    sign, turn = _turn(q, i, j)
    if not arc and turn > tolerances[2]:
        return False
    if sweep > 0.0 and _bulges(p, i, j, 8.0 * circle[RADIUS] * tolerances[0]):
        return False
    before = 0.0
    for k in range(i + 1, j):
        if sweep > 0.0:
            distance, fraction = _off_circle(p, k, circle, sweep)
        else:
            distance, fraction = _off_line(p, i, j, k)
        if distance > tolerances[0] or fraction < before - BACKWARDS or fraction > 1.0 + BACKWARDS:
            return False
        if _off_slerp(q, i, j, k, sign, turn, fraction) > tolerances[1]:
            return False
        before = max(before, fraction)
    return True


@kernel
def _turn(q: Float, i: int, j: int) -> tuple[float, float]:
    """The sign under which quaternion j is the nearer to i, and the angle between them: half the rotation's."""
    dot, apart = 0.0, 0.0
    for c in range(4):
        dot += q[i, c] * q[j, c]
    sign = 1.0 if dot >= 0.0 else -1.0
    for c in range(4):
        apart += (sign * q[j, c] - q[i, c]) ** 2
    return sign, 2.0 * math.asin(min(1.0, math.sqrt(apart) / 2.0))


@kernel
def _bulges(p: Float, i: int, j: int, most: float) -> bool:
    """Whether an arc bulges too far from the chords between poses i to j: the square of one is more than `most`."""
    for k in range(i, j):
        step = 0.0
        for c in range(3):
            step += (p[k + 1, c] - p[k, c]) ** 2
        if step > most:
            return True
    return False


@kernel
def _middle(length: Float, i: int, j: int) -> int:
    """The pose between i and j, i + 1 < j, whose length of path comes next to the middle."""
    m, last, half = i + 1, j, 0.5 * (length[i] + length[j])
    while m < last:  # the first at or beyond the middle
        k = (m + last) // 2
        if length[k] < half:
            m = k + 1
        else:
            last = k
    if length[m] + length[m - 1] > length[i] + length[j]:
        m -= 1
    return min(max(m, i + 1), j - 1)


@kernel
def circle_through(p: Float, i: int, m: int, j: int, circle: Float) -> float:
    """Fill in the circle through poses i, m, j and return its sweep from i over m to j; 0 if they lie on a line."""
    aa, bb, ab, nn = 0.0, 0.0, 0.0, 0.0  # of a from i to m and b from i to j, and their cross product
    for c in range(3):
        d, e = (c + 1) % 3, (c + 2) % 3
        a, b = p[m, c] - p[i, c], p[j, c] - p[i, c]
        circle[NORMAL + c] = (p[m, d] - p[i, d]) * (p[j, e] - p[i, e]) - (p[m, e] - p[i, e]) * (p[j, d] - p[i, d])
        aa, bb, ab, nn = aa + a * a, bb + b * b, ab + a * b, nn + circle[NORMAL + c] ** 2
    if nn <= ON_A_LINE * aa * bb:
        return 0.0
    square = 0.0
    for c in range(3):
        a, b = p[m, c] - p[i, c], p[j, c] - p[i, c]
        circle[ALONG + c] = -(bb * (aa - ab) * a + aa * (bb - ab) * b) / (2.0 * nn)  # from the centre to the start
        circle[CENTRE + c] = p[i, c] - circle[ALONG + c]
        square += circle[ALONG + c] ** 2
    circle[RADIUS] = math.sqrt(square)
    for c in range(3):
        circle[ALONG + c] /= circle[RADIUS]
        circle[NORMAL + c] /= math.sqrt(nn)
    x, y = 0.0, 0.0  # of the end
    for c in range(3):
        d, e = (c + 1) % 3, (c + 2) % 3
        circle[INWARD + c] = circle[NORMAL + d] * circle[ALONG + e] - circle[NORMAL + e] * circle[ALONG + d]
        x += (p[j, c] - circle[CENTRE + c]) * circle[ALONG + c]
        y += (p[j, c] - circle[CENTRE + c]) * circle[INWARD + c]
    sweep = math.atan2(y, x)
    return sweep if sweep > 0.0 else sweep + 2.0 * math.pi


@kernel
def _on_circle(circle: Float, angle: float, via: Float, k: int) -> None:
    """Fill in point k: that of the circle at an angle from its start."""
    x, y = circle[RADIUS] * math.cos(angle), circle[RADIUS] * math.sin(angle)
    for c in range(3):
        via[k, c] = circle[CENTRE + c] + x * circle[ALONG + c] + y * circle[INWARD + c]


@kernel
def _off_circle(p: Float, k: int, circle: Float, sweep: float) -> tuple[float, float]:
    """Distance of pose k from the circle, and the share of the sweep at which it lies."""
    x, y, z = 0.0, 0.0, 0.0
    for c in range(3):
        d = p[k, c] - circle[CENTRE + c]
        x, y, z = x + d * circle[ALONG + c], y + d * circle[INWARD + c], z + d * circle[NORMAL + c]
    return math.hypot(math.hypot(x, y) - circle[RADIUS], z), math.atan2(y, x) / sweep


@kernel
def _off_line(p: Float, i: int, j: int, k: int) -> tuple[float, float]:
    """Distance of pose k from the line from i to j, and the share of that line at which it lies."""
    dd, ee, de = 0.0, 0.0, 0.0
    for c in range(3):
        d, e = p[k, c] - p[i, c], p[j, c] - p[i, c]
        dd, ee, de = dd + d * d, ee + e * e, de + d * e
    if ee == 0.0:
        return math.sqrt(dd), 0.0
    off = 0.0  # not dd - de^2 / ee, which would lose all digits where the line is long
    for c in range(3):
        off += (p[k, c] - p[i, c] - de / ee * (p[j, c] - p[i, c])) ** 2
    return math.sqrt(off), de / ee


@kernel
def _off_slerp(q: Float, i: int, j: int, k: int, sign: float, turn: float, fraction: float) -> float:
    """Chord between quaternion k and the one at `fraction` of the turn from i to j."""
    if turn > 1e-12:
        from_i = math.sin((1.0 - fraction) * turn) / math.sin(turn)
        from_j = sign * math.sin(fraction * turn) / math.sin(turn)
    else:
        from_i, from_j = 1.0 - fraction, sign * fraction
    plus, minus = 0.0, 0.0
    for c in range(4):
        there = from_i * q[i, c] + from_j * q[j, c]
        plus, minus = plus + (there - q[k, c]) ** 2, minus + (there + q[k, c]) ** 2
    return math.sqrt(min(plus, minus))


def rounding_mm(position_mm: Float, via_mm: Float, circular: Shaped[Bool, " k"], zone_mm: float) -> Float:
    """How far from each target (k,) the path passes that is rounded off from `zone_mm` before to `zone_mm` after it.

    Controllers round corners by parabolas, which pass the corner at half the distance of their chord's middle, and
    begin no earlier than half-way. Infinite where a move has no length, since nothing tells its direction; 0 at both
    ends of the path.

    Args:
        position_mm: targets (k, 3).
        via_mm: middles of circular moves (k, 3).
        circular: (k,) over `via_mm`, else straight.
        zone_mm: where the rounding may begin.
    """
    start, end = position_mm[:-1], position_mm[1:]
    length = np.linalg.norm(end - start, axis=1)
    with np.errstate(invalid="ignore", divide="ignore"):
        chord = (end - start) / length[:, None]
        leave = np.where(circular[1:, None], _mirrored(chord, via_mm[1:] - start), chord)
        arrive = np.where(circular[1:, None], _mirrored(chord, end - via_mm[1:]), chord)
        sine = np.linalg.norm(leave[1:] - arrive[:-1], axis=1) / 2.0  # of half the angle that the path turns
        off = np.minimum(zone_mm, np.minimum(length[1:], length[:-1]) / 2.0) * sine / 2.0
    return np.concatenate([[0.0], np.where(np.isfinite(off), off, np.inf), [0.0]])


def _mirrored(chord: Float, way: Float) -> Float:
    """The chord's direction mirrored at that of the way to or from the arc's middle: the tangent at that end."""
    along = way / np.linalg.norm(way, axis=1, keepdims=True)
    return np.asarray(2.0 * (along * chord).sum(axis=1, keepdims=True) * along - chord)


# Times of a path, and its feeds.


def within(x: Float, places: Float, reach: float) -> Bool:
    """Whether each x (n,) is no farther than `reach` from one of the places (p,), in any order; NaN: it is not.

    Example:
        >>> within(np.array([0.0, 2.0, np.nan]), np.array([6.0, 1.0]), 1.0).tolist()
        [True, True, False]
    """
    padded = np.concatenate([[-np.inf], np.sort(places), [np.inf]])
    after = np.searchsorted(padded[1:-1], x) + 1
    return np.asarray(np.minimum(x - padded[after - 1], padded[after] - x) <= reach)


def runs(which: Bool) -> list[tuple[int, int]]:
    """First and last index of each run of True in (n,)."""
    ends = np.flatnonzero(np.diff(np.r_[False, which, False]))
    return [(int(a), int(b) - 1) for a, b in zip(ends[::2], ends[1::2], strict=True)]


def chords_mm(position_mm: Float) -> Float:
    """(k - 1,) distances of points (k, 3) from the one before."""
    return np.asarray(np.linalg.norm(np.diff(position_mm, axis=0), axis=1))


def arc_lengths_mm(position_mm: Float) -> Float:
    """(k,) way along chords from the first of points (k, 3) to each."""
    return np.append(0.0, np.cumsum(chords_mm(position_mm)))


def step_lengths_mm(position_mm: Float) -> Float:
    """(k,) distance of each point (k, 3) from the one before it; 0 for the first."""
    return np.concatenate([np.zeros(min(1, len(position_mm))), chords_mm(position_mm)])


def step_times_s(position_mm: Float, feed_mm_s: Float) -> Float:
    """(k,) time of the step to each point (k, 3) at its feed (k,), which is the feed towards it; 0 for the first."""
    return step_lengths_mm(position_mm) / feed_mm_s


def travel_time_s(position_mm: Float, feed_mm_s: Float) -> float:
    """Time from the first point (k, 3) to the last at the feeds towards each (k,), in s."""
    return float(step_times_s(position_mm, feed_mm_s).sum())


def limit_acceleration(feed_mm_s: Float, step_mm: Float, acceleration_mm_s2: float) -> Float:
    """The greatest feeds (k,) not above `feed_mm_s` between which |v dv/ds| stays within the acceleration.

    `step_mm` (k,) is the distance to each point from the one before it. v^2 may change by twice acceleration times
    distance: one pass forwards for speeding up, one backwards for slowing down.
    """
    square = np.square(feed_mm_s)
    _limit(square, as_input(step_mm), 2.0 * float(acceleration_mm_s2))
    return np.sqrt(square)


@kernel
def _limit(square: Float, step: Float, slope: float) -> None:
    for k in range(1, square.size):
        square[k] = min(square[k], square[k - 1] + slope * step[k])
    for k in range(square.size - 1, 0, -1):
        square[k - 1] = min(square[k - 1], square[k] + slope * step[k])


def interpolated(at: Float, s: Float, values: Float) -> Float:
    """Values (n, d) at rising places s (n,), linear between them, at places (k,)."""
    return np.stack([np.interp(at, s, column) for column in values.T], axis=1)
