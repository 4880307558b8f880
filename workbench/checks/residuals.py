"""What frames leave of a smooth edge together: every second one, and poses that come late."""

from __future__ import annotations

import math
from collections.abc import Mapping
from itertools import combinations, pairwise
from typing import NamedTuple

import numpy as np

from workbench.artefacts import Check
from workbench.checks.limits import Bound, check
from workbench.checks.motion import twisted
from workbench.geometry.along import by_pass
from workbench.geometry.medians import median, medians, robust_sd
from workbench.geometry.poses import vector_from_rotation
from workbench.units import COVERAGE, DEG, MEDIAN_U, Bool, Float, Int, Shaped

CERTAIN = 5.0  # of a difference of every second frame, times its standard uncertainty
LEAST_FRAMES = 48  # that tell how frames go together


def every_second(left: Float, passes: Int) -> float:
    """Half of what every second frame differs from those between, of residuals (N,); 0 where it is not certain.

    An exposure, or two lasers, that alternate: nothing tells which of them measure the part.
    """
    found = 0.0
    for frames in by_pass(passes):
        mine = left[frames]
        one, other = (of[np.isfinite(of)] for of in (mine[::2], mine[1::2]))
        if min(one.size, other.size) < LEAST_FRAMES // 2:
            continue
        middle = median(one), median(other)
        scatter = [robust_sd(of - m) for of, m in zip((one, other), middle, strict=True)]
        apart = abs(middle[0] - middle[1])
        if apart > CERTAIN * MEDIAN_U * math.hypot(
            scatter[0] / math.sqrt(one.size), scatter[1] / math.sqrt(other.size)
        ):
            found = max(found, 0.5 * apart)
    return found


SPAN_S = 0.04  # for the rate of the poses: over less it is their noise
LATE_BINS, FRAMES_A_LATE_BIN = (
    96,
    3,
)  # of a pass at the most; frames of each at the least, whose median withstands strays
LEAST_BINS = 24
DEGREE = 3  # in arc length, of how a face may be twisted, or bend, without going with the clock
WALK = 4  # degree, in time, of an offset that walks
# How many times more of the turn a constant offset, or one that walks, explains than noise does, each of its unknowns:
# 60 good raw edges of both simulators reach 8.3 and 4.0, half of those with late poses 8 to 100.
SURE_LATE, SURE_WALK = 20.0, 7.0
USUAL_S = 0.1  # standard deviation of what an offset may be, and of how it may walk: one of seconds is no clock's
SHEARED = 0.05  # of what the orientation turns, that a face may seem to turn with it: of a hand-eye pose 3 deg off
MOST_SWAY = 7.0 * DEG  # a scanner that turns by more may follow how the plate is twisted: all may go with it then
SETTLED = 4  # rounds, in which the noise and what goes with the rate settle
UNSEEN_S, UNSEEN_TURN = 0.01, 0.005 * DEG  # an offset that is no fault to have; what it may turn without being named
SMOOTHED = 5  # bins over which a flow is averaged before its change is told
MOST_ALIKE = 0.9  # correlation of neighbouring bins that noise is freed of


class FaceAlong(NamedTuple):
    """A face as N frames show it along an edge; NaN in s or angle: it is not seen."""

    s: Shaped[Float, " N"]  # arc length, mm
    angle: Shaped[Float, " N"]  # its direction about the edge, rad
    tangent: Shaped[Float, "N 3"]  # of the edge
    normal: Shaped[Float, "N 3"]  # of the face
    place_mm: Shaped[Float, "N 3"]  # of its middle in the base


class Late(NamedTuple):
    """What N frames tell of an offset between the clocks, and what it makes of them."""

    offset_s: Shaped[Float, " N"]  # profile time less pose time, where it is certain; else 0
    unsure_s: Shaped[Float, " N"]  # standard uncertainty of it, where one of UNSEEN_S would not show
    turn: Shaped[Float, " N"]  # what of the face's turn it is for certain, rms of a pass, rad
    rate: Shaped[Float, " N"]  # with which the face turns about the edge in the view, rad/s
    # with which laser plane and edge turn against each other, and the edge bends with its place: rms of a pass, rad/s
    oblique_rate: Shaped[Float, " N"]
    flow_mm_s: Shaped[Float, "N 3"]  # with which they carry the face across the edge
    slow_mm_s: Shaped[Float, "N 3"]  # what of it is slow, and would look like a bend of the edge
    passes: Shaped[Int, " N"]

    @property
    def off_s(self) -> Float:
        """By how much poses may come late (N,)."""
        return np.hypot(self.offset_s, self.unsure_s)

    @property
    def turn_u(self) -> Float:
        """What that turns the face by (N,), rad: over a pass, since where it is nothing is no better known."""
        return self._over_pass(self.off_s * self.rate)

    def place_u_mm(self, axis: Float) -> Float:
        """What that moves the edge by along unit vectors (N, 3), (N,), likewise."""
        flow, slow = ((of * axis).sum(axis=1) for of in (self.flow_mm_s, self.slow_mm_s))
        return self._over_pass(np.hypot(self.offset_s * flow, self.unsure_s * slow))

    def _over_pass(self, value: Float) -> Float:
        number = np.unique(self.passes, return_inverse=True)[1]
        return np.asarray(np.sqrt(np.bincount(number, value**2) / np.bincount(number))[number])


def late_of(face: FaceAlong, pose: Float, time_s: Float, passes: Int) -> Late:
    """What a face tells of an offset of the clocks, by poses (N, 4, 4) at time_s (N,) in passes (N,).

    A plate does not turn or bend to and fro as a scanner does. What the face's direction leaves of a slow twist, and of
    what goes with the orientation itself, is compared with the rate at which the poses turn about the edge, by an
    offset that may walk, and what its place leaves of a slow bend with the rate at which they carry it, by a constant
    one: waves of an edge look like one that walks. What two passes show alike at the same places is the plate's.
    """
    offset, unsure, turn, rate, oblique, late_turn, by_place = np.zeros((7, face.s.size))
    still_mm = np.zeros((face.s.size, 3))
    found = Late(offset, unsure, turn, rate, oblique, still_mm, still_mm.copy(), passes)
    for mine in by_pass(passes, np.isfinite(face.s + face.angle)):
        if mine.size < LEAST_BINS * FRAMES_A_LATE_BIN:
            continue
        edges = np.linspace(0, mine.size, min(LATE_BINS, mine.size // FRAMES_A_LATE_BIN) + 1).astype(np.int64)
        here = FaceAlong(*(of[mine] for of in face))
        rotation, span = pose[mine, :3, :3], _span(time_s[mine], mine.size // (edges.size - 1))
        spin, flow = _rates(pose[mine], here.place_mm, span)
        rate = (spin * here.tangent).sum(axis=1)
        turning = _turning(here, rate, vector_from_rotation(rotation[0].T @ rotation), edges)
        moving = _moving(here, flow, edges)
        (turns, walk, covariance), (moves, still, _) = _offset_estimate(turning), _offset_estimate(moving)
        found.offset_s[mine] = _walk(mine.size, still if moves > turns else walk)  # by what is more certain
        found.unsure_s[mine] = _unsure((turning, moving))
        late_turn[mine], by_place[mine] = found.offset_s[mine] * (turns > 0.0) * rate, still[0]
        along = np.einsum("nji,nj->ni", rotation, np.cross(here.normal, here.tangent))
        found.rate[mine] = (_direction_rate(rotation, here.normal, span) * along).sum(axis=1)
        if turns > 0.0:  # where its place alone shows it, an edge may wave
            shown, ways = _rms(found.offset_s[mine] * found.rate[mine]), _walk(mine.size, np.eye(walk.size))
            by_terms = np.einsum("ni,ij,nj->n", ways, covariance, ways)
            found.turn[mine] = math.sqrt(
                max(shown**2 - COVERAGE**2 * float(np.mean(by_terms * found.rate[mine] ** 2)), 0.0)
            )
        across = flow - (flow * here.tangent).sum(axis=1, keepdims=True) * here.tangent
        slow, bends = twisted(here.s, DEGREE), _rms(_bending(_mean(across, edges), _mean(here.s, edges)))
        found.flow_mm_s[mine], found.slow_mm_s[mine] = across, slow @ (slow.T @ across)
        oblique = np.linalg.norm(_direction_rate(rotation, here.tangent, span), axis=1)
        found.oblique_rate[mine] = _rms(oblique) + bends
    for pair in combinations(np.unique(passes), 2):
        if _both_show(face, late_turn, [passes == number for number in pair]):
            both = np.isin(passes, pair)
            found.offset_s[both], found.turn[both] = by_place[both], 0.0
    return found


def _both_show(face: FaceAlong, late_turn: Float, pair: list[Bool]) -> bool:
    """Whether a pair of passes shows the same turns of a face, which late poses (`late_turn`, (N,)) would not."""
    on = [mine & np.isfinite(face.s) & np.isfinite(face.angle) for mine in pair]
    if not all(mine.any() for mine in on) or not any(late_turn[mine].any() for mine in on):
        return False
    low, high = max(face.s[mine].min() for mine in on), min(face.s[mine].max() for mine in on)
    edges = np.linspace(low, high, LEAST_BINS + 1)
    found = np.full((2, 2, LEAST_BINS), np.nan)  # by pass: the direction, and what of it would be late poses'
    for k, mine in enumerate(on):
        for b, (a, z) in enumerate(pairwise(edges)):
            here = mine & (face.s >= a) & (face.s <= z)
            if here.any():
                found[k, :, b] = median(face.angle[here]), late_turn[here].mean()
    shown, late = found[0] - found[1]
    both = np.isfinite(shown + late)
    if both.sum() < LEAST_BINS // 2:
        return False
    shown, late = (of[both] - of[both].mean() for of in (shown, late))
    size = max(float(late @ late), 1e-30)
    share = float(shown @ late) / size
    off = shown - share * late
    return share + CERTAIN * math.sqrt(float(off @ off) / (both.sum() - 2) / size) < 0.5


def late_check(late: Late, limits: Mapping[str, Bound] | None = None) -> Check:
    """The check that the face does not turn with the rate of the poses; root mean square of the frames."""
    turn = _rms(late.turn) / DEG
    hidden = _rms(late.unsure_s * late.rate)
    low, high = 1e3 * float(late.offset_s.min()), 1e3 * float(late.offset_s.max())
    finding = "the face shows no rotation that follows the rate of the poses"
    if turn > 0.0:
        finding = (
            f"the face rotates by {turn:.2g} deg (rms) as it would if poses came {low:+.0f} to {high:+.0f} ms late: "
            "a delay left out, frames that are lost and not stamped, clocks that run at different rates, a hand-eye "
            "pose that is off; or does the part vibrate, or something (tape?) cover its face here and there?"
        )
    elif late.offset_s.any():
        finding = f"the face moves or turns to and fro as it would if poses came {low:+.0f} to {high:+.0f} ms late"
    elif hidden > UNSEEN_TURN:
        finding = (
            f"the scanner sways slowly, and does not show whether the clocks agree: {1e3 * UNSEEN_S:.0f} ms would "
            f"rotate the face by {hidden / DEG:.2g} deg (rms), as a twisted plate does; it does not show which"
        )
    return check("late_turn_deg", turn, finding, given=limits)


def _rms(of: Float) -> float:
    return float(np.sqrt(np.mean(of**2)))


class _Span(NamedTuple):
    """From which frame to which one, and in how many seconds, rates at n frames are taken."""

    before: Shaped[Int, " n"]
    after: Shaped[Int, " n"]
    took_s: Shaped[Float, "n 1"]


def _span(time_s: Float, least_frames: int) -> _Span:
    """Over `least_frames` to each side: what noise of a pose moves its own bin is then in no rate of that."""
    half = max(1, math.ceil(0.5 * SPAN_S / max(float(np.median(np.diff(time_s))), 1e-6)), least_frames)
    at = np.arange(time_s.size)
    before, after = np.maximum(at - half, 0), np.minimum(at + half, time_s.size - 1)
    return _Span(before, after, np.maximum(time_s[after] - time_s[before], 1e-6)[:, None])


def _rates(pose: Float, place_mm: Float, span: _Span) -> tuple[Float, Float]:
    """How fast poses (n, 4, 4) turn, rad/s, and carry places (n, 3) with them, mm/s; both (n, 3) in the base."""
    first, last = pose[span.before], pose[span.after]
    local = np.einsum("nji,nj->ni", pose[:, :3, :3], place_mm - pose[:, :3, 3])
    turn = vector_from_rotation(np.swapaxes(first[:, :3, :3], 1, 2) @ last[:, :3, :3])
    moved = np.einsum("nij,nj->ni", last[:, :3, :3] - first[:, :3, :3], local) + last[:, :3, 3] - first[:, :3, 3]
    return np.einsum("nij,nj->ni", first[:, :3, :3], turn) / span.took_s, moved / span.took_s


def _direction_rate(rotation: Float, direction: Float, span: _Span) -> Float:
    """Rate (n, 3), 1/s, at which directions (n, 3) in the base change in the view: what follows an edge turns none."""
    local = np.einsum("nji,nj->ni", rotation, direction)
    return np.asarray((local[span.after] - local[span.before]) / span.took_s)


def _bending(flow: Float, s: Float) -> Float:
    """Rate (b,), 1/s, at which places carried by `flow` (b, 3), mm/s, at s (b,) slope against the edge."""
    smooth = np.stack([np.convolve(one, np.full(SMOOTHED, 1.0 / SMOOTHED), mode="valid") for one in flow.T], axis=1)
    inner = s[SMOOTHED // 2 : s.size - SMOOTHED // 2]
    step = np.abs(np.diff(inner))
    return np.asarray(np.linalg.norm(np.diff(smooth, axis=0), axis=1) / np.maximum(step, 0.5 * np.median(step)))


class _Channel(NamedTuple):
    """What b bins show, and what of it an offset would make; less what is slow of both."""

    shown: Shaped[Float, " b"]
    by_rate: Shaped[Float, "b k"]  # a constant one, and terms by which it walks, over USUAL_S
    confounders: Shaped[Float, "b j"]  # what else may go with the scanner, by as much as is usual
    free: int  # of the bins


def _mean(of: Float, edges: Int) -> Float:
    """Means of (n, ...) by bins."""
    return np.asarray(np.add.reduceat(of, edges[:-1], axis=0) / np.diff(edges).reshape(-1, *[1] * (of.ndim - 1)))


def _walk(count: int, terms: Float) -> Float:
    """An offset (count, ...) that walks in time by terms (k, ...)."""
    return np.asarray(np.polynomial.legendre.legval(np.linspace(-1.0, 1.0, count), terms).T)


def _turning(face: FaceAlong, rate: Float, orientation: Float, edges: Int) -> _Channel:
    """By the face's direction, against how fast (n,) the poses turn about the edge."""
    known = twisted(_mean(face.s, edges), DEGREE)
    by_rate = USUAL_S * _mean(rate, edges)[:, None] * _walk(edges.size - 1, np.eye(WALK + 1))
    sways = np.ptp(orientation, axis=0).max() < MOST_SWAY
    confounders, left = (SHEARED if sways else 1.0) * _mean(orientation, edges), medians(face.angle, edges)
    left, by_rate, confounders = (of - known @ (known.T @ of) for of in (left, by_rate, confounders))
    return _Channel(left, by_rate, confounders, len(left) - known.shape[1])


def _moving(face: FaceAlong, flow: Float, edges: Int) -> _Channel:
    """By the face's place along its normal, against how fast (n, 3) the poses carry it."""
    known = twisted(_mean(face.s, edges), DEGREE)
    normal, place = _mean(face.normal, edges), np.stack([medians(one, edges) for one in face.place_mm.T], axis=1)
    flow = _mean(flow, edges)
    place, flow = (of - known @ (known.T @ of) for of in (place, flow))
    shown, along = ((of * normal).sum(axis=1) for of in (place, flow))
    return _Channel(shown, USUAL_S * along[:, None], np.zeros((shown.size, 0)), shown.size - known.shape[1])


def _offset_estimate(channel: _Channel) -> tuple[float, Float, Float]:
    """How many times more than noise an offset explains, 0 where it is not certain; the terms of its walk, s; their
    covariance.
    """
    more = channel.by_rate.shape[1] - 1
    none, one, every = (_fitted(channel, terms) for terms in (0, 1, more + 1))
    explained, further = none.cost - one.cost, one.cost - every.cost
    certain = explained > SURE_LATE * every.noise
    walks = explained + further > SURE_WALK * (more + 1) * every.noise
    if more and walks and (not certain or further > SURE_WALK * more * every.noise):
        return (explained + further) / every.noise, every.terms_s, every.covariance
    return (explained / every.noise if certain else 0.0), one.terms_s * certain, one.covariance


class _Fitted(NamedTuple):
    """An offset by k terms, as a channel shows it."""

    terms_s: Shaped[Float, " k"]
    covariance: Shaped[Float, "k k"]  # s squared
    cost: float  # sum of squares that they leave
    noise: float  # what a bin errs by, squared


def _fitted(channel: _Channel, terms: int) -> _Fitted:
    """An offset by so many terms, beside what else goes with the scanner."""
    columns = np.concatenate([channel.by_rate[:, :terms], channel.confounders], axis=1)
    left, size, right = np.linalg.svd(columns, full_matrices=False)
    along, noise = left.T @ channel.shown, 0.0
    for _ in range(SETTLED):
        share = size / np.maximum(size**2 + noise, 1e-30)
        off = channel.shown - left @ (size * share * along)
        square = float(off @ off)
        alike = min(max(float(off[1:] @ off[:-1]) / max(square, 1e-30), 0.0), MOST_ALIKE)
        noise = max(square / (channel.free - size.size) * (1.0 + alike) / (1.0 - alike), 1e-30)
    cost = square + noise * float(((share * along) ** 2).sum())
    found, covariance = right.T @ (share * along), noise * (right.T / (size**2 + noise)) @ right
    return _Fitted(USUAL_S * found[:terms], USUAL_S**2 * covariance[:terms, :terms], cost, noise)


def _unsure(channels: tuple[_Channel, ...]) -> float:
    """Standard uncertainty of an offset that may be UNSEEN_S, by all that is shown."""
    each = [1.0 / float(_fitted(channel, 1).covariance[0, 0]) - 1.0 / USUAL_S**2 for channel in channels]
    return 1.0 / math.sqrt(1.0 / UNSEEN_S**2 + sum(each))
