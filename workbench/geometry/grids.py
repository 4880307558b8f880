"""Compiled kernels on the scanner's grid, frames x columns: no neighbour search, every byte touched once.

NaN (no return) goes through arithmetic as NaN, so `fastmath` is off.
"""

from __future__ import annotations

import math
from functools import partial

import numpy as np

from workbench.geometry.blocks import as_input, as_rows, over_blocks
from workbench.kernels import kernel
from workbench.units import AnyArray, Bool, Float, Float32, Int, Shaped

_EXPONENT = np.int32(0x7F800000)  # float32 bits without the sign: equal = infinite, above = NaN, below = finite
_MAGNITUDE = np.int32(0x7FFFFFFF)
# Neighbouring columns that may be blind; returns by which one that seldom measures differs from one that never does (of
# so many expected none comes once in 20,000 times); frames that tell it.
MOST_BLIND, LIVE_RETURNS, TELLING = 24, 10, 1000
SELDOM = 0.1  # of the frames in which the next column returns, that the last one beside a shadow does not

FUSED_TOGETHER = 2**20  # points that one core has fused before another has begun


def fuse(
    x_mm: Shaped[Float32, "N M"],
    z_mm: Shaped[Float32, "N M"],
    base_from_profiler: Shaped[Float, "N 4 4"],
    origin_mm: Shaped[Float, " 3"],
    out: Shaped[Float32, "N M 3"] | None = None,
) -> Float32:
    """Base coordinates, less `origin_mm`, of every grid point: the paper's equation (9), one pose per frame.

    Args:
        x_mm, z_mm: (N, M) profiler coordinates, NaN where nothing came back; rows contiguous.
        base_from_profiler: (N, 4, 4) pose of the profiler at each frame.
        origin_mm: (3,) in the base, near the points: float32 then errs by less than 1e-4 mm within 1 m of it, while
            float32 at 5 m from the base would err by 2.4e-4 mm in its last digit alone.
        out: (N, M, 3) to write to, if given; quickest is what this function returned before.

    Returns:
        (N, M, 3) base coordinates minus `origin_mm`; NaN where x or z is. In memory each frame is a row of x, one of y
        and one of z, which are written at about the speed of a copy; triples take half as long again.
    """
    frames, columns = x_mm.shape
    if z_mm.shape != x_mm.shape or base_from_profiler.shape != (len(x_mm), 4, 4):
        raise ValueError("x_mm and z_mm are (N, M), base_from_profiler is (N, 4, 4)")
    points = np.empty((frames, 3, columns), np.float32).transpose(0, 2, 1) if out is None else out
    if points.shape != (frames, columns, 3) or points.dtype != np.float32:
        raise ValueError("out is (N, M, 3), float32")
    grid, poses = (as_rows(x_mm), as_input(z_mm)), (as_input(base_from_profiler), as_input(origin_mm))
    work = partial(_fuse, *grid, *poses, points.transpose(0, 2, 1))
    over_blocks(work, x_mm.shape, FUSED_TOGETHER)
    return points


@kernel
def _fuse(x: Float32, z: Float32, poses: Float, origin: Float, out: Float32, first: int, last: int) -> None:
    for i in range(first, last):
        for k in range(3):  # the subtraction happens in float64
            a, b, c = np.float32(poses[i, k, 0]), np.float32(poses[i, k, 2]), np.float32(poses[i, k, 3] - origin[k])
            u, w, row = x[min(i, len(x) - 1)], z[i], out[i, k]
            for j in range(u.size):
                row[j] = a * u[j] + b * w[j] + c


def returns(x_mm: Float32, z_mm: Float32) -> Bool:
    """(N, M) where something came back: x and z both finite."""
    keep = np.empty(x_mm.shape, np.bool_)
    over_blocks(partial(_returns, _bits(x_mm), _bits(z_mm), keep), keep.shape)
    return keep


@kernel
def _returns(x_bits: AnyArray, z_bits: AnyArray, keep: Bool, first: int, last: int) -> None:
    for i in range(first, last):
        x, z, row = x_bits[min(i, len(x_bits) - 1)], z_bits[i], keep[i]
        for j in range(row.size):
            row[j] = ((x[j] & _MAGNITUDE) < _EXPONENT) & ((z[j] & _MAGNITUDE) < _EXPONENT)


def _bits(values_mm: Float32) -> AnyArray:
    return as_rows(values_mm).view(np.int32)


def extent(x_mm: Float32, z_mm: Float32) -> tuple[float, float]:
    """Greatest distance of two returns along x, and greatest range |z|, mm; NaN without a return."""
    found = np.array(over_blocks(partial(_extent, _bits(x_mm), _bits(z_mm)), x_mm.shape), np.int32)
    order = np.array([found[:, 0].min(), found[:, 1].max(), found[:, 2].max()], np.int32)
    if order[0] > order[1]:
        return float("nan"), float("nan")
    low, high, far = (order ^ (order >> 31 & _MAGNITUDE)).view(np.float32)
    return float(high - low), float(far)


@kernel
def _extent(x_bits: AnyArray, z_bits: AnyArray, first: int, last: int) -> tuple[np.int32, np.int32, np.int32]:
    """Least and greatest x and greatest |z| of the returns, as integers in the order of the numbers."""
    low, high, far = _MAGNITUDE, ~_MAGNITUDE, ~_MAGNITUDE
    for i in range(first, last):
        x, z = x_bits[min(i, len(x_bits) - 1)], z_bits[i]
        for j in range(z.size):
            u, w = x[j], z[j] & _MAGNITUDE
            back = ((u & _MAGNITUDE) < _EXPONENT) & (w < _EXPONENT)
            order = u ^ (u >> np.int32(31) & _MAGNITUDE)
            low = min(low, order if back else _MAGNITUDE)
            high = max(high, order if back else ~_MAGNITUDE)
            far = max(far, w if back else ~_MAGNITUDE)
    return low, high, far


def frame_digests(values: Float32) -> AnyArray:
    """A 64-bit digest (N,) of each frame's bits: two frames that differ have the same one once in 2^32 pairs or less.

    The digest is multilinear in the bits, with fixed odd numbers drawn once (Carter and Wegman 1979).
    """
    bits, out = as_input(values).view(np.uint32), np.empty(len(values), np.uint64)
    drawn = np.asarray(np.random.default_rng(20261120).integers(2**63, size=bits.shape[1], dtype=np.uint64))
    keys = drawn | np.uint64(1)
    over_blocks(partial(_digests, bits, as_input(keys), out), values.shape)
    return out


@kernel
def _digests(bits: AnyArray, keys: AnyArray, out: AnyArray, first: int, last: int) -> None:
    for i in range(first, last):
        total = np.uint64(0)
        for j in range(bits.shape[1]):
            total += np.uint64(bits[i, j]) * keys[j]
        out[i] = total


def census(x_mm: Float32, z_mm: Float32, limit_mm: float) -> tuple[int, int]:
    """(points that came back, entries of x and z beyond `limit_mm`, infinite ones too) in a block (N, M).

    One pass over integers: meant for a block that is still in the cache.
    """
    limit = np.float32(limit_mm).view(np.int32)  # magnitudes of floats order as their bits do
    finite, beyond = _census(_bits(x_mm), _bits(z_mm), limit)
    return int(finite), int(beyond)


@kernel
def _census(x_bits: AnyArray, z_bits: AnyArray, limit: np.int32) -> tuple[int, int]:
    finite = beyond = 0
    for i in range(len(z_bits)):
        x, z = x_bits[min(i, len(x_bits) - 1)], z_bits[i]
        for j in range(z.size):
            u, w = x[j] & _MAGNITUDE, z[j] & _MAGNITUDE
            finite += (u < _EXPONENT) & (w < _EXPONENT)
            beyond += ((u > limit) & (u <= _EXPONENT)) + ((w > limit) & (w <= _EXPONENT))
    return finite, beyond


def unshuffle(shuffled: AnyArray, out: Float32) -> None:
    """Undo HDF5's shuffle: `shuffled` holds the first byte of every value, then the second of every value, and so on.

    Args:
        shuffled: (4 n,) uint8, little-endian float32.
        out: at most n values, contiguous; written to.
    """
    _unshuffle(as_input(shuffled.reshape(4, -1)), out.view(np.uint32).reshape(-1))


@kernel
def _unshuffle(planes: AnyArray, out: AnyArray) -> None:
    first, second, third, fourth = planes[0], planes[1], planes[2], planes[3]
    for i in range(out.size):
        low = np.uint32(first[i]) | np.uint32(second[i]) << np.uint32(8)
        out[i] = low | np.uint32(third[i]) << np.uint32(16) | np.uint32(fourth[i]) << np.uint32(24)


def columns_to_next(z_mm: AnyArray, outwards: Shaped[Int, " N"]) -> Int:
    """How many columns beyond the last return of a face the next one lies that measures anything (N,); mostly 1.

    A few neighbouring columns of a grid (N, M) in which no frame has a return, between others that do, are blind (dirt
    on a window, pixels that are masked): they tell nothing of where a face ends.

    Args:
        z_mm: NaN where nothing came back; with strays, among which the few returns beyond blind columns may be counted.
        outwards: (N,) column of the face's last return; negative: the face ends towards column 0.

    Example:
        >>> z = np.ones((30, 9))
        >>> z[:, 4:6] = np.nan
        >>> columns_to_next(z, np.array([2, 3, -6, 8])).tolist()
        [1, 3, 3, 1]
    """
    up, down = _steps_to_next(telling_returns(z_mm))
    return np.asarray(np.where(outwards > 0, up[np.abs(outwards)], down[np.abs(outwards)]))


def columns_beyond(z_mm: AnyArray, outwards: Shaped[Int, " N"]) -> Int:
    """How many columns beyond the last return of a face each frame's own next return lies (N,); M: there is none.

    Args:
        z_mm: grid (N, M), NaN where nothing came back.
        outwards: (N,) column of the face's last return; negative: the face ends towards column 0.

    Example:
        >>> z = np.array([[1.0, 1.0, np.nan, 9.0], [1.0, 1.0, np.nan, np.nan]])
        >>> columns_beyond(z, np.array([1, 1])).tolist()
        [2, 4]
    """
    out = np.full(len(z_mm), z_mm.shape[1])
    _beyond(as_input(z_mm), as_input(outwards), out)
    return out


@kernel
def _beyond(z: Float32, outwards: Int, out: Int) -> None:
    for i in range(out.size):
        way, last = (1 if outwards[i] > 0 else -1), abs(outwards[i])
        for away in range(1, z.shape[1] - last if way > 0 else last + 1):
            if np.isfinite(z[i, last + way * away]):
                out[i] = away
                break


def telling_returns(z_mm: AnyArray) -> Bool:
    """What returned (n, M) in up to `TELLING` frames of a grid (N, M): fewer pass a seldom lit column as blind."""
    return np.asarray(np.isfinite(_telling(z_mm)))


def _telling(grid: AnyArray) -> AnyArray:
    return np.asarray(grid[:: max(-(-len(grid) // TELLING), 1)])


def least_live(frames: int) -> int:
    """Returns of a column that is not blind, of so many frames: of a few, half."""
    return min(LIVE_RETURNS, -(-frames // 2))


def dark_beyond(z_mm: AnyArray, keep: Bool, outwards: Shaped[Int, " N"]) -> Bool:
    """Frames (N,) in which the column `columns_to_next` beyond a face hardly ever measures what is kept, or is none."""
    dark = np.pad(_telling(keep).sum(axis=0) < least_live(len(keep)), 1, constant_values=True)
    further = np.where(outwards > 0, 1, -1) * columns_to_next(z_mm, outwards)
    return np.asarray(dark[np.abs(outwards) + further + 1])


def blind_columns(keep: Bool) -> int:
    """How many columns of a grid (N, M) are blind: see `columns_to_next`."""
    return int((_steps_to_next(keep)[0] - 1).sum())


def widest_blind(keep: Bool) -> int:
    """How many neighbouring columns of a grid (N, M) are blind at most: see `columns_to_next`."""
    return int(_steps_to_next(keep)[0].max()) - 1


def _steps_to_next(keep: Bool) -> tuple[Int, Int]:
    """From each column (M,) to the next that measures, with rising and with falling column.

    Blind columns begin and end at once; a shadow beside a face's end moves with it, and is none.
    """
    count, live = keep.sum(axis=0), least_live(len(keep))
    up, down = np.ones((2, count.size), np.int64)
    for out, seen, times in ((up, keep, count), (down[::-1], keep[:, ::-1], count[::-1])):
        for j in np.flatnonzero((times[:-1] >= live) & (times[1:] == 0)).tolist():
            after = j + 1 + np.flatnonzero(times[j + 1 : j + MOST_BLIND + 2] >= live)
            if len(after) and not _fades(seen, j, j - 1) and not _fades(seen, int(after[0]), int(after[0]) + 1):
                out[j] = after[0] - j
    return up, down


def _fades(keep: Bool, j: int, neighbour: int) -> bool:
    """Whether column j returns more seldom than the one beside it: by more than losses do, which are either's."""
    if not 0 <= neighbour < keep.shape[1]:
        return False
    more, less = (keep[:, neighbour] & ~keep[:, j]).sum(), (keep[:, j] & ~keep[:, neighbour]).sum()
    return bool(more - less > max(SELDOM * keep[:, neighbour].sum(), 2.0 * math.sqrt(more + less)))
