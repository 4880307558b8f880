"""Circles joined with the flange's poses: one observation a posture held still, one a frame of a scan.

Repeats of a still posture share its pose error, so they are averaged. The poses of a scan are interpolated between
recorded ones, and so are their errors: frames between the same two recorded poses share these poses' errors.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np
import scipy
from numpy.polynomial.chebyshev import chebder, chebval, chebvander

from workbench.api import (
    Bool,
    Float,
    Int,
    Recording,
    Shaped,
    estimator,
    interpolate_poses,
    rotation_from_quaternion,
    rotation_from_vector,
    vector_from_rotation,
)
from workbench.plugins.calibration.values import Rejected, SphereProfiles

REPEAT_GATE = 25.0  # squared Mahalanobis distance of a repeat from the median of its posture: 3 degrees of freedom
DIFFERENCE_S = 1e-4  # for turning a rotation vector's rate into a spin
MARGIN_S = 0.3  # of poses before and after a scan's frames that tell its motion
PIECE_S = 4.0  # of a long scan, whose motion is taken for one polynomial
MAX_DEGREE = 15  # of the polynomial in time that a scan's motion is taken for; fewer poses are too few for a piece


@dataclass(frozen=True)
class Flange:
    """Poses of the flange at k observations, and what their errors share."""

    base_from_flange: Shaped[Float, "k 4 4"]
    velocity: Shaped[Float, "k 6"]  # of the flange, in the flange frame: mm/s, rad/s; 0 at rest
    evened: Shaped[Float, " k"]  # variance of an interpolated pose's own error over a recorded one's: 1/2 to 1
    scans: tuple[estimator.Shared, ...]  # whose pose errors come from the same recorded poses; in the order of time

    def at(self, offset_s: float) -> Flange:
        """These: they are placed."""
        return self

    def subset(self, keep: Bool) -> Flange:
        """Those marked in `keep` (k,)."""
        scans = (scan.only(keep) for scan in self.scans if keep[scan.rows].any())
        rows = (self.base_from_flange[keep], self.velocity[keep], self.evened[keep])
        return Flange(*rows, tuple(scans))


@dataclass(frozen=True)
class Timed:
    """When k observations were made, by a clock whose offset to the robot's is unknown."""

    time_s: Shaped[Float, " k"]
    number: Shaped[Int, " k"]  # pass
    motions: Mapping[int, Motion]  # of the passes

    def subset(self, keep: Bool) -> Timed:
        """Those marked in `keep` (k,)."""
        return replace(self, time_s=self.time_s[keep], number=self.number[keep])

    @property
    def range_s(self) -> tuple[float, float]:
        """Clock offsets (profile time - robot time) with which every frame of every scan lies within its poses."""
        moving = [(self.motions[n].time_s, self.time_s[self.number == n]) for n in np.unique(self.number).tolist()]
        ends = [(time[-1] - robot[-1], time[0] - robot[0]) for robot, time in moving if len(robot) > 1]
        return max(low for low, _ in ends), min(high for _, high in ends)

    def at(self, offset_s: float) -> Flange:
        """The flange at these times minus the offset."""
        k, scans, moving = len(self.time_s), list[estimator.Shared](), list[tuple[Float | Int, ...]]()
        poses, velocity, evened = np.empty((k, 4, 4)), np.zeros((k, 6)), np.ones(k)
        for this in np.unique(self.number).tolist():
            rows, motion = np.flatnonzero(self.number == this), self.motions[this]
            time = motion.time_s
            at = np.clip(self.time_s[rows] - offset_s, time[0], time[-1])
            chords = interpolate_poses(at, time, motion.position_mm, motion.quaternion)
            if len(time) == 1:
                poses[rows] = chords
                continue
            node = np.clip(np.searchsorted(time, at, side="right") - 1, 0, len(time) - 2)
            step = time[node + 1] - time[node]
            fraction = (at - time[node]) / step
            chord = 0.5 * fraction * (1 - fraction) * step**2
            moving.append((rows, chords, chord, *motion.at(at)))
            evened[rows] = fraction**2 + (1 - fraction) ** 2
            near = np.union1d(node, node + 1)  # the others have no part in any frame
            none = np.zeros((len(rows), 0, 0))
            pose = np.searchsorted(near, node)
            scans.append(estimator.Shared(rows, none, none, pose, fraction, len(near) - 1, none))
        if moving:
            rows, *bent = map(np.concatenate, zip(*moving, strict=True))
            poses[rows], velocity[rows] = _off_the_chord(*bent)
        return Flange(poses, velocity, evened, tuple(scans))


def _off_the_chord(poses: Float, chord: Float, middle: Float, rate: Float, bend: Float) -> tuple[Float, Float]:
    """Poses (m, 4, 4), and velocities (m, 6) in the flange's own frame, mm/s and rad/s, of interpolated ones.

    Between two recorded poses a motion leaves their chord by its second derivative times `chord` (m,), s^2: a weave
    that is sampled coarsely would seem too small, and the sensor's scales wrong.
    """
    poses[:, :3, 3] -= chord[:, None] * bend[:, :3]
    vector = vector_from_rotation(middle.mT @ poses[:, :3, :3]) - chord[:, None] * bend[:, 3:]
    now, then = middle @ rotation_from_vector(np.stack([vector, vector + DIFFERENCE_S * rate[:, 3:]]))
    poses[:, :3, :3] = now
    back = now.mT
    linear = (back @ rate[:, :3, None])[..., 0]
    return poses, np.concatenate([linear, vector_from_rotation(back @ then) / DIFFERENCE_S], axis=1)


class Motion:
    """A pass's recorded poses, and how the flange moved between them."""

    def __init__(self, recording: Recording, number: int) -> None:
        here = recording.robot_pass == number
        self.time_s, self.position_mm = recording.robot_time_s[here], recording.robot_position_mm[here]
        self.quaternion = recording.robot_quaternion_wxyz[here]
        self._smooth = functools.cache(self._fitted)  # a search comes back to its windows

    def at(self, time_s: Float) -> tuple[Float, Float, Float]:
        """Middle orientations (m, 3, 3) at rising times (m,); first and second derivatives (m, 6) about them.

        Both derivatives are those of a smooth motion: differences of neighbouring poses would pass their noise for
        motion, and so find a clock offset where none shows.
        """
        rate, bend = np.empty((2, len(time_s), 6))
        middle = np.empty((len(time_s), 3, 3))
        piece = np.floor((time_s - time_s[0]) / PIECE_S).astype(int)
        for one in np.unique(piece):
            here = piece == one
            at = time_s[here]
            first, last = np.searchsorted(self.time_s, [at[0] - MARGIN_S, at[-1] + MARGIN_S]).tolist()
            window = (first, last) if last - first > MAX_DEGREE else (0, len(self.time_s))
            middle[here], derivatives = self._smooth(*window)
            rate[here], bend[here] = derivatives(at)
        return middle, rate, bend

    def _fitted(self, first: int, last: int) -> tuple[Float, Callable[[Float], tuple[Float, Float]]]:
        """The motion of the poses `first` to before `last`: polynomials of the degrees that they deserve.

        Their middle orientation (3, 3), and the first and second derivatives (m, 6) at times (m,) of the position and
        of the rotation vector from there.
        """
        rotation = rotation_from_quaternion(self.quaternion[first:last])
        middle = rotation[len(rotation) // 2]
        rotation_vector = vector_from_rotation(middle.T @ rotation)  # small enough to be unique within a scan
        time, position = self.time_s[first:last], self.position_mm[first:last]
        half = (time[-1] - time[0]) / 2
        x = (time - time[0]) / half - 1.0
        both = [_series(x, position - position[0]), _series(x, rotation_vector)]
        size = max(len(one) for one in both)
        series = np.concatenate([np.pad(one, ((0, size - len(one)), (0, 0))) for one in both], axis=1)
        rate, bend = chebder(series) / half, chebder(series, 2) / half**2

        def derivatives(time_s: Float) -> tuple[Float, Float]:
            x = (time_s - time[0]) / half - 1.0
            return chebval(x, rate).T, chebval(x, bend).T

        return middle, derivatives


def _series(x: Float, values: Float) -> Float:
    """Chebyshev series (degree + 1, 3) through values (K, 3) at x (K,) from -1 to 1; the degree by Bayes' criterion."""
    most = min(MAX_DEGREE, max(1, len(x) // 2 - 1))
    basis, triangle = np.linalg.qr(chebvander(x, most))
    parts = basis.T @ values
    left = np.sum(values**2) - np.cumsum(np.sum(parts**2, axis=1)) + 1e-12 * np.sum(values**2)
    score = values.size * np.log(np.maximum(left, 1e-300)) + 3 * np.arange(1, most + 2) * np.log(values.size)
    size = 2 + int(score[1:].argmin())
    return np.linalg.solve(triangle[:size, :size], parts[:size])


@dataclass(frozen=True)
class Observations:
    """k observations: circles with their covariance, and where the flange was at each."""

    circle: Shaped[Float, "k 3"]  # x_c, z_c mm, w mm^2; repeats averaged
    covariance: Shaped[Float, "k 3 3"]
    by_scale: Shaped[Float, "k 3 s"]  # change with the errors of the profiler's x and z that are taken out; s = 0: none
    scale: Shaped[Float, " s"]  # errors that are taken out
    flange: Flange | Timed
    frames: tuple[tuple[int, ...], ...]  # (k) of the recording
    rejected: tuple[Rejected, ...] = ()  # repeats that contradict the others

    def __len__(self) -> int:
        return len(self.circle)

    def circle_at(self, scale: Float) -> Float:
        """The circles (k, 3) with other errors (s,) taken out."""
        return self.circle + self.by_scale @ (scale - self.scale)

    @property
    def here(self) -> Flange:
        """Where the flange was; by an open clock as if it were the robot's."""
        return self.flange.at(0.0)

    def place(self, offset_s: float) -> Observations:
        """With the flange where it was if the profiles' clock is ahead by so much."""
        return replace(self, flange=self.flange.at(offset_s))

    def subset(self, keep: Bool) -> Observations:
        """Those marked in `keep` (k,)."""
        frames = tuple(f for f, kept in zip(self.frames, keep, strict=True) if kept)
        parts = {name: getattr(self, name)[keep] for name in ("circle", "covariance", "by_scale")}
        return replace(self, flange=self.flange.subset(keep), frames=frames, **parts)


def from_arrays(circle: Float, covariance: Float, base_from_flange: Float) -> Observations:
    """Observations of postures held still, each with a pose error of its own: (k, 3), (k, 3, 3), (k, 4, 4)."""
    k = len(circle)
    at_rest = Flange(base_from_flange, np.zeros((k, 6)), np.ones(k), ())
    return Observations(
        circle, covariance, circle[..., None][..., :0], np.zeros(0), at_rest, tuple((i,) for i in range(k))
    )


def flange_of(recording: Recording, time_s: Float, number: Int, own_clock: bool) -> Flange | Timed:
    """Where the flange was at times (k,) in passes `number` (k,); by an own clock that scans tell, at any offset."""
    timed = Timed(time_s, number, {n: Motion(recording, n) for n in np.unique(number).tolist()})
    moves = any(len(one.time_s) > 1 for one in timed.motions.values())
    return timed if own_clock and moves else timed.at(0.0)


def grouped(recording: Recording, frame: Int, search_s: float = 0.0) -> list[Int]:
    """Rows of frames (n,) that are one observation: all of a posture held still, each of a scan.

    Without those nearer than `search_s` to the ends of their scan's poses: the clocks may be so far apart.
    """
    number, time, groups = recording.pass_index[frame], recording.time_s[frame], list[Int]()
    for this in np.unique(number):
        rows, when = np.flatnonzero(number == this), recording.robot_time_s[recording.robot_pass == this]
        if len(when) == 1:
            groups.append(rows)
            continue
        inside = (time[rows] > when[0] + search_s) & (time[rows] < when[-1] - search_s)
        groups += list(rows[inside | (search_s == 0.0)][:, None])
    return groups


def by_pass(profiles: SphereProfiles, recording: Recording) -> Observations:
    """Circles in the order of their passes; the repeats of a posture held still averaged."""
    groups, rejected = list[Int](), list[Rejected]()
    for rows in grouped(recording, profiles.frame):
        good = _agreeing(profiles.circle[rows], profiles.covariance[rows])
        groups.append(rows[good])
        rejected += [Rejected(f, "contradicts the other repeats of its posture") for f in profiles.frame[rows[~good]]]
    inverses = [np.linalg.inv(profiles.covariance[rows]) for rows in groups]
    covariance = np.array([np.linalg.inv(one.sum(axis=0)) for one in inverses])
    circle = np.array(
        [
            spread @ np.einsum("kij,kj->i", one, profiles.circle[rows])
            for spread, one, rows in zip(covariance, inverses, groups, strict=True)
        ]
    )
    frames = tuple(tuple(profiles.frame[rows].tolist()) for rows in groups)
    time = np.array([recording.time_s[list(one)].mean() for one in frames])
    passes = recording.pass_index[[one[0] for one in frames]]
    flange = flange_of(recording, time, passes, recording.clock == "own")
    return Observations(circle, covariance, circle[..., None][..., :0], np.zeros(0), flange, frames, tuple(rejected))


def sharing(scan: estimator.Shared, alone: Float, own: Float, whole: Float) -> estimator.Shared:
    """A scan with the errors of all k observations: theirs alone (k, d, d), a pose's (k, d, e), common (k, d, v)."""
    return replace(scan, alone=alone[scan.rows], own=own[scan.rows], whole=whole[scan.rows])


def posture_of(base_from_flange: Float, same_mm: float, same_rad: float) -> Int:
    """Number (k,) of the posture of each pose (k, 4, 4): poses nearer than both together are one."""
    turn = base_from_flange[:, :3, :3].reshape(-1, 9)  # sqrt(2) of a small turn apart
    apart = np.hypot(
        scipy.spatial.distance.pdist(base_from_flange[:, :3, 3]) / same_mm,
        scipy.spatial.distance.pdist(turn) / (np.sqrt(2.0) * same_rad),
    )
    near = scipy.spatial.distance.squareform(apart) <= 1.0
    return np.asarray(scipy.sparse.csgraph.connected_components(near, directed=False)[1])


def _agreeing(circle: Float, covariance: Float) -> Bool:
    """Which repeats (m,) lie about their median: with three or more, a jump in one is not averaged in."""
    if len(circle) < 3:
        return np.ones(len(circle), bool)
    off = circle - np.median(circle, axis=0)
    distance = np.einsum("ki,kij,kj->k", off, np.linalg.inv(2 * covariance), off)
    spread = max(1.0, np.median(distance) / 2.4)  # 2.4: the median of chi-square with 3 degrees of freedom
    return np.asarray(distance < REPEAT_GATE * spread)
