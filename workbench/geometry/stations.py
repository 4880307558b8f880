"""Points of the scanner's grid beside the edge: which stand out of the stock, and which a cut takes away.

A section is a row of `SectionTable`: stations at even distances along the edge. Each point belongs to the station that
is nearest along the edge, and is seen in that station's section plane.
"""

from __future__ import annotations

import math
from functools import partial
from typing import NamedTuple

import numpy as np

from workbench.geometry.blocks import as_input, as_rows, over_blocks
from workbench.kernels import kernel
from workbench.units import AnyArray, Bool, Float, Float32, Int, Shaped

SUPPORT_FRAMES = 6  # of the frames within as many before and after, that stand out too: outliers come in fewer
SUPPORT_COLUMNS = 2  # to each side, in which they do
SUPPORT_POINTS = 21  # that do, in these frames and columns


class SectionTable(NamedTuple):
    """Sections of the stock at n stations, `step` mm apart from arc length 0, as the kernels see them."""

    step: float
    axes: Shaped[Float, "n 12"]  # lower edge, t, n, m in the base
    # upper edge, and the unit direction along the upper surface into the plate, along n and m
    stock: Shaped[Float, "n 4"]


def section_table(
    step: float, position_mm: Float, tangent: Float, normal: Float, across: Float, upper_mm: Float, inward: Float
) -> SectionTable:
    """A table from the lower edge (n, 3) mm, its axes (n, 3), the upper edge (n, 2) mm and `inward` (n, 2)."""
    axes = np.concatenate([position_mm, tangent, normal, across], axis=1)
    return SectionTable(float(step), as_input(axes), as_input(np.concatenate([upper_mm, inward], axis=1)))


def foreign_points(
    x_mm: Shaped[Float32, "N M"],
    z_mm: Shaped[Float32, "N M"],
    usable: Shaped[Bool, "N M"],
    base_from_profiler: Shaped[Float, "N 4 4"],
    sections: SectionTable,
    start: Shaped[Int, " N"],
    tolerance_mm: Shaped[Float, " n"],
) -> tuple[Int, Int]:
    """Frames and columns of the points that belong to no face of the stock: clamps, the table.

    They stand out of the end face, above the upper surface or below the lower one by more than the tolerance of their
    station, and so do points of several frames beside them (else they are streaks of outliers).

    Args:
        x_mm, z_mm: (N, M) profiler frame.
        usable: (N, M) points to look at.
        base_from_profiler: (N, 4, 4).
        sections: of the stock.
        start: (N,) station near each frame.
        tolerance_mm: (n,) at each station: burrs and roughness stand out less.
    """
    out = np.zeros(x_mm.shape, np.bool_)
    grid = (as_rows(x_mm), as_input(z_mm), as_input(usable), as_input(base_from_profiler))
    stock = (sections.axes, sections.stock, sections.step)
    over_blocks(partial(_stand_out, *grid, *stock, as_input(start), as_input(tolerance_mm), out), out.shape)
    supported = np.zeros_like(out)
    over_blocks(partial(_support, as_input(out), supported), out.shape)
    rows, columns = np.nonzero(supported)
    return rows, columns


@kernel(inline="always")
def _section_of(q0: float, q1: float, q2: float, i: int, axes: Float, step: float) -> tuple[int, float, float, float]:
    """Station nearest to a point, its distance beyond it along t, and its place along n and m there."""
    along = 0.0
    for _ in range(6):
        along = (q0 - axes[i, 0]) * axes[i, 3] + (q1 - axes[i, 1]) * axes[i, 4] + (q2 - axes[i, 2]) * axes[i, 5]
        if abs(along) <= 0.5 * step:
            break
        k = min(max(i + int(np.floor(along / step + 0.5)), 0), axes.shape[0] - 1)
        if k == i:
            break
        i = k
    d0, d1, d2 = q0 - axes[i, 0], q1 - axes[i, 1], q2 - axes[i, 2]
    h = d0 * axes[i, 6] + d1 * axes[i, 7] + d2 * axes[i, 8]
    return i, along, h, d0 * axes[i, 9] + d1 * axes[i, 10] + d2 * axes[i, 11]


@kernel
def _stand_out(
    x: Float32,
    z: Float32,
    usable: Bool,
    poses: Float,
    axes: Float,
    stock: Float,
    step: float,
    start: Int,
    tolerance: Float,
    out: Bool,
    first: int,
    last: int,
) -> None:
    for i in range(first, last):
        a, k, x_row = poses[i], start[i], x[min(i, len(x) - 1)]
        for j in range(x.shape[1]):
            if not usable[i, j]:
                continue
            u, w = np.float64(x_row[j]), np.float64(z[i, j])
            q0 = a[0, 0] * u + a[0, 2] * w + a[0, 3]
            q1 = a[1, 0] * u + a[1, 2] * w + a[1, 3]
            q2 = a[2, 0] * u + a[2, 2] * w + a[2, 3]
            k, _, h, v = _section_of(q0, q1, q2, k, axes, step)
            d, e = stock[k, 2], stock[k, 3]
            above = (h - stock[k, 0]) * e - (v - stock[k, 1]) * d  # the upper surface
            lean = h - stock[k, 0] * v / max(stock[k, 1], 1e-6)  # the line from the lower to the upper edge
            reach = 0.03 * np.sqrt(h * h + v * v)  # the surfaces' directions are not known better, far from the edge
            out[i, j] = max(above, lean, -v) > tolerance[k] + reach


@kernel
def _support(marked: Bool, out: Bool, first: int, last: int) -> None:
    for i in range(first, last):
        for j in range(marked.shape[1]):
            if not marked[i, j]:
                continue
            frames, points = 0, 0
            for r in range(max(i - SUPPORT_FRAMES, 0), min(i + SUPPORT_FRAMES + 1, marked.shape[0])):
                here = 0
                for c in range(max(j - SUPPORT_COLUMNS, 0), min(j + SUPPORT_COLUMNS + 1, marked.shape[1])):
                    here += marked[r, c]
                frames, points = frames + min(here, 1), points + here
            out[i, j] = frames >= SUPPORT_FRAMES and points >= SUPPORT_POINTS


class Cuts(NamedTuple):
    """What the layers of a path take away, at n stations: faces parallel to the bevel's."""

    cosine: float  # of the bevel's angle
    sine: float
    finished_mm: float  # place of the finished face along its normal
    ball_mm: float  # radius of the cutter's ball end; 0: it is flat
    # height above the finished face to which each layer cuts, linear between stations; infinite where it does not cut
    face_mm: Shaped[Float, "n layers"]
    reach_mm: Shaped[Float, " n"]  # how far down the bevel's slope the tip reaches, from the lower edge
    beyond_mm: float = 0.0  # how far beyond the ends of the edge the cuts at its ends go on


def standing_layers(
    x_mm: Shaped[Float32, "N M"],
    z_mm: Shaped[Float32, "N M"],
    keep: Shaped[Bool, "N M"],
    base_from_profiler: Shaped[Float, "N 4 4"],
    sections: SectionTable,
    start: Shaped[Int, " N"],
    cuts: Cuts,
) -> AnyArray:
    """For how many layers each point of the grid (N, M) still stands (uint16): 0 no point.

    65535: it belongs to the finished part; 65534: it stands above the finished face, and no layer takes it.

    Layer i takes a point away that lies above its face, and not beyond the tip of the cutter, where it cuts.

    Args:
        x_mm, z_mm, keep: (N, M) the grid in the profiler frame.
        base_from_profiler: (N, 4, 4).
        sections: at n stations.
        start: (N,) station near each frame.
        cuts: what the layers take away.
    """
    out = np.zeros(x_mm.shape, np.uint16)
    grid = (as_rows(x_mm), as_input(z_mm), as_input(keep), as_input(base_from_profiler))
    cosine, sine, finished, ball = map(float, (cuts.cosine, cuts.sine, cuts.finished_mm, cuts.ball_mm))
    slope = (cosine, sine, finished, ball, 0.5 * sections.step + float(cuts.beyond_mm) + 1e-6)
    cut = (as_input(cuts.face_mm), as_input(np.min(cuts.face_mm, axis=1)), as_input(cuts.reach_mm))
    stock = (sections.axes, sections.step, as_input(start))
    over_blocks(partial(_standing, *grid, *stock, slope, *cut, out), out.shape)
    return out


@kernel
def _ball_rise(beyond: float, radius: float) -> float:
    """Height of a ball end's surface over the cylinder's, `beyond` its centre towards the tip; 0 where it is flat."""
    if radius <= 0.0 or beyond <= 0.0:
        return 0.0
    return radius - math.sqrt(radius * radius - beyond * beyond) if beyond < radius else math.inf


@kernel
def _standing(
    x: Float32,
    z: Float32,
    keep: Bool,
    poses: Float,
    axes: Float,
    step: float,
    start: Int,
    slope: tuple[float, float, float, float, float],
    face: Float,
    lowest: Float,
    reach: Float,
    out: AnyArray,
    first: int,
    last: int,
) -> None:
    cosine, sine, finished, ball, beyond = slope
    last_station = axes.shape[0] - 1
    for i in range(first, last):
        a, k, x_row = poses[i], start[i], x[min(i, len(x) - 1)]
        for j in range(x.shape[1]):
            if not keep[i, j]:
                continue
            u, w = np.float64(x_row[j]), np.float64(z[i, j])
            q0 = a[0, 0] * u + a[0, 2] * w + a[0, 3]
            q1 = a[1, 0] * u + a[1, 2] * w + a[1, 3]
            q2 = a[2, 0] * u + a[2, 2] * w + a[2, 3]
            k, along, h, v = _section_of(q0, q1, q2, k, axes, step)
            height = cosine * h + sine * v - finished
            down = sine * h - cosine * v
            rises = _ball_rise(down - reach[k] + ball, ball)  # of what a ball end leaves
            out[i, j] = 65534 if height > rises else 65535
            beside = min(max(k + 1 if along > 0.0 else k - 1, 0), last_station)
            if abs(along) > beyond or height <= min(lowest[k], lowest[beside]) or down > reach[k]:
                continue
            share = min(abs(along) / step, 0.5)
            for layer in range(face.shape[1]):
                low, next_low = face[k, layer], face[beside, layer]
                if next_low < np.inf and low < np.inf:
                    low += share * (next_low - low)
                if height > low + rises:
                    out[i, j] = layer + 1
                    break


def needed_heights(
    points_mm: Float,
    station: Shaped[Int, " p"],
    origin_mm: Shaped[Float, "k 3"],
    tangent: Shaped[Float, "k 3"],
    outward: Shaped[Float, "k 3"],
    axis: Shaped[Float, "k 3"],
    reach: tuple[float, float, float],
) -> Float:
    """Height (k,) of the cutter above its k places that keeps it clear of points (p, 3); -inf where none is near.

    The cutter is a cylinder about an axis along `axis`, which touches its place from outside, without end on the
    shank's side. Lifted by L along `outward` it clears a point at (x inwards, y along the edge) beside it where
    (x + R + L)^2 + y^2 >= (R + clearance)^2; beyond its tip the clearance is round.

    Args:
        points_mm: that it must clear.
        station: (p,) index of the place nearest to each point.
        origin_mm, tangent, outward, axis: (k, 3) the places, about 1 mm apart, and their frames.
        reach: radius, clearance, and how far along the axis the tip reaches from the origin, mm.
    """
    height = np.full(len(origin_mm), -np.inf)
    places = np.concatenate([origin_mm, tangent, outward, axis], axis=1)
    sizes = (float(reach[0]), float(reach[1]), float(reach[2]))
    _needed(as_input(points_mm), as_input(station), as_input(places), sizes, height)
    return height


@kernel
def _needed(points: Float, station: Int, places: Float, sizes: tuple[float, float, float], out: Float) -> None:
    radius, clearance, tip = sizes
    wide, clear2 = radius + clearance, clearance * clearance
    window = int(1.5 * wide) + 3
    for i in range(points.shape[0]):
        for k in range(max(station[i] - window, 0), min(station[i] + window + 1, places.shape[0])):
            y, b, along = 0.0, 0.0, 0.0
            for c in range(3):
                d = points[i, c] - places[k, c]
                y, b, along = y + d * places[k, 3 + c], b + d * places[k, 6 + c], along + d * places[k, 9 + c]
            beyond = max(along - tip, 0.0)
            if abs(y) < wide and beyond < clearance:
                reach = radius + np.sqrt(clear2 - beyond * beyond)
                if abs(y) < reach:
                    out[k] = max(out[k], b - radius + np.sqrt(reach * reach - y * y))


def place(x_mm: Float32, z_mm: Float32, base_from_profiler: Float, rows: Int, columns: Int) -> Float:
    """Base coordinates (p, 3), float64, of some points of the grid."""
    pose, x, z = base_from_profiler[rows], x_mm[rows, columns], z_mm[rows, columns]
    return np.asarray(pose[:, :3, 0] * x[:, None] + pose[:, :3, 2] * z[:, None] + pose[:, :3, 3])


def nearest_stations(points_mm: Float, start: Int, sections: SectionTable) -> tuple[Int, Float, Float]:
    """Station (p,), arc length (p,) and section coordinates (p, 2) of points (p, 3) mm; `start` (p,) is a guess."""
    station, arc, section = np.empty(len(points_mm), np.int64), np.empty(len(points_mm)), np.empty((len(points_mm), 2))
    _stations(as_input(points_mm), as_input(start), sections.axes, sections.step, station, arc, section)
    return station, arc, section


@kernel
def _stations(points: Float, start: Int, axes: Float, step: float, station: Int, arc: Float, section: Float) -> None:
    for i in range(points.shape[0]):
        k, along, h, v = _section_of(points[i, 0], points[i, 1], points[i, 2], start[i], axes, step)
        station[i], arc[i] = k, k * step + along
        section[i, 0], section[i, 1] = h, v


def frame_stations(arc_length_mm: Float, pass_index: AnyArray, step: float, count: int) -> Int:
    """Station (N,) near each frame: where it crosses the edge, or between its neighbours where it does not see it."""
    start = np.zeros(len(arc_length_mm))
    for number in np.unique(pass_index):
        mine = np.flatnonzero(pass_index == number)
        good = mine[np.isfinite(arc_length_mm[mine])]
        if good.size:
            start[mine] = np.interp(mine, good, arc_length_mm[good])
    return np.clip(np.rint(start / step), 0, count - 1).astype(np.int64)
