"""Points of the scanner's grid beside the edge: which stand out of the stock, and which a cut takes away.

A section is a row of `SectionTable`: stations at even distances along the edge. Each point belongs to the station that
is nearest along the edge, and is seen in that station's section plane.
"""

from __future__ import annotations

from functools import partial
from typing import NamedTuple

import numpy as np
from numba import njit

from workbench.geometry.blocks import as_input, over_blocks
from workbench.units import AnyArray, Bool, Float, Float32, Int

BLOCK = 5  # frames and columns around a point in which others must stand out too
LEAST_SUPPORT = 8  # of them: a clamp is wider than a streak of outliers


class SectionTable(NamedTuple):
    """Sections of the stock at n stations, `step` mm apart from arc length 0, as the kernels see them."""

    step: float
    position: Float  # (n, 3) lower edge
    tangent: Float  # (n, 3)
    normal: Float  # (n, 3)
    across: Float  # (n, 3)
    upper: Float  # (n, 2) upper edge, along n and m
    inward: Float  # (n, 2) unit, along the upper surface into the plate


def section_table(step: float, *arrays: Float) -> SectionTable:
    """A table of read-only, contiguous arrays, so that each kernel is compiled once."""
    return SectionTable(float(step), *(as_input(a.astype(np.float64, copy=False)) for a in arrays))


def foreign_points(x_mm: Float32, z_mm: Float32, usable: Bool, base_from_profiler: Float, sections: SectionTable,
                   start: Int, tolerance_mm: Float) -> tuple[Int, Int]:  # fmt: skip
    """Frames and columns of the points that belong to no face of the stock: clamps, the table.

    They stand out of the end face, above the upper surface or below the lower one by more than the tolerance of their
    station, and so do some of their neighbours on the grid (else they are outliers).

    Args:
        x_mm, z_mm: (N, M) profiler frame.
        usable: (N, M) points to look at.
        base_from_profiler: (N, 4, 4).
        sections: of the stock.
        start: (N,) station near each frame.
        tolerance_mm: (n,) at each station: burrs and roughness stand out less.
    """
    out = np.zeros(x_mm.shape, np.bool_)
    args = (as_input(x_mm), as_input(z_mm), as_input(usable), as_input(base_from_profiler), sections, as_input(start))
    over_blocks(partial(_stand_out, *args, as_input(tolerance_mm), out), out.shape)
    supported = np.zeros_like(out)
    over_blocks(partial(_support, as_input(out), supported), out.shape)
    rows, columns = np.nonzero(supported)
    return rows, columns


@njit(nogil=True, cache=True)
def _section_of(q0: float, q1: float, q2: float, j: int, sections: SectionTable) -> tuple[int, float, float, float]:
    """Station nearest to a point, its distance beyond it along t, and its place along n and m there."""
    last = sections.position.shape[0] - 1
    along, i = 0.0, j
    for _ in range(6):
        p, t = sections.position[i], sections.tangent[i]
        along = (q0 - p[0]) * t[0] + (q1 - p[1]) * t[1] + (q2 - p[2]) * t[2]
        k = i + int(np.floor(along / sections.step + 0.5))
        k = min(max(k, 0), last)
        if k == i:
            break
        i = k
    p, n, m = sections.position[i], sections.normal[i], sections.across[i]
    d0, d1, d2 = q0 - p[0], q1 - p[1], q2 - p[2]
    return i, along, d0 * n[0] + d1 * n[1] + d2 * n[2], d0 * m[0] + d1 * m[1] + d2 * m[2]


@njit(nogil=True, cache=True)
def _outside(h: float, v: float, upper: Float, inward: Float) -> float:
    """How far a point (h, v) of the section stands out of the stock: of its end face, upper or lower surface."""
    above = (v - upper[1]) * -inward[0] + (h - upper[0]) * inward[1]  # left of the way in, seen along the edge
    lean = h - upper[0] * v / max(upper[1], 1e-6)  # of the line from the lower to the upper edge
    return max(max(above, lean), -v)


@njit(nogil=True, cache=True)
def _stand_out(x: Float32, z: Float32, usable: Bool, poses: Float, sections: SectionTable, start: Int,
               tolerance: Float, out: Bool, first: int, last: int) -> None:  # fmt: skip
    for i in range(first, last):
        a, j0 = poses[i], start[i]
        for j in range(x.shape[1]):
            if not usable[i, j]:
                continue
            u, w = np.float64(x[i, j]), np.float64(z[i, j])
            q0 = a[0, 0] * u + a[0, 2] * w + a[0, 3]
            q1 = a[1, 0] * u + a[1, 2] * w + a[1, 3]
            q2 = a[2, 0] * u + a[2, 2] * w + a[2, 3]
            k, _, h, v = _section_of(q0, q1, q2, j0, sections)
            j0 = k
            reach = 0.03 * np.sqrt(h * h + v * v)  # the surfaces' directions are not known better, far from the edge
            out[i, j] = _outside(h, v, sections.upper[k], sections.inward[k]) > tolerance[k] + reach


@njit(nogil=True, cache=True)
def _support(marked: Bool, out: Bool, first: int, last: int) -> None:
    half = BLOCK // 2
    for i in range(first, last):
        for j in range(marked.shape[1]):
            if not marked[i, j]:
                continue
            count = 0
            for r in range(max(i - half, 0), min(i + half + 1, marked.shape[0])):
                for c in range(max(j - half, 0), min(j + half + 1, marked.shape[1])):
                    count += marked[r, c]
            out[i, j] = count > LEAST_SUPPORT


def needed_heights(points_mm: Float, station: Int, origin_mm: Float, tangent: Float, outward: Float, axis: Float,
                   reach: tuple[float, float, float]) -> Float:  # fmt: skip
    """Height (k,) of the cutter above its k places that keeps it clear of points (p, 3); -inf where none is near.

    The cutter is a cylinder about an axis along `axis`, which touches its place from outside, without end on the
    shank's side. Lifted by L along `outward` it clears a point at (x inwards, y along the edge) where
    (x + R + L)^2 + y^2 >= (R + clearance)^2.

    Args:
        points_mm: that it must clear.
        station: (p,) index of the place nearest to each point.
        origin_mm, tangent, outward, axis: (k, 3) the places, about 1 mm apart, and their frames.
        reach: radius, clearance, and how far along the axis the tip reaches from the origin, mm.
    """
    height = np.full(len(origin_mm), -np.inf)
    frames = (as_input(v) for v in (origin_mm, tangent, outward, axis))
    _needed(as_input(points_mm), as_input(station), *frames, *map(float, reach), height)
    return height


@njit(nogil=True, cache=True)
def _needed(points: Float, station: Int, origin: Float, tangent: Float, outward: Float, axis: Float, radius: float,
            clearance: float, tip: float, out: Float) -> None:  # fmt: skip
    wide = radius + clearance
    window = int(1.5 * wide) + 3
    for i in range(points.shape[0]):
        for k in range(max(station[i] - window, 0), min(station[i] + window + 1, origin.shape[0])):
            y, b, along = 0.0, 0.0, 0.0
            for c in range(3):
                d = points[i, c] - origin[k, c]
                y, b, along = y + d * tangent[k, c], b + d * outward[k, c], along + d * axis[k, c]
            if abs(y) < wide and along < tip + clearance:
                out[k] = max(out[k], b - radius + np.sqrt(wide * wide - y * y))


def place(x_mm: Float32, z_mm: Float32, base_from_profiler: Float, rows: Int, columns: Int) -> Float:
    """Base coordinates (p, 3), float64, of some points of the grid."""
    pose, x, z = base_from_profiler[rows], x_mm[rows, columns], z_mm[rows, columns]
    return np.asarray(pose[:, :3, 0] * x[:, None] + pose[:, :3, 2] * z[:, None] + pose[:, :3, 3])


def nearest_stations(points_mm: Float, start: Int, sections: SectionTable) -> tuple[Int, Float, Float]:
    """Station (p,), arc length (p,) and section coordinates (p, 2) of points (p, 3) mm; `start` (p,) is a guess."""
    station, arc, section = np.empty(len(points_mm), np.int64), np.empty(len(points_mm)), np.empty((len(points_mm), 2))
    _stations(as_input(points_mm), as_input(start), sections, station, arc, section)
    return station, arc, section


@njit(nogil=True, cache=True)
def _stations(points: Float, start: Int, sections: SectionTable, station: Int, arc: Float, section: Float) -> None:
    for i in range(points.shape[0]):
        k, along, h, v = _section_of(points[i, 0], points[i, 1], points[i, 2], start[i], sections)
        station[i], arc[i] = k, k * sections.step + along
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
