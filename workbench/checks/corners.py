"""What stands out of two faces where they meet."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from workbench.artefacts import Cloud
from workbench.checks.sensor import some
from workbench.geometry.blocks import as_input
from workbench.geometry.medians import median_of, robust_sd
from workbench.kernels import kernel
from workbench.units import DEG, TO_SD, AnyArray, Bool, Float, Float32, Int

FRAMES, LEAST_FRAMES = 240, 4  # evenly, with both faces
LOOKED_AT = 8  # times as many frames, among which those that show a face are found
LEAST_POINTS = 4  # of a face in a frame
PARALLEL = math.sin(2.0 * DEG)  # faces that turn by less have no corner
CORNER_MM, CLOSE_MM = 0.25, 0.12  # returns about it: what a check judges, and where a small ledge shows most
LEAST_SCATTER_MM = 1e-4
LEDGES, MOST_MM = 0.02, 0.01  # share of edges with one too small to be refused; most by which it stands out then
FAR_INSIDE = -30.0  # standard uncertainties: a corner that is rounded by more has no ledge either; densities underflow
ROUNDS, STRAY = 3, 4.0  # of each line's fit; times the median distance from it, beyond which a point is none of its
ODD = 5.0  # robust standard deviations of frames that are left out of the mean


class StandsOut(NamedTuple):
    """How far the corner of two faces stands out of both, less what noise alone would show, mm."""

    corner_mm: float  # returns within CORNER_MM; median of the frames
    close_mm: float  # within CLOSE_MM; mean of the frames
    close_u_mm: float  # of this mean

    def by_ledge_mm(self, bowed_mm: float) -> float:
        """By how much a ledge makes the close returns stand out: mean of the posterior.

        bowed_mm: at most, either way, by the bows of both faces. Prior: a share of LEDGES has one, and it stands out by
        anything up to MOST_MM.

        Example:
            >>> [round(1e3 * StandsOut(0.0, 1e-3 * of, 3e-4).by_ledge_mm(1e-4), 3) for of in (-50.0, 0.5, 1.0, 2.0)]
            [0.0, 0.003, 0.172, 2.0]
        """
        u = math.hypot(self.close_u_mm, bowed_mm / math.sqrt(3.0), LEAST_SCATTER_MM)
        z = max(self.close_mm / u, FAR_INSIDE)
        normal = math.exp(-0.5 * z * z) / (math.sqrt(2.0 * math.pi) * u)
        above = 0.5 * math.erfc(-z / math.sqrt(2.0))
        with_one = LEDGES / MOST_MM
        return with_one * u * (z * above + u * normal) / (with_one * above + (1.0 - LEDGES) * normal)


NOTHING = StandsOut(0.0, 0.0, 0.0)


def ledge_takes_mm(close_mm: float, bevel: Float) -> Float:
    """What a ledge above the root face takes off it, by how far it stands out within CLOSE_MM (`by_ledge_mm`).

    docs/method.md, (11a); bevel: angles (m,), rad. Where the faces meet at a right angle or more it takes nothing.

    Example:
        >>> [round(float(mm), 3) for mm in ledge_takes_mm(0.009, np.radians([30.0, 40.0, 50.0]))]
        [0.074, 0.06, 0.051]
        >>> ledge_takes_mm(0.009, np.radians([90.0, 120.0])).round(6).tolist()
        [0.0, 0.0]
    """
    sine, cosine = np.sin(bevel), np.maximum(np.cos(bevel), 0.0)
    return np.asarray(np.sqrt(4.0 * CLOSE_MM * max(close_mm, 0.0) * cosine / (sine * (sine + cosine))))


def stands_out(cloud: Cloud, labels: AnyArray, one: int, other: int) -> StandsOut:
    """How far the corner of the faces with two labels (N, M) stands out of them; nothing where too few frames show it.

    From the first face to the second a profile turns one way, round the plate.
    """
    rows = frames_with(labels, (one, other), FRAMES)
    out = np.full((len(rows), 2), np.nan)
    x, z, keep = (as_input(grid[rows]) for grid in (cloud.x_mm, cloud.z_mm, cloud.keep))
    _stands_out(x, z, keep, as_input(labels[rows]), one, other, out)
    out = out[np.isfinite(out).all(axis=1)]
    if len(out) < LEAST_FRAMES:
        return NOTHING
    corner, close = np.median(out, axis=0)
    spread = robust_sd(out[:, 1] - close)
    kept = out[np.abs(out[:, 1] - close) <= ODD * spread, 1]
    return StandsOut(float(corner), float(kept.mean()), float(kept.std() / math.sqrt(len(kept))))


def frames_with(labels: AnyArray, faces: Iterable[int], count: int) -> Int:
    """At most `count` frames of labels (N, M), evenly among those that show all of some faces.

    Of a long recording a part is looked at, unless that shows too few.
    """
    for every in (thinning(len(labels), count), 1):
        found = every * np.flatnonzero(np.all([(labels[::every] == face).any(axis=1) for face in faces], axis=0))
        if len(found) >= count or every == 1:
            break
    return some(found, count)


def thinning(frames: int, count: int) -> int:
    """Every how many frames are looked at for `count` of them; odd, since an exposure may alternate."""
    return max(1, frames // (LOOKED_AT * count)) // 2 * 2 + 1


@kernel
def _stands_out(x: Float32, z: Float32, keep: Bool, labels: AnyArray, one: int, other: int, out: Float) -> None:
    """Fill in for each of some frames by how much the returns about the corner stand out on average (n, 2), mm."""
    columns = x.shape[1]
    on, lines = np.empty((2, columns), np.int64), np.empty((2, 5))
    off, away = np.empty(columns), np.empty(columns)
    for i in range(len(x)):
        first, second = face_columns(keep[i], labels[i], one, on[0]), face_columns(keep[i], labels[i], other, on[1])
        if min(first, second) < LEAST_POINTS:
            continue
        fitted_line(x[i], z[i], on[0, :first], off, lines[0])
        fitted_line(x[i], z[i], on[1, :second], off, lines[1])
        if abs(_sine(lines)) < PARALLEL:
            continue
        corner = _crossing(lines)
        middle = on[0, first // 2], on[1, second // 2]
        size, third = _away(x[i], z[i], keep[i], min(middle) + 1, max(middle), corner, away, on[0])
        if size >= 3:
            for k in range(2):
                reach = max((CORNER_MM, CLOSE_MM)[k], third)
                out[i, k] = _mean_out(x[i], z[i], on[0, :size], away, reach, lines)


@kernel
def face_columns(keep: Bool, labels: AnyArray, label: int, on: Int) -> int:
    """Fill in the columns of a frame that are kept and have a label; how many."""
    count = 0
    for j in range(len(labels)):
        if keep[j] and labels[j] == label:
            on[count] = j
            count += 1
    return count


@kernel
def _crossing(lines: Float) -> tuple[float, float]:
    """Where two lines meet, x and z."""
    ahead = off_line(lines[1], lines[0, 0], lines[0, 1]) / _sine(lines)
    return lines[0, 0] + ahead * lines[0, 2], lines[0, 1] + ahead * lines[0, 3]


@kernel
def _away(
    x: Float32, z: Float32, keep: Bool, start: int, stop: int, corner: tuple[float, float], away: Float, at: Int
) -> tuple[int, float]:
    """Fill in how far the returns of some columns lie from a corner, and their columns; how many, the third nearest."""
    size, first, second, third = 0, np.inf, np.inf, np.inf
    for j in range(start, stop):
        if keep[j]:
            away[size], at[size] = math.sqrt((x[j] - corner[0]) ** 2 + (z[j] - corner[1]) ** 2), j
            if away[size] < first:
                first, second, third = away[size], first, second
            elif away[size] < second:
                second, third = away[size], second
            elif away[size] < third:
                third = away[size]
            size += 1
    return size, third


@kernel
def _mean_out(x: Float32, z: Float32, at: Int, away: Float, reach_mm: float, lines: Float) -> float:
    """How far returns within reach of the crossing of two lines stand out of the farther one on average, less noise.

    The plate lies on that side of each line where the other face is. By noise alone the farther out of two returns at a
    mean distance of 0 and -d is out by E max(0, X), X of mean -d and of both variances (Clark, Operations Research 9
    (1961) 145).
    """
    sine = abs(_sine(lines))
    outwards = (
        -math.copysign(1.0, off_line(lines[0], lines[1, 0], lines[1, 1])),
        -math.copysign(1.0, off_line(lines[1], lines[0, 0], lines[0, 1])),
    )
    noise = math.sqrt(2.0) * max(lines[0, 4], lines[1, 4], LEAST_SCATTER_MM)
    total, count = 0.0, 0
    for k in range(len(at)):
        if away[k] <= reach_mm:
            a, b = float(x[at[k]]), float(z[at[k]])
            out = max(outwards[0] * off_line(lines[0], a, b), outwards[1] * off_line(lines[1], a, b))
            behind = away[k] * sine / noise
            density = math.exp(-0.5 * behind**2) / math.sqrt(2.0 * math.pi)
            total += out - noise * (density - behind * 0.5 * math.erfc(behind / math.sqrt(2.0)))
            count += 1
    return float(total / count)


@kernel
def _sine(lines: Float) -> float:
    """Of the turn from one line to the other."""
    return float(lines[1, 3] * lines[0, 2] - lines[1, 2] * lines[0, 3])


@kernel
def off_line(line: Float, x: float, z: float) -> float:
    """Distance of a point from a line (a point on it, x and z; its direction; scatter), counted along (-z, x)."""
    return float((z - line[1]) * line[2] - (x - line[0]) * line[3])


@kernel
def fitted_line(x: Float32, z: Float32, on: Int, off: Float, line: Float) -> float:
    """Fill in the line through the columns `on` of a profile, strays left out: a point on it, direction, scatter.

    And `off`, how far each column's return lies from it; returns beyond which distance they are strays.
    """
    limit = np.inf
    for _ in range(ROUNDS):
        count, x0, z0 = 0, 0.0, 0.0
        for k in range(len(on)):
            if limit == np.inf or off[k] <= limit:
                count, x0, z0 = count + 1, x0 + x[on[k]], z0 + z[on[k]]
        x0, z0 = x0 / count, z0 / count
        xx, xz, zz = 0.0, 0.0, 0.0
        for k in range(len(on)):
            if limit == np.inf or off[k] <= limit:
                a, b = x[on[k]] - x0, z[on[k]] - z0
                xx, xz, zz = xx + a * a, xz + a * b, zz + b * b
        turn = 0.5 * math.atan2(2.0 * xz, xx - zz)
        line[0], line[1], line[2], line[3] = x0, z0, math.cos(turn), math.sin(turn)
        for k in range(len(on)):
            off[k] = abs(off_line(line, x[on[k]], z[on[k]]))
        middle = median_of(off[: len(on)].copy(), len(on))
        limit = STRAY * middle + 1e-9
    line[4] = middle * TO_SD
    return limit
