"""The motion that the poses tell against the motion that the profiles show: way, twist, jumps."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from workbench.checks.profiles import MEDIAN, Chain
from workbench.checks.sensor import some
from workbench.geometry.along import by_pass
from workbench.units import DEG, THIRD, Float, Int, Shaped

REACH, LONG = 3, 20  # profiles on each side, for the direction of the way; of a stretch that is looked at without ends
LEAST_STRETCH = 6  # profiles: fewer tell nothing of a way
SURE = 3.0  # standard uncertainties by which a turn of the section is one
MOST_OBLIQUE_DEG = 45.0  # a laser plane further from square to the edge measures nothing
LEAST_SINE = 0.1  # of the angle between a section's line and the way
LEAST_MM = 1e-6  # of way between them
LEAST_REACH_MM = 1.0  # on each side of a place, for its tangent
DEGREE = 5  # in arc length, of how a plate may be twisted: a turn, there and back again
TWISTED_MM = 150.0  # of edge, over which a twist is told


@dataclass(frozen=True, slots=True)
class Consistency:
    """How poses and profiles agree over all passes; NaN where nothing tells."""

    obliquity_deg: float  # between the laser plane's normal and the edge, the worst pass's median
    varies_deg: float  # of that angle within a pass: half of its middle nine tenths, or of what is slow of it
    twist_deg: float  # greatest turn of the section about the edge, over 150 mm or less of it
    unsteady_deg: float  # greatest turn of it that is no slow function of the place on the edge
    swing_deg: float  # how much the edge's direction varies against the laser plane, in any sense: nine tenths of it
    pose_noise_mm: float  # robust standard deviation of its place across its way, less what the view itself shows

    @property
    def waved_deg(self) -> float:
        """What an edge that waves under an oblique laser plane turns the section about itself at most, deg."""
        return self.swing_deg * math.tan(min(self.obliquity_deg, MOST_OBLIQUE_DEG) * DEG)


@dataclass(frozen=True, slots=True, eq=False)
class Way:
    """The way of the edge through the base, at each profile; NaN where too few profiles go together."""

    arc_mm: Shaped[Float, " k"]  # along the edge, against the motion where the scanner goes back
    tangent: Shaped[Float, "k 3"]  # towards greater arc length
    oblique_deg: Shaped[Float, " k"]  # between the tangent and the laser plane's normal


def consistency(chains: Mapping[int, Chain], base_from_profiler: Mapping[int, Float]) -> Consistency:
    """Carry each pass's section through the base by the poses (k, 4, 4) at its chain's profiles.

    A plate's edge looks the same in neighbouring profiles; so a point that goes with the section runs along the edge,
    and the section turns about the edge only where the plate is twisted. The angle between the edge and the normal of
    the laser plane is small in a scan that measures anything; where orientation or hand-eye pose are wrong it is large.
    """
    found = [_of_pass(chains[number], base_from_profiler[number]) for number in chains]
    table = np.array([one for one in found if one is not None])
    return Consistency(*(table.max(axis=0).tolist() if len(table) else [float("nan")] * 6))


def _of_pass(chain: Chain, pose: Float) -> tuple[float, ...] | None:
    place, across, stretch = _carried_by(chain, pose)
    way = way_of(place, stretch, pose)
    here = np.isfinite(way.oblique_deg)
    if here.sum() < 2:
        return None
    # what is slow of it: an edge that is cut in parts goes there and back on short ramps, which the robot does not
    slow = twisted(np.arange(float(here.sum())))
    ranges = [
        np.ptp(np.percentile(one, [5, 95])) for one in (way.oblique_deg[here], slow @ (slow.T @ way.oblique_deg[here]))
    ]
    lateral = np.einsum("kij,ki->kj", pose[here][:, :3, [0, 2]], way.tangent[here])
    swing = np.degrees(np.linalg.norm(np.ptp(np.percentile(lateral, [5, 95], axis=0), axis=0)))
    return (
        float(np.median(way.oblique_deg[here])),
        float(min(ranges)) / 2.0,
        *_twist(across, way, stretch, chain.turn_u),
        float(swing),
        _pose_noise_mm(chain, place),
    )


def _pose_noise_mm(chain: Chain, place: Float) -> float:
    """By third differences of a place (k, 3), of which a bend of the way has none, less those of the point in view.

    A rough face, and a part that moves, wander in the view as they do in the base; poses that jump do not.
    """
    point, _, stretch = chain.track
    together = stretch[3:] == stretch[:-3]
    if together.sum() < LEAST_STRETCH:
        return 0.0
    bend, chord = np.diff(place, n=3, axis=0)[together], (place[3:] - place[:-3])[together]
    size = np.maximum(np.linalg.norm(chord, axis=1), LEAST_MM)
    across = np.median(np.linalg.norm(np.cross(bend, chord), axis=1) / size)
    seen = np.median(np.linalg.norm(np.diff(point, n=3, axis=0)[together], axis=1))
    return math.sqrt(max(float(across**2 - seen**2), 0.0)) / MEDIAN / THIRD


def chord_obliquity_deg(chains: Mapping[int, Chain], base_from_profiler: Mapping[int, Float]) -> float:
    """As `consistency` has it, by chords of the edge's way between five profiles of each pass; quick, and rough."""
    return max((_chords_deg(chains[number], base_from_profiler[number]) for number in chains), default=0.0)


def _chords_deg(chain: Chain, pose: Float) -> float:
    at = some(np.arange(len(pose)), 5)
    chord = np.diff(_carried_by(chain, pose)[0][at], axis=0)
    normal = pose[at[1:], :3, 1] + pose[at[:-1], :3, 1]
    size = np.linalg.norm(chord, axis=1) * np.linalg.norm(normal, axis=1)
    cosine = np.abs(np.einsum("ki,ki->k", chord, normal)) / np.maximum(size, LEAST_MM)
    return float(np.degrees(np.arccos(np.clip(np.median(cosine), 0.0, 1.0))))


def _carried_by(chain: Chain, pose: Float) -> tuple[Float, Float, Int]:
    """Places (k, 3) and directions (k, 3) of the section in the base, and the stretch (k,) that each is in."""
    point, turn, stretch = chain.track
    place = np.einsum("kij,kj->ki", pose[:, :3, :3], _spatial(point)) + pose[:, :3, 3]
    across = np.einsum("kij,kj->ki", pose[:, :3, :3], _spatial(np.stack([np.cos(turn), np.sin(turn)], axis=1)))
    return place, across, stretch


def _spatial(point: Float) -> Float:
    """Points or directions (k, 2) of the laser plane in the profiler frame."""
    return np.stack([point[:, 0], np.zeros(len(point)), point[:, 1]], axis=1)


def way_of(place: Float, stretch: Int, pose: Float) -> Way:
    """The edge's way through the base: places (k, 3) of stretches (k,) of profiles at poses (k, 4, 4).

    Arc length is counted along the laser plane's normal, with its sign, so a part of the edge that is seen on the way
    there and on the way back is the same part; a place's tangent is the line through all places near it along the edge.
    """
    normal = pose[:, :3, 1]
    arc, tangent = np.full(len(place), np.nan), np.full((len(place), 3), np.nan)
    for at in by_pass(stretch):
        if len(at) < min(LEAST_STRETCH, len(place)):
            continue
        arc[at], tangent[at] = _line_of(place[at], normal[at])
    cosine = np.abs(np.einsum("ki,ki->k", tangent, normal))
    return Way(arc, tangent, np.degrees(np.arccos(np.clip(cosine, 0.0, 1.0))))


def _line_of(place: Float, normal: Float) -> tuple[Float, Float]:
    """Arc length (n,) and tangents (n, 3) of one stretch."""
    step = np.diff(place, axis=0)
    size = np.linalg.norm(step, axis=1)
    ahead = np.einsum("ki,ki->k", step, (normal[1:] + normal[:-1]) / 2.0)
    arc = np.concatenate([[0.0], np.cumsum(ahead)])
    if np.ptp(arc) < LEAST_SINE * np.linalg.norm(place.max(axis=0) - place.min(axis=0)):
        arc = np.concatenate([[0.0], np.cumsum(size)])  # the way lies in the laser plane: orientations are wrong
    near = np.abs(arc[:, None] - arc) <= max(REACH * float(np.median(size)), LEAST_REACH_MM)
    count = near.sum(axis=1)
    mean = near @ arc / count
    square = np.einsum("ij,ij->i", near, (arc - mean[:, None]) ** 2)
    middle = near @ place / count[:, None]
    slope = np.einsum("ij,ijk->ik", near * (arc - mean[:, None]), place - middle[:, None])
    slope = slope / np.maximum(square, LEAST_MM)[:, None]
    size = np.linalg.norm(slope, axis=1)
    return arc, np.where((size > LEAST_MM)[:, None], slope / np.maximum(size, LEAST_MM)[:, None], np.nan)


def _twist(across: Float, way: Way, stretch: Int, turn_u: Float) -> tuple[float, float]:
    """Turn (deg) of directions `across` about the way, against directions carried along without twist.

    The greatest over 150 mm of edge or less, and the greatest that is no slow function of the place on the edge.
    """
    greatest, unsteady = 0.0, 0.0
    size = np.bincount(stretch)
    for number in np.flatnonzero(2 * size >= size.max()):  # shorter ones lie between clamps, and may show these
        at = np.flatnonzero((stretch == number) & np.isfinite(way.tangent[:, 0]))
        at = at[REACH:-REACH] if len(at) > LONG else at  # at its ends a tangent hangs on the last place
        angle = _turns(across, way.tangent, at)
        if angle is None:
            continue
        u = SURE * math.sqrt(float((turn_u[at[:-1]] ** 2).sum()))
        arc = way.arc_mm[at]
        turn = max(float(np.ptp(angle)) - u, 0.0) / max(float(np.ptp(arc)) / TWISTED_MM, 1.0)
        rest = angle - twisted(arc) @ (twisted(arc).T @ angle)
        greatest, unsteady = max(greatest, turn / DEG), max(unsteady, (float(np.ptp(rest)) - u) / DEG)
    return greatest, unsteady


def twisted(arc: Float, degree: int = DEGREE) -> Float:
    """Orthonormal columns (k, <= degree + 1): slow functions of arc length (k,), as a plate may be twisted."""
    low, high = float(arc.min()), float(arc.max())
    share = (2.0 * arc - low - high) / max(high - low, LEAST_MM)
    degree = min(degree, len(arc) // 4)
    return np.asarray(np.linalg.qr(np.polynomial.legendre.legvander(share, degree))[0])


def _turns(across: Float, tangent: Float, at: Int) -> Float | None:
    """Turn (n,) rad about the way at the places `at`; None where the section lies along it."""
    if len(at) < LEAST_STRETCH:
        return None
    t, a = tangent[at], across[at]
    normal = a - np.einsum("ki,ki->k", a, t)[:, None] * t
    size = np.linalg.norm(normal, axis=1)
    if (size < LEAST_SINE).any():
        return None
    normal /= size[:, None]
    carried = _carried(normal[:-1], t[:-1], t[1:])
    sine = np.einsum("ki,ki->k", np.cross(carried, normal[1:]), t[1:])
    steps = np.arctan2(sine, np.einsum("ki,ki->k", carried, normal[1:]))
    return np.concatenate([[0.0], np.cumsum(steps)])


def _carried(vector: Float, start: Float, end: Float) -> Float:
    """Vectors (n, 3), each turned by the shortest turn from unit vector `start` to unit vector `end`."""
    axis, cosine = np.cross(start, end), np.einsum("ki,ki->k", start, end)[:, None]
    return np.asarray(
        vector + np.cross(axis, vector) + np.cross(axis, np.cross(axis, vector)) / np.maximum(1.0 + cosine, 1e-9)
    )


JUMP_POSES = 12  # of a pass
ALIKE = 0.5  # of the faster velocity, by which those before and after a jump may differ: they are one motion
SINGLE = 8.0  # times what nine in ten of a pass's poses are off: a jump is single, noise and sway are everywhere


def jump_mm(time_s: Float, position_mm: Float, pass_index: Int) -> float:
    """The greatest single jump of positions (k, 3) at times (k,), against the motion before and after it, mm.

    Over three steps: a pose that comes late, and is made up for, is none. Velocities are taken over as much time as the
    longest of these steps: over less, noise of the poses beside a drop-out is enlarged across it.
    """
    found = 0.0
    for mine in by_pass(pass_index):
        if mine.size < JUMP_POSES:
            continue
        time, place = time_s[mine], position_mm[mine]
        step, took = np.diff(place, axis=0), np.diff(time)
        first = np.arange(1, len(time) - 4)
        last = first + 3
        longest = np.max([took[1:-3], took[2:-2], took[3:-1]], axis=0)
        begin = np.minimum(np.searchsorted(time, time[first] - longest), first - 1)
        end = np.maximum(np.searchsorted(time, time[last] + longest, side="right") - 1, last + 1)
        before_s, while_s, after_s = np.maximum(np.diff(time[[begin, first, last, end]], axis=0), 1e-9)
        before = (place[first] - place[begin]) / before_s[:, None]
        after = (place[end] - place[last]) / after_s[:, None]
        way = place[last] - place[first]
        by_time = _beyond(way, before * while_s[:, None], after * while_s[:, None])
        off = np.minimum(by_time, _beyond(way, 3.0 * step[:-4], 3.0 * step[4:]))
        faster = np.maximum(np.linalg.norm(before, axis=1), np.linalg.norm(after, axis=1))
        alike = np.linalg.norm(before - after, axis=1) <= ALIKE * faster
        u = while_s / np.minimum(before_s, after_s)  # of a way that noisy shorter ones foretell, relative
        single = alike & (off > SINGLE * u * np.quantile(off / u, 0.9))
        for i in np.flatnonzero(single):  # a sway that is twice as long as a drop-out makes four times of what strays
            low, high = np.searchsorted(time, (time[first[i]] - 2.0 * longest[i], time[last[i]] + 2.0 * longest[i]))
            neighbours = slice(low, first[i] + 1), slice(last[i], high)
            if off[i] > max(found, *(0.5 * SINGLE * _stray_mm(time[poses], place[poses]) for poses in neighbours)):
                found = float(off[i])
    return found


def held_poses(rate: Float) -> int:
    """How many rates of poses (n,) in a row are 0 until the next one is a jump, which makes up for them; 0: none does.

    A robot that waits begins to move as it goes on; poses that come in steps make as large ones everywhere.

    Example:
        >>> time = np.linspace(0.0, 1.0, 400)
        >>> waits, stepped = time - np.clip(time, 0.4, 0.6), np.floor(40.0 * time)
        >>> hangs = np.where((time > 0.4) & (time < 0.6), 0.4, time)
        >>> [held_poses(np.abs(np.diff(way))) for way in (waits, stepped, hangs)]
        [0, 0, 79]
    """
    moving = np.flatnonzero(rate > 0.0)
    jumps = rate[moving] > SINGLE * np.quantile(np.append(rate[moving], 0.0), 0.9)
    return int((np.diff(moving, prepend=-1) - 1)[jumps].max(initial=0))


def _stray_mm(time: Float, place: Float) -> float:
    """By how much places (k, 3) at times (k,) stray from even motion from the first to the last."""
    share = (time - time[0]) / max(float(time[-1] - time[0]), 1e-9)
    return float(np.linalg.norm(place - place[0] - share[:, None] * (place[-1] - place[0]), axis=1).max())


def _beyond(way: Float, one: Float, other: Float) -> Float:
    """By how much ways (k, 3) miss what motions from `one` to `other` (k, 3) can go, mm: slowing down is no jump."""
    missed = np.linalg.norm(way - 0.5 * (one + other), axis=1) - 0.5 * np.linalg.norm(other - one, axis=1)
    return np.asarray(np.maximum(missed, 0.0))
