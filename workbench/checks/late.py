"""Poses that come late or early: what a face turns to and fro as the recorded scanner does, but for its rate."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from workbench.artefacts import Check
from workbench.checks.limits import Bound, check
from workbench.checks.motion import twisted
from workbench.geometry.medians import medians
from workbench.geometry.poses import vector_from_rotation
from workbench.units import DEG, Float, Int, Shaped

SPAN_S = 0.04  # for the rate of the poses: over less it is their noise
BINS, FRAMES_A_BIN = 96, 3  # of a pass at the most; frames of each at the least, whose median withstands strays
LEAST_BINS = 24
DEGREE = 3  # in arc length, of how a face may be twisted without going with the clock
WALK = 4  # degree, in time, of an offset that walks
# How many times more of the turn a constant offset, or one that walks, explains than noise does, each of its unknowns:
# 60 good raw edges of both simulators reach 8.3 and 4.0, half of those with late poses 8 to 100.
SURE, SURE_WALK = 20.0, 7.0
MOST_S = 1.0  # of an offset: more is no clock's, but what a face has by itself, as where the poses hardly turn
MOST_ALIKE = 0.9  # correlation of neighbouring bins that noise is freed of


class Late(NamedTuple):
    """What an offset between the clocks makes of N frames, where it is certain; else 0."""

    offset_s: Shaped[Float, " N"]  # profile time less pose time
    turn: Shaped[Float, " N"]  # of the face about the edge, rad
    place_mm: Shaped[Float, "N 3"]  # of the edge in the base


def late_of(s: Float, angle: Float, tangent: Float, place_mm: Float, pose: Float, time_s: Float, passes: Int) -> Late:
    """What a face's direction (N,) rad about an edge's tangents (N, 3) at s (N,) tells of an offset of the clocks.

    A plate does not turn to and fro as a scanner does. What the direction leaves of a slow twist, and of what goes with
    the orientation itself, is compared with the rate at which the poses (N, 4, 4) turn about the edge: by a constant
    offset, and by one that walks slowly. place_mm (N, 3): the face in the base; NaN in s: it is not seen.
    """
    found = Late(np.zeros(s.size), np.zeros(s.size), np.zeros((s.size, 3)))
    for number in np.unique(passes):
        mine = np.flatnonzero((passes == number) & np.isfinite(s) & np.isfinite(angle))
        if mine.size < LEAST_BINS * FRAMES_A_BIN:
            continue
        spin, flow = _rates(pose[mine], time_s[mine], place_mm[mine])
        rate = (spin * tangent[mine]).sum(axis=1)
        rotation = pose[mine, :3, :3]
        offset = _offset(s[mine], angle[mine], rate, vector_from_rotation(rotation[0].T @ rotation))
        found.offset_s[mine], found.turn[mine] = offset, offset * rate
        across = flow - (flow * tangent[mine]).sum(axis=1, keepdims=True) * tangent[mine]
        found.place_mm[mine] = offset[:, None] * across
    return found


def late_check(late: Late, limits: Mapping[str, Bound] | None = None) -> Check:
    """The check that the face does not turn with the rate of the poses; root mean square of the frames."""
    turn = float(np.sqrt(np.mean(late.turn**2))) / DEG
    low, high = 1e3 * float(late.offset_s.min()), 1e3 * float(late.offset_s.max())
    told = "the face turns to and fro by nothing that goes with the rate of the poses"
    if turn > 0.0:
        told = f"the face turns by {turn:.2g} deg (rms) as it would if poses came {low:+.0f} to {high:+.0f} ms late: a "
        told += "delay left out, frames that are lost and not stamped, clocks that run at different rates; or does "
        told += "the part vibrate, or something cover its face here and there?"
    return check("late_turn_deg", turn, told, given=limits)


def _rates(pose: Float, time_s: Float, place_mm: Float) -> tuple[Float, Float]:
    """How fast poses (n, 4, 4) turn, rad/s, and carry places (n, 3) with them, mm/s; both (n, 3) in the base."""
    n = len(pose)
    half = max(1, math.ceil(0.5 * SPAN_S / max(float(np.median(np.diff(time_s))), 1e-6)))
    before, after = np.maximum(np.arange(n) - half, 0), np.minimum(np.arange(n) + half, n - 1)
    took = np.maximum(time_s[after] - time_s[before], 1e-6)[:, None]
    first, last = pose[before], pose[after]
    local = np.einsum("nji,nj->ni", pose[:, :3, :3], place_mm - pose[:, :3, 3])
    turn = vector_from_rotation(np.swapaxes(first[:, :3, :3], 1, 2) @ last[:, :3, :3])
    moved = np.einsum("nij,nj->ni", last[:, :3, :3] - first[:, :3, :3], local) + last[:, :3, 3] - first[:, :3, 3]
    return np.einsum("nij,nj->ni", first[:, :3, :3], turn) / took, moved / took


def _offset(s: Float, angle: Float, rate: Float, orientation: Float) -> Float:
    """The offset (n,), s, that frames of a pass in order of time show for certain; 0 where none is."""
    n = s.size
    edges = np.linspace(0, n, min(BINS, n // FRAMES_A_BIN) + 1).astype(np.int64)
    count = np.diff(edges)

    def mean(of: Float) -> Float:
        return np.asarray(np.add.reduceat(of, edges[:-1], axis=0) / count.reshape(-1, *[1] * (of.ndim - 1)))

    known = np.concatenate([twisted(mean(s), DEGREE), mean(orientation)], axis=1)
    known, size, _ = np.linalg.svd(known, full_matrices=False)
    known = known[:, size > 1e-9 * size[0]]
    time = np.polynomial.legendre.legvander(np.linspace(-1.0, 1.0, count.size), WALK)
    by_rate = time * mean(rate)[:, None]
    by_rate -= known @ (known.T @ by_rate)
    left = medians(angle, edges)
    left = left - known @ (known.T @ left)
    free = count.size - known.shape[1]
    rest, found = [float(left @ left)], []
    for terms in (1, WALK + 1):
        coefficient = np.linalg.lstsq(by_rate[:, :terms], left, rcond=1e-2)[0]
        off = left - by_rate[:, :terms] @ coefficient
        alike = min(max(float(off[1:] @ off[:-1]) / max(float(off @ off), 1e-30), 0.0), MOST_ALIKE)
        noise = float(off @ off) / (free - terms) * (1.0 + alike) / (1.0 - alike)
        rest.append(float(off @ off))
        found.append((coefficient, max(noise, 1e-30)))
    walks = (rest[0] - rest[2]) / (WALK + 1) / found[1][1] > SURE_WALK
    more = (rest[1] - rest[2]) / WALK / found[1][1] > SURE_WALK
    constant = (rest[0] - rest[1]) / found[0][1] > SURE
    place = np.linspace(-1.0, 1.0, n)
    for certain, (coefficient, _) in ((walks and (more or not constant), found[1]), (constant, found[0])):
        offset = np.polynomial.legendre.legval(place, coefficient)
        if certain and np.abs(offset).max() <= MOST_S:
            return np.asarray(offset)
    return np.zeros(n)
