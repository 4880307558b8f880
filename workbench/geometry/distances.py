"""Least distances, exact: of cutters' axes from the stock that still stands, of straight segments from each other.

From stock by branch and bound, with the scanner's grid as the index. Blocks of 8 frames x 16 columns get a sphere
around their points, 2 x 2 blocks a sphere around theirs, and so on to the top. A query goes down where the sphere is
nearer than the best distance so far, nearest first, beginning with the block that answered the query before it.

A cut takes points away layer by layer: point and block know for how many layers they still stand.

Of segments, many are asked for against many lines; spheres around neighbouring lines are the index.
"""

from __future__ import annotations

import math
from functools import partial
from typing import NamedTuple, TypeAlias

import numpy as np

from workbench.geometry.blocks import as_input, in_order, over_blocks
from workbench.kernels import kernel
from workbench.units import AnyArray, Float, Float32, Int, Shaped

Axis: TypeAlias = tuple[float, float, float, float, float, float, float]  # start, unit direction, length
Node: TypeAlias = tuple[int, int, int]  # level of a block, and its place along frames and columns

LEAF_FRAMES, LEAF_COLUMNS = 8, 16
ALWAYS = 2**16 - 1  # layers for which a point stands that must remain
QUERIES = 2048  # in a row, so that each may begin with the answer of the one before it
MOST_NODES = 128  # that wait at a time: less than four a level
GROUP = 16  # neighbouring lines that share a sphere


class Stock(NamedTuple):
    """The points of a cloud as an index for distances."""

    x_mm: Shaped[Float32, "N M"]
    z_mm: Shaped[Float32, "N M"]
    base_from_profiler: Shaped[Float, "N 4 4"]
    stands: Shaped[AnyArray, "N M"]  # uint16: it still stands for the layers before this one; 0: not a point
    spheres: Shaped[Float, "b 4"]  # centre and radius of each block, level by level from the leaves; radius -1: empty
    block_stands: Shaped[AnyArray, " b"]  # uint16: the longest of its points
    shape: Shaped[Int, "levels 3"]  # first block, blocks along the frames, blocks along the columns


class Stack(NamedTuple):
    """Blocks that wait to be looked at, the nearest on top."""

    nodes: Shaped[Int, "w 3"]  # level, and place along frames and columns
    bounds: Shaped[Float, " w"]  # no point of the block is nearer


def build_stock(
    x_mm: Shaped[Float32, "N M"],
    z_mm: Shaped[Float32, "N M"],
    base_from_profiler: Shaped[Float, "N 4 4"],
    stands: Shaped[AnyArray, "N M"],
) -> Stock:
    """The index over the points of a cloud: one pass.

    Args:
        x_mm, z_mm: (N, M) the grid in the profiler frame.
        base_from_profiler: (N, 4, 4).
        stands: (N, M) uint16, number of layers before which each point stands; 0: no point, `ALWAYS`: must remain.
    """
    shape = _levels(*x_mm.shape)
    count = int(shape[-1, 0] + shape[-1, 1] * shape[-1, 2])
    spheres, block_stands = np.empty((count, 4)), np.zeros(count, np.uint16)
    x, z, poses = as_input(x_mm), as_input(z_mm), as_input(base_from_profiler)
    leaves = partial(_leaves, x, z, poses, as_input(stands), spheres, block_stands)
    over_blocks(leaves, (int(shape[0, 1]), max(x_mm.shape[1] * LEAF_FRAMES, 1)))
    _parents(shape, spheres, block_stands)
    return Stock(x, z, poses, as_input(stands), as_input(spheres), as_input(block_stands), as_input(shape))


def axis_distances(
    stock: Stock,
    start_mm: Shaped[Float, "k 3"],
    end_mm: Shaped[Float, "k 3"],
    layer: Shaped[Int, " k"],
    bound_mm: Shaped[Float, " k"],
    flat: bool = False,
) -> Float:
    """Least distance (k,) of axes, straight from `start_mm` to `end_mm` (k, 3), to the points that still stand.

    Args:
        stock: the points.
        start_mm, end_mm: (k, 3) ends of each axis; neighbours in the list are best neighbours in space.
        layer: (k,) number of layers that are done by then.
        bound_mm: (k,) no distance is greater than this (infinite: not known).
        flat: only points beside an axis count, as inside a cylinder with flat ends; else those beyond its ends too.
    """
    out = np.array(bound_mm, dtype=np.float64)
    ask = partial(_ask, stock, _ends(start_mm, end_mm), as_input(layer.astype(np.int64)), flat, out)
    list(in_order(ask, len(out), QUERIES))
    return out


def _ends(start_mm: Float, end_mm: Float) -> Float:
    """Segments (k, 2, 3) from their ends (k, 3)."""
    return as_input(np.stack([start_mm, end_mm], axis=1))


def _levels(frames: int, columns: int) -> Int:
    """(levels, 3) first block and counts of blocks, from the leaves to a single block."""
    rows, across, first, out = -(-frames // LEAF_FRAMES), -(-columns // LEAF_COLUMNS), 0, []
    while True:
        out.append((first, rows, across))
        if rows <= 1 and across <= 1:
            return np.array(out, np.int64)
        first, rows, across = first + rows * across, -(-rows // 2), -(-across // 2)


@kernel
def _leaves(
    x: Float32,
    z: Float32,
    poses: Float,
    stands: AnyArray,
    spheres: Float,
    block_stands: AnyArray,
    first: int,
    last: int,
) -> None:
    """Spheres of the leaves in rows first to last of the blocks: about the corners of x and z, in every frame."""
    frames, columns = x.shape
    across = (columns + LEAF_COLUMNS - 1) // LEAF_COLUMNS
    for row in range(first, last):
        i0, i1 = row * LEAF_FRAMES, min((row + 1) * LEAF_FRAMES, frames)
        middle = poses[(i0 + i1) // 2]
        for block in range(across):
            x0, x1, z0, z1, longest = np.inf, -np.inf, np.inf, -np.inf, 0
            for i in range(i0, i1):
                for j in range(block * LEAF_COLUMNS, min((block + 1) * LEAF_COLUMNS, columns)):
                    if stands[i, j] > 0:
                        u, w = x[i, j], z[i, j]
                        x0, x1, z0, z1 = min(x0, u), max(x1, u), min(z0, w), max(z1, w)
                        longest = max(longest, stands[i, j])
            index = row * across + block
            block_stands[index] = longest
            spheres[index, 3] = -1.0
            if x0 > x1:
                continue
            u, w = 0.5 * (x0 + x1), 0.5 * (z0 + z1)
            for c in range(3):
                spheres[index, c] = middle[c, 0] * u + middle[c, 2] * w + middle[c, 3]
            far = 0.0
            for i in range(i0, i1):
                for corner in range(4):
                    u, w = x0 if corner < 2 else x1, z0 if corner % 2 else z1
                    off = 0.0
                    for c in range(3):
                        d = poses[i, c, 0] * u + poses[i, c, 2] * w + poses[i, c, 3] - spheres[index, c]
                        off += d * d
                    far = max(far, off)
            spheres[index, 3] = np.sqrt(far) + 1e-9


@kernel
def _parents(shape: Int, spheres: Float, block_stands: AnyArray) -> None:
    for level in range(1, shape.shape[0]):
        first, rows, across = shape[level]
        below, rows_below, across_below = shape[level - 1]
        for r in range(rows):
            for c in range(across):
                index = first + r * across + c
                spheres[index, 3] = -1.0
                for a in range(2 * r, min(2 * r + 2, rows_below)):
                    for b in range(2 * c, min(2 * c + 2, across_below)):
                        child = below + a * across_below + b
                        _enclose(spheres[index], spheres[child])
                        block_stands[index] = max(block_stands[index], block_stands[child])


@kernel
def _put(ball: Float, other: Float) -> None:
    """Component by component: a slice takes two seconds to compile."""
    for i in range(ball.size):
        ball[i] = other[i]


@kernel
def _enclose(ball: Float, other: Float) -> None:
    """Make `ball` the least sphere around itself and `other`."""
    if other[3] < 0.0:
        return
    if ball[3] < 0.0:
        _put(ball, other)
        return
    d0, d1, d2 = other[0] - ball[0], other[1] - ball[1], other[2] - ball[2]
    apart = np.sqrt(d0 * d0 + d1 * d1 + d2 * d2)
    if apart + other[3] <= ball[3]:
        return
    if apart + ball[3] <= other[3]:
        _put(ball, other)
        return
    radius = 0.5 * (apart + ball[3] + other[3])
    share = (radius - ball[3]) / apart
    ball[0], ball[1], ball[2] = ball[0] + share * d0, ball[1] + share * d1, ball[2] + share * d2
    ball[3] = radius + 1e-9


@kernel
def _ask(stock: Stock, ends: Float, layer: Int, flat: bool, out: Float, first: int, last: int) -> None:
    spheres, block_stands, shape = stock.spheres, stock.block_stands, stock.shape
    levels = shape.shape[0]
    top = shape[levels - 1, 0]
    nodes, bounds = np.empty((MOST_NODES, 3), np.int64), np.empty(MOST_NODES)
    stack, warm = Stack(nodes, bounds), -1
    for k in range(first, last):
        axis = _axis(ends, k)
        best = out[k]
        if warm >= 0 and block_stands[warm] > layer[k]:
            best = _nearest(stock, warm, axis, layer[k], flat, best)
        waiting = 1
        nodes[0, 0], nodes[0, 1], nodes[0, 2] = levels - 1, 0, 0
        bounds[0] = _bound(spheres[top], axis)
        while waiting > 0:
            waiting -= 1
            if bounds[waiting] >= best:
                continue
            node = nodes[waiting, 0], nodes[waiting, 1], nodes[waiting, 2]
            if node[0] == 0:
                leaf = node[1] * shape[0, 2] + node[2]
                nearer = _nearest(stock, leaf, axis, layer[k], flat, best)
                if nearer < best:
                    best, warm = nearer, leaf
                continue
            waiting = _open(stock, node, axis, layer[k], best, stack, waiting)
        out[k] = best


@kernel
def _axis(ends: Float, k: int) -> Axis:
    """Segment k of (n, 2, 3)."""
    x, y, z = ends[k, 1, 0] - ends[k, 0, 0], ends[k, 1, 1] - ends[k, 0, 1], ends[k, 1, 2] - ends[k, 0, 2]
    length = math.sqrt(x * x + y * y + z * z)
    share = 1.0 / max(length, 1e-12)
    return ends[k, 0, 0], ends[k, 0, 1], ends[k, 0, 2], x * share, y * share, z * share, length


@kernel
def _open(stock: Stock, node: Node, axis: Axis, layer: int, best: float, stack: Stack, waiting: int) -> int:
    """Put the node's children that may hold something nearer on the stack, the nearest on top; how many wait then."""
    spheres, block_stands, shape, (nodes, bounds), (level, r, c) = (
        stock.spheres,
        stock.block_stands,
        stock.shape,
        stack,
        node,
    )
    below, rows, across = shape[level - 1, 0], shape[level - 1, 1], shape[level - 1, 2]
    floor = waiting
    for a in range(2 * r, min(2 * r + 2, rows)):
        for b in range(2 * c, min(2 * c + 2, across)):
            child = below + a * across + b
            if block_stands[child] <= layer:
                continue
            bound = _bound(spheres[child], axis)
            if bound >= best:
                continue
            at = waiting
            while at > floor and bounds[at - 1] < bound:
                bounds[at] = bounds[at - 1]
                nodes[at, 0], nodes[at, 1], nodes[at, 2] = nodes[at - 1, 0], nodes[at - 1, 1], nodes[at - 1, 2]
                at -= 1
            bounds[at] = bound
            nodes[at, 0], nodes[at, 1], nodes[at, 2] = level - 1, a, b
            waiting += 1
    return waiting


@kernel
def _bound(sphere: Float, axis: Axis) -> float:
    """No point of a sphere is nearer to the axis than this."""
    d0, d1, d2 = sphere[0] - axis[0], sphere[1] - axis[1], sphere[2] - axis[2]
    along = min(max(d0 * axis[3] + d1 * axis[4] + d2 * axis[5], 0.0), axis[6])
    d0, d1, d2 = d0 - along * axis[3], d1 - along * axis[4], d2 - along * axis[5]
    return math.sqrt(d0 * d0 + d1 * d1 + d2 * d2) - float(sphere[3])


@kernel
def _nearest(stock: Stock, leaf: int, axis: Axis, layer: int, flat: bool, best: float) -> float:
    """The least of `best` and the distances of a leaf's points that still stand.

    In a frame both the place along the axis and the square of the distance from its start are polynomials of x and z.
    """
    x, z, poses, stands, across = stock.x_mm, stock.z_mm, stock.base_from_profiler, stock.stands, stock.shape[0, 2]
    i0, j0 = leaf // across * LEAF_FRAMES, leaf % across * LEAF_COLUMNS
    i1, j1 = min(i0 + LEAF_FRAMES, x.shape[0]), min(j0 + LEAF_COLUMNS, x.shape[1])
    least = best * best
    for i in range(i0, i1):
        p = poses[i]
        o0, o1, o2 = p[0, 3] - axis[0], p[1, 3] - axis[1], p[2, 3] - axis[2]
        ox = o0 * p[0, 0] + o1 * p[1, 0] + o2 * p[2, 0]
        oz = o0 * p[0, 2] + o1 * p[1, 2] + o2 * p[2, 2]
        oo = o0 * o0 + o1 * o1 + o2 * o2
        ex = axis[3] * p[0, 0] + axis[4] * p[1, 0] + axis[5] * p[2, 0]
        ez = axis[3] * p[0, 2] + axis[4] * p[1, 2] + axis[5] * p[2, 2]
        eo = axis[3] * o0 + axis[4] * o1 + axis[5] * o2
        xx = p[0, 0] ** 2 + p[1, 0] ** 2 + p[2, 0] ** 2  # 1 but for the rounding of a calibration
        zz = p[0, 2] ** 2 + p[1, 2] ** 2 + p[2, 2] ** 2
        xz = p[0, 0] * p[0, 2] + p[1, 0] * p[1, 2] + p[2, 0] * p[2, 2]
        for j in range(j0, j1):
            u, w = np.float64(x[i, j]), np.float64(z[i, j])
            place = ex * u + ez * w + eo
            along = min(max(place, 0.0), axis[6])
            if flat and along != place:
                continue
            square = u * (xx * u + 2.0 * (xz * w + ox)) + w * (zz * w + 2.0 * oz) + oo - along * (2.0 * place - along)
            if square < least and stands[i, j] > layer:
                least = square
    return math.sqrt(max(least, 0.0)) if least < best * best else best


# Segments from each other.


class LineIndex(NamedTuple):
    """Segments in an order in which neighbours are near each other, and a sphere around every 16 of them."""

    ends_mm: Shaped[Float, "n 2 3"]
    spheres: Shaped[Float, "groups 4"]  # centre and radius


def index_lines(start_mm: Float, end_mm: Float) -> LineIndex | None:
    """An index of the segments from start to end (n, 3); None where there are none."""
    if len(start_mm) == 0:
        return None
    lines, groups = _ends(start_mm, end_mm), []
    for first in range(0, len(lines), GROUP):
        ends = lines[first : first + GROUP].reshape(-1, 3)
        centre = ends.mean(axis=0)
        groups.append([*centre, np.linalg.norm(ends - centre, axis=1).max() + 1e-9])
    return LineIndex(lines, np.array(groups))


def line_distances(index: LineIndex, start_mm: Float, end_mm: Float) -> Float:
    """Least distance (k,) from each of the segments from start to end (k, 3) to the lines."""
    out = np.full(len(start_mm), np.inf)
    list(in_order(partial(_ask_lines, index, _ends(start_mm, end_mm), out), len(out), QUERIES))
    return out


@kernel
def _ask_lines(index: LineIndex, ends: Float, out: Float, first: int, last: int) -> None:
    warm = 0
    for k in range(first, last):
        axis, best = _axis(ends, k), _of_group(index.ends_mm, warm, ends, k, np.inf)
        for g in range(index.spheres.shape[0]):
            if g != warm and _bound(index.spheres[g], axis) < best:
                nearer = _of_group(index.ends_mm, g, ends, k, best)
                if nearer < best:
                    best, warm = nearer, g
        out[k] = best


@kernel
def _of_group(lines: Float, group: int, ends: Float, k: int, best: float) -> float:
    for i in range(group * GROUP, min((group + 1) * GROUP, lines.shape[0])):
        best = min(best, segments_apart(ends, k, lines, i))
    return best


@kernel(error_model="numpy")
def segments_apart(one: Float, a: int, other: Float, b: int) -> float:
    """Distance of segments a and b of two lists (n, 2, 3) (Ericson, Real-Time Collision Detection, 2005, 5.1.9)."""
    uu, vv, uv, uw, vw, ww = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for r in range(3):
        u, v, w = one[a, 1, r] - one[a, 0, r], other[b, 1, r] - other[b, 0, r], one[a, 0, r] - other[b, 0, r]
        uu, vv, uv = uu + u * u, vv + v * v, uv + u * v
        uw, vw, ww = uw + u * w, vw + v * w, ww + w * w
    square = uu * vv - uv * uv
    s = min(max((uv * vw - uw * vv) / square, 0.0), 1.0) if square > 1e-12 * uu * vv else 0.0
    t = (uv * s + vw) / vv if vv > 0.0 else 0.0
    if t < 0.0 or t > 1.0 or vv == 0.0:
        t = min(max(t, 0.0), 1.0)
        s = min(max((uv * t - uw) / uu, 0.0), 1.0) if uu > 0.0 else 0.0
    left = 0.0
    for r in range(3):
        on_one = one[a, 0, r] + s * (one[a, 1, r] - one[a, 0, r])
        on_other = other[b, 0, r] + t * (other[b, 1, r] - other[b, 0, r])
        left += (on_one - on_other) ** 2
    return math.sqrt(left)
