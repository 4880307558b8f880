"""Circles joined with the flange's poses: one observation a posture held still, one a frame of a scan.

Repeats of a still posture share its pose error, so they are averaged. The poses of a scan are interpolated between
recorded ones, and so are their errors: frames between the same two recorded poses share these poses' errors.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.polynomial.chebyshev import chebder, chebval, chebvander

from workbench.api import (
    Bool,
    Float,
    InputError,
    Int,
    Recording,
    Shaped,
    interpolate_poses,
    inverse,
    rotation_from_quaternion,
    rotation_from_vector,
    vector_from_rotation,
)
from workbench.plugins.calibration.values import Rejected, SphereProfiles

REPEAT_GATE = 25.0  # squared Mahalanobis distance of a repeat from the median of its posture: 3 degrees of freedom
DIFFERENCE_S = 1e-4  # for turning a rotation vector's rate into a spin
MARGIN_S = 0.3  # of poses before and after a scan's frames that tell its motion
PIECE_S = 4.0  # of a long scan, whose motion is taken for one polynomial
MAX_DEGREE = 15  # of the polynomial in time that a scan's motion is taken for
SAME_MM, SAME_RAD = 3.0, 0.0175  # poses nearer than both are one posture


@dataclass(frozen=True)
class Group:
    """Observations whose pose errors come from the same recorded poses, in the order of time."""

    rows: Shaped[Int, " m"]  # of the observations
    node: Shaped[Int, " m"]  # recorded pose before each, of those beside a frame
    fraction: Shaped[Float, " m"]  # of the way to the next one
    nodes: int  # recorded poses


@dataclass(frozen=True)
class Observations:
    """k observations: circles with their covariance, and the pose of the flange at each, with what its errors share."""

    circle: Shaped[Float, "k 3"]  # x_c, z_c mm, w mm^2
    covariance: Shaped[Float, "k 3 3"]
    base_from_flange: Shaped[Float, "k 4 4"]
    velocity: Shaped[Float, "k 6"]  # of the flange, in the flange frame: mm/s, rad/s; 0 at rest
    evened: Shaped[Float, " k"]  # variance of an interpolated pose's own error over a recorded one's: 1/2 to 1
    still: Shaped[Int, " s"]  # rows with a pose error of their own
    scans: tuple[Group, ...]
    frames: tuple[tuple[int, ...], ...]  # (k) of the recording

    def __len__(self) -> int:
        return len(self.circle)

    def place(self, offset_s: float = 0.0) -> Observations:
        """These: they are placed."""
        return self

    def subset(self, keep: Bool) -> Observations:
        """The observations marked in `keep` (k,)."""
        number = np.cumsum(keep) - 1
        scans = tuple(
            Group(number[g.rows[kept]], g.node[kept], g.fraction[kept], g.nodes)
            for g in self.scans
            if (kept := keep[g.rows]).any()
        )
        frames = tuple(f for f, kept in zip(self.frames, keep, strict=True) if kept)
        return Observations(
            self.circle[keep],
            self.covariance[keep],
            self.base_from_flange[keep],
            self.velocity[keep],
            self.evened[keep],
            number[self.still[keep[self.still]]],
            scans,
            frames,
        )


def from_arrays(circle: Float, covariance: Float, base_from_flange: Float) -> Observations:
    """Observations of postures held still, each with a pose error of its own: (k, 3), (k, 3, 3), (k, 4, 4)."""
    k = len(circle)
    return Observations(
        circle,
        covariance,
        base_from_flange,
        np.zeros((k, 6)),
        np.ones(k),
        np.arange(k),
        (),
        tuple((i,) for i in range(k)),
    )


@dataclass(frozen=True)
class Passes:
    """A recording's circles by pass, ready to be placed at any clock offset."""

    recording: Recording
    circle: Shaped[Float, "k 3"]  # repeats averaged
    covariance: Shaped[Float, "k 3 3"]
    time_s: Shaped[Float, " k"]  # on the clock of the profiles
    number: Shaped[Int, " k"]  # pass
    frames: tuple[tuple[int, ...], ...]
    rejected: tuple[Rejected, ...]  # repeats that contradict the others

    def __len__(self) -> int:
        return len(self.circle)

    def subset(self, keep: Bool) -> Passes:
        """Those marked in `keep` (k,)."""
        parts = {name: getattr(self, name)[keep] for name in ("circle", "covariance", "time_s", "number")}
        return replace(self, **parts, frames=tuple(f for f, kept in zip(self.frames, keep, strict=True) if kept))

    @property
    def scans(self) -> Int:
        """Numbers of the passes in which the robot moves."""
        numbers, count = np.unique(self.recording.robot_pass, return_counts=True)
        return np.intersect1d(numbers[count > 1], self.number)

    def offset_range(self) -> tuple[float, float]:
        """Clock offsets (profile time - robot time) with which every frame of every scan lies within its poses."""
        low, high = [], []
        for number in self.scans:
            time, poses = self.time_s[self.number == number], poses_of(self.recording, number)[0]
            low.append(time[-1] - poses[-1])
            high.append(time[0] - poses[0])
        if max(low) > min(high):
            raise InputError(
                f"{self.recording.source}: /profiles/time",
                "no clock offset puts the frames of all scans within the robot's poses",
            )
        return float(max(low)), float(min(high))

    def place(self, offset_s: float = 0.0) -> Observations:
        """Observations with the flange's poses at the frames' times minus `offset_s`."""
        return Observations(
            self.circle, self.covariance, *placed(self.recording, self.time_s, self.number, offset_s), self.frames
        )


class Placed(NamedTuple):
    """Poses of the flange at the times of k observations, and what their errors share: as in `Observations`."""

    base_from_flange: Shaped[Float, "k 4 4"]
    velocity: Shaped[Float, "k 6"]
    evened: Shaped[Float, " k"]
    still: Shaped[Int, " s"]
    scans: tuple[Group, ...]


def placed(recording: Recording, time_s: Float, number: Int, offset_s: float = 0.0) -> Placed:
    """The flange at times (k,), on the clock of the profiles, of the passes `number` (k,)."""
    k = len(time_s)
    base_from_flange, velocity, evened = np.empty((k, 4, 4)), np.zeros((k, 6)), np.ones(k)
    still, scans = [], []
    for this in np.unique(number):
        rows = np.flatnonzero(number == this)
        time, *poses = poses_of(recording, this)
        if len(time) == 1:
            base_from_flange[rows] = interpolate_poses(time, time, *poses)
            still.append(rows)
            continue
        at = np.clip(time_s[rows] - offset_s, time[0], time[-1])
        node = np.clip(np.searchsorted(time, at, side="right") - 1, 0, len(time) - 2)
        step = time[node + 1] - time[node]
        fraction = (at - time[node]) / step
        chord = 0.5 * fraction * (1 - fraction) * step**2
        piece = np.floor((at - at[0]) / PIECE_S).astype(int)
        for one in np.unique(piece):
            here = piece == one
            base_from_flange[rows[here]], velocity[rows[here]] = _moving(at[here], chord[here], time, *poses)
        evened[rows] = fraction**2 + (1 - fraction) ** 2
        near = np.union1d(node, node + 1)  # the others have no part in any frame
        scans.append(Group(rows, np.searchsorted(near, node), fraction, len(near)))
    at_rest = np.concatenate([*still, np.zeros(0, int)]).astype(int)
    return Placed(base_from_flange, velocity, evened, at_rest, tuple(scans))


def poses_of(recording: Recording, number: int) -> tuple[Float, Float, Float]:
    """Times, positions and quaternions of a pass's recorded poses."""
    here = recording.robot_pass == number
    return recording.robot_time_s[here], recording.robot_position_mm[here], recording.robot_quaternion_wxyz[here]


def by_pass(profiles: SphereProfiles, recording: Recording) -> Passes:
    """Circles in the order of their passes; the repeats of a posture held still averaged."""
    numbers, count = np.unique(recording.robot_pass, return_counts=True)
    still = set(numbers[count == 1].tolist())
    number = recording.pass_index[profiles.frame]
    circle, covariance, time, which, frames = [], [], [], [], []
    rejected: list[Rejected] = []
    for this in np.unique(number):
        rows = np.flatnonzero(number == this)
        good = (
            _agreeing(profiles.circle[rows], profiles.covariance[rows]) if this in still else np.ones(len(rows), bool)
        )
        rejected += [
            Rejected(int(f), "contradicts the other repeats of its posture") for f in profiles.frame[rows[~good]]
        ]
        for members in [rows[good]] if this in still else rows[:, None]:
            mean, spread = _mean(profiles.circle[members], profiles.covariance[members])
            circle.append(mean)
            covariance.append(spread)
            time.append(float(recording.time_s[profiles.frame[members]].mean()))
            which.append(int(this))
            frames.append(tuple(int(f) for f in profiles.frame[members]))
    return Passes(
        recording,
        np.array(circle),
        np.array(covariance),
        np.array(time),
        np.array(which),
        tuple(frames),
        tuple(rejected),
    )


def distinct_postures(base_from_flange: Float) -> int:
    """How many of the poses (k, 4, 4) are postures of their own: the others repeat one of them."""
    kept: list[Float] = []
    for pose in base_from_flange:
        if kept:
            between = inverse(np.stack(kept)) @ pose
            angle = np.linalg.norm(vector_from_rotation(between[:, :3, :3]), axis=1)
            if ((np.linalg.norm(between[:, :3, 3], axis=1) < SAME_MM) & (angle < SAME_RAD)).any():
                continue
        kept.append(pose)
    return len(kept)


def _agreeing(circle: Float, covariance: Float) -> Bool:
    """Which repeats (m,) lie about their median: with three or more, a jump in one is not averaged in."""
    if len(circle) < 3:
        return np.ones(len(circle), bool)
    off = circle - np.median(circle, axis=0)
    distance = np.einsum("ki,kij,kj->k", off, np.linalg.inv(2 * covariance), off)
    spread = max(1.0, float(np.median(distance)) / 2.4)  # 2.4: the median of chi-square with 3 degrees of freedom
    return np.asarray(distance < REPEAT_GATE * spread)


def _mean(circle: Float, covariance: Float) -> tuple[Float, Float]:
    """Weighted mean of repeats (m, 3) and its covariance."""
    information = np.linalg.inv(covariance)
    spread = np.linalg.inv(information.sum(axis=0))
    return spread @ np.einsum("kij,kj->i", information, circle), spread


def _moving(at: Float, chord: Float, time: Float, position: Float, quaternion: Float) -> tuple[Float, Float]:
    """Poses of the flange (m, 4, 4) at times (m,), and its velocity (m, 6) in its own frame, mm/s and rad/s.

    Between two recorded poses a motion leaves their chord by its second derivative times `chord` (m,), s^2: a weave
    that is sampled coarsely would seem too small, and the sensor's scales wrong. Both derivatives are those of a smooth
    motion (see `_slopes`): differences of neighbouring poses would pass their noise for motion, and so find a clock
    offset where none shows.
    """
    first, last = np.searchsorted(time, [at.min() - MARGIN_S, at.max() + MARGIN_S])
    around = slice(max(int(first) - 1, 0), int(last) + 1)  # a pose more on either side, between which `at` may lie
    if last - first >= 4:
        time, position, quaternion = time[around], position[around], quaternion[around]
    rotation = rotation_from_quaternion(quaternion)
    poses = interpolate_poses(at, time, position, quaternion)
    middle = rotation[len(rotation) // 2]
    turned = vector_from_rotation(middle.T @ rotation)  # small enough to be unique within a scan
    here = (
        (time >= at.min() - MARGIN_S) & (time <= at.max() + MARGIN_S) if last - first >= 4 else np.ones(len(time), bool)
    )
    linear, bend = _slopes(at, time[here], position[here] - position[0])
    rate, curl = _slopes(at, time[here], turned[here])
    poses[:, :3, 3] -= chord[:, None] * bend
    vector = vector_from_rotation(middle.T @ poses[:, :3, :3]) - chord[:, None] * curl
    now = middle @ rotation_from_vector(vector)
    poses[:, :3, :3] = now
    step = DIFFERENCE_S * rate
    spin = vector_from_rotation(np.swapaxes(now, 1, 2) @ middle @ rotation_from_vector(vector + step)) / DIFFERENCE_S
    return poses, np.concatenate([np.einsum("kji,kj->ki", now, linear), spin], axis=1)


def _slopes(at: Float, time: Float, values: Float) -> tuple[Float, Float]:
    """First and second derivative at times (m,) of a polynomial through values (K, 3), of the degree that they deserve.

    By the Bayesian information criterion.
    """
    middle, half = (time[0] + time[-1]) / 2, (time[-1] - time[0]) / 2
    most = min(MAX_DEGREE, max(1, len(time) // 2 - 1))
    basis, triangle = np.linalg.qr(chebvander((time - middle) / half, most))
    parts = basis.T @ values
    left = np.sum(values**2) - np.cumsum(np.sum(parts**2, axis=1)) + 1e-12 * np.sum(values**2)
    score = values.size * np.log(np.maximum(left, 1e-300)) + 3 * np.arange(1, most + 2) * np.log(values.size)
    degree = 1 + int(np.argmin(score[1:]))
    series = np.linalg.solve(triangle[: degree + 1, : degree + 1], parts[: degree + 1])
    x = (at - middle) / half
    first, second = (chebval(x, chebder(series, order)).T / half**order for order in (1, 2))
    return np.asarray(first), np.asarray(second)
