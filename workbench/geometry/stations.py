"""Points of the scanner's grid beside the edge: which stand out of the stock, and which a cut takes away.

A section is a row of `SectionTable`: stations at even distances along the edge. Each point belongs to the station that
is nearest along the edge, and is seen in that station's section plane.
"""

from __future__ import annotations

import math
from functools import partial
from typing import NamedTuple

import numpy as np

from workbench.geometry.along import by_pass
from workbench.geometry.blocks import as_input, as_rows, over_blocks
from workbench.kernels import kernel
from workbench.units import AnyArray, Bool, Float, Float32, Int, Shaped

Vector = tuple[float, float, float]
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


class Scan(NamedTuple):
    """The scanner's grid beside n stations of an edge."""

    x_mm: Shaped[Float32, "N M"]  # in the profiler frame
    z_mm: Shaped[Float32, "N M"]
    base_from_profiler: Shaped[Float, "N 4 4"]
    start: Shaped[Int, " N"]  # station near each frame
    sections: SectionTable  # of the stock

    def seen_by(self, mask: Shaped[Bool, "N M"]) -> tuple[Float32, Float32, Bool, Float, Int, Float, float]:
        """What a kernel takes, to look at the points of a mask."""
        x, z, poses, start, sections = self
        grid = (as_rows(x), as_input(z), as_input(mask), as_input(poses), as_input(start))
        return (*grid, sections.axes, sections.step)


def standing_out(scan: Scan, usable: Shaped[Bool, "N M"], tolerance_mm: Shaped[Float, " n"]) -> Shaped[Bool, "N M"]:
    """Usable points out of the end face, above the upper surface or below the lower one by more than a tolerance.

    Args:
        scan: the grid.
        usable: (N, M) points to look at.
        tolerance_mm: (n,) at each station: burrs and roughness stand out less.
    """
    out = np.zeros(usable.shape, np.bool_)
    kernel_of = partial(_stand_out, *scan.seen_by(usable), scan.sections.stock, as_input(tolerance_mm), out)
    over_blocks(kernel_of, out.shape)
    return out


def supported(marked: Shaped[Bool, "N M"]) -> tuple[Int, Int]:
    """Frames and columns of the marked points beside which points of several frames are: else they are streaks."""
    found = np.zeros_like(marked)
    over_blocks(partial(_support, as_input(marked), found), marked.shape)
    rows, columns = np.nonzero(found)
    return rows, columns


@kernel(inline="always")
def _in_base(poses: Float, i: int, x: float, z: float) -> Vector:
    """The point (x, 0, z) of frame i."""
    u, w = np.float64(x), np.float64(z)
    return (
        poses[i, 0, 0] * u + poses[i, 0, 2] * w + poses[i, 0, 3],
        poses[i, 1, 0] * u + poses[i, 1, 2] * w + poses[i, 1, 3],
        poses[i, 2, 0] * u + poses[i, 2, 2] * w + poses[i, 2, 3],
    )


@kernel(inline="always")
def _section_of(q: Vector, i: int, axes: Float, step: float) -> tuple[int, float, float, float]:
    """Station nearest to a point, its distance beyond it along t, and its place along n and m there."""
    along = 0.0
    for _ in range(6):
        along = (q[0] - axes[i, 0]) * axes[i, 3] + (q[1] - axes[i, 1]) * axes[i, 4] + (q[2] - axes[i, 2]) * axes[i, 5]
        if abs(along) <= 0.5 * step:
            break
        k = min(max(i + int(np.floor(along / step + 0.5)), 0), axes.shape[0] - 1)
        if k == i:
            break
        i = k
    d0, d1, d2 = q[0] - axes[i, 0], q[1] - axes[i, 1], q[2] - axes[i, 2]
    h = d0 * axes[i, 6] + d1 * axes[i, 7] + d2 * axes[i, 8]
    return i, along, h, d0 * axes[i, 9] + d1 * axes[i, 10] + d2 * axes[i, 11]


@kernel
def _stand_out(
    x: Float32,
    z: Float32,
    usable: Bool,
    poses: Float,
    start: Int,
    axes: Float,
    step: float,
    stock: Float,
    tolerance: Float,
    out: Bool,
    first: int,
    last: int,
) -> None:
    for i in range(first, last):
        k, x_row = start[i], x[min(i, len(x) - 1)]
        for j in range(x.shape[1]):
            if not usable[i, j]:
                continue
            q = _in_base(poses, i, x_row[j], z[i, j])
            k, _, h, v = _section_of(q, k, axes, step)
            d, e = stock[k, 2], stock[k, 3]
            above = (h - stock[k, 0]) * e - (v - stock[k, 1]) * d  # the upper surface
            lean = h - stock[k, 0] * v / max(stock[k, 1], 1e-6)  # the line from the lower to the upper edge
            reach = 0.03 * np.sqrt(h * h + v * v)  # the surfaces' directions are not known better, far from the edge
            out[i, j] = max(above, lean, -v) > tolerance[k] + reach


@kernel
def _support(marked: Bool, out: Bool, first: int, last: int) -> None:
    for i in range(first, last):
        for j in range(marked.shape[1]):
            out[i, j] = marked[i, j] and _is_supported(marked, i, j)


@kernel
def _is_supported(marked: Bool, i: int, j: int) -> bool:
    frames, points = 0, 0
    for r in range(max(i - SUPPORT_FRAMES, 0), min(i + SUPPORT_FRAMES + 1, marked.shape[0])):
        here = 0
        for c in range(max(j - SUPPORT_COLUMNS, 0), min(j + SUPPORT_COLUMNS + 1, marked.shape[1])):
            here += marked[r, c]
        frames, points = frames + min(here, 1), points + here
        if frames >= SUPPORT_FRAMES and points >= SUPPORT_POINTS:
            return True
    return False


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


def standing_layers(scan: Scan, keep: Shaped[Bool, "N M"], cuts: Cuts) -> AnyArray:
    """For how many layers each point of the grid (N, M) still stands (uint16): 0 no point.

    65535: it belongs to the finished part; 65534: it stands above the finished face, and no layer takes it.

    Layer i takes a point away that lies above its face, and not beyond the tip of the cutter, where it cuts.

    Args:
        scan: the grid.
        keep: (N, M) its points.
        cuts: what the layers take away.
    """
    out = np.zeros(keep.shape, np.uint16)
    cosine, sine, finished, ball = map(float, (cuts.cosine, cuts.sine, cuts.finished_mm, cuts.ball_mm))
    slope = (cosine, sine, finished, ball, 0.5 * scan.sections.step + float(cuts.beyond_mm) + 1e-6)
    cut = (as_input(cuts.face_mm), as_input(np.min(cuts.face_mm, axis=1)), as_input(cuts.reach_mm))
    over_blocks(partial(_standing, *scan.seen_by(keep), slope, *cut, out), out.shape)
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
    start: Int,
    axes: Float,
    step: float,
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
        k, x_row = start[i], x[min(i, len(x) - 1)]
        for j in range(x.shape[1]):
            if not keep[i, j]:
                continue
            q = _in_base(poses, i, x_row[j], z[i, j])
            k, along, h, v = _section_of(q, k, axes, step)
            height = cosine * h + sine * v - finished
            down = sine * h - cosine * v
            rises = _ball_rise(down - reach[k] + ball, ball)  # of what a ball end leaves
            out[i, j] = 65534 if height > rises else 65535
            neighbour = min(max(k + 1 if along > 0.0 else k - 1, 0), last_station)
            if abs(along) > beyond or height <= min(lowest[k], lowest[neighbour]) or down > reach[k]:
                continue
            share = min(abs(along) / step, 0.5)
            for layer in range(face.shape[1]):
                low, next_low = face[k, layer], face[neighbour, layer]
                if next_low < np.inf and low < np.inf:
                    low += share * (next_low - low)
                if height > low + rises:
                    out[i, j] = layer + 1
                    break


def needed_heights(
    scan: Scan,
    marked: Shaped[Bool, "N M"],
    arc_length_mm: Shaped[Float, " k"],
    base_from_place: Shaped[Float, "k 4 4"],
    reach: tuple[float, float, float],
) -> Float:
    """Height (k,) of the cutter above its k places that keeps it clear of what is marked; -inf where it need not rise.

    The cutter is a cylinder about an axis along a place's z, which touches its place from outside, without end on the
    shank's side. Lifted by L against x it clears a point at (x inwards, y along the edge) beside it where
    (x + R + L)^2 + y^2 >= (R + clearance)^2; beyond its tip the clearance is round. A point counts where others support
    it, at the places within a window about the one that is nearest along the edge.

    A point that is too low, or too far beyond the tip, for all of these is told by the nearest of them: from place to
    place its coordinates change by no more than the places are turned, times its distance, and apart.

    Args:
        scan: the grid.
        marked: (N, M) by `standing_out`.
        arc_length_mm: (k,) of the places, about 1 mm apart.
        base_from_place: (k, 4, 4) x into the material, y along the edge, z along the cutter's axis to its tip.
        reach: radius, clearance, and how far along the axis the tip reaches from the origin, mm.
    """
    radius, clearance, tip = map(float, reach)
    window = int(1.5 * (radius + clearance)) + 3
    sizes = (radius, clearance, tip, window, *_spread(base_from_place, window))
    places = (as_input(arc_length_mm), as_input(base_from_place))
    blocks = over_blocks(partial(_needed, *scan.seen_by(marked), *places, sizes), marked.shape)
    return np.asarray(np.max([np.full(len(arc_length_mm), -np.inf), *blocks], axis=0))


def _spread(poses: Shaped[Float, "k 4 4"], window: int) -> tuple[float, float]:
    """How far poses no more than `window` from each other lie apart along x and z, mm, and are turned at most."""
    apart, rotation = 0.0, 0.0
    for shift in range(1, min(window, len(poses) - 1) + 1):
        one, other = poses[:-shift], poses[shift:]
        off = other[:, :3, 3] - one[:, :3, 3]
        for axes in (one, other):
            apart = max(apart, float(np.abs(np.einsum("ki,kij->kj", off, axes[:, :3, [0, 2]])).max()))
        rotation = max(rotation, float(np.linalg.norm(other[:, :3, :3] - one[:, :3, :3], axis=(1, 2)).max()))
    return apart, rotation


@kernel(inline="always")
def _seen_from(poses: Float, i: int, q: Vector) -> Vector:
    """A point's coordinates in the frame of pose i."""
    d0, d1, d2 = q[0] - poses[i, 0, 3], q[1] - poses[i, 1, 3], q[2] - poses[i, 2, 3]
    return (
        d0 * poses[i, 0, 0] + d1 * poses[i, 1, 0] + d2 * poses[i, 2, 0],
        d0 * poses[i, 0, 1] + d1 * poses[i, 1, 1] + d2 * poses[i, 2, 1],
        d0 * poses[i, 0, 2] + d1 * poses[i, 1, 2] + d2 * poses[i, 2, 2],
    )


@kernel
def _needed(
    x: Float32,
    z: Float32,
    marked: Bool,
    poses: Float,
    start: Int,
    axes: Float,
    step: float,
    arc: Float,
    places: Float,
    sizes: tuple[float, float, float, int, float, float],
    first: int,
    last: int,
) -> Float:
    radius, clearance, tip, window, apart, rotation = sizes
    wide, clear2, final = radius + clearance, clearance * clearance, places.shape[0] - 1
    height = np.full(len(places), -np.inf)
    for i in range(first, last):
        k, x_row = start[i], x[min(i, len(x) - 1)]
        for j in range(marked.shape[1]):
            if not marked[i, j]:
                continue
            q = _in_base(poses, i, x_row[j], z[i, j])
            k, along_edge, _, _ = _section_of(q, k, axes, step)
            nearest = min(np.searchsorted(arc, k * step + along_edge), final)
            inwards, y, along = _seen_from(places, nearest, q)
            spare = apart + rotation * np.sqrt(inwards * inwards + y * y + along * along)
            low = inwards > clearance + spare or along > tip + clearance + spare
            if low or not _is_supported(marked, i, j):
                continue
            for p in range(max(nearest - window, 0), min(nearest + window, final) + 1):
                inwards, y, along = _seen_from(places, p, q)
                beyond = max(along - tip, 0.0)
                if abs(y) < wide and beyond < clearance:
                    reach = radius + np.sqrt(clear2 - beyond * beyond)
                    if abs(y) < reach:
                        height[p] = max(height[p], -inwards - radius + np.sqrt(reach * reach - y * y))
    return height


def frame_stations(arc_length_mm: Float, pass_index: AnyArray, step: float, count: int) -> Int:
    """Station (N,) near each frame: where it crosses the edge, or between its neighbours where it does not see it."""
    start = np.zeros(len(arc_length_mm))
    for mine in by_pass(pass_index):
        good = mine[np.isfinite(arc_length_mm[mine])]
        if good.size:
            start[mine] = np.interp(mine, good, arc_length_mm[good])
    return np.clip(np.rint(start / step), 0, count - 1).astype(np.int64)
