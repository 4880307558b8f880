"""Outliers of an organised scan, told from its grid: neighbours are the columns and frames next door."""

from __future__ import annotations

from functools import partial

import numpy as np

from workbench.geometry.blocks import as_input, over_blocks
from workbench.kernels import kernel
from workbench.units import Bool, Float32, Int, Shaped

REACH_COLUMNS = 4  # a neighbour may be this many columns away: returns go missing
SHORT_RUN = 4  # a run of fewer returns than this, far from both neighbours, is no surface
WORD = 8  # flags that are looked at together
GAP_COLUMNS, LINE_COLUMNS = 24, 8  # unless it goes on with a surface's line beyond columns that measure nothing


def reject_outliers(
    z_mm: Shaped[Float32, "N M"],
    keep: Shaped[Bool, "N M"],
    pass_index: Shaped[Int, " N"],
    tolerance_mm: float,
    window_frames: int,
    jump_mm: float,
) -> tuple[Bool, int, int]:
    """What remains of `keep` (N, M) without isolated returns and short streaks, and how many there were of each.

    Isolated is a return that neither its own profile nor the frames next door support. A streak is a run of fewer than
    SHORT_RUN of the others that stands off its neighbours by jumps in range, or by more than REACH_COLUMNS columns and
    does not continue their line.

    Args:
        z_mm: (N, M) range.
        keep: (N, M) where something came back.
        pass_index: (N,) frames are next door within a pass only.
        tolerance_mm: how far off the line of its neighbours a good return may lie.
        window_frames: frames compared with each other, half of them on each side.
        jump_mm: range step a column above which a surface ends.
    """
    left = np.empty(keep.shape, np.bool_)
    grid = (as_input(z_mm), as_input(keep), as_input(pass_index))
    work = partial(_reject, *grid, float(tolerance_mm), window_frames // 2, float(jump_mm), left)
    counts = over_blocks(work, keep.shape)
    return left, sum(isolated for isolated, _ in counts), sum(streaks for _, streaks in counts)


@kernel(error_model="numpy")
def _reject(
    z: Float32,
    keep: Bool,
    pass_index: Int,
    tolerance: float,
    reach: int,
    jump: float,
    left: Bool,
    first: int,
    last: int,
) -> tuple[int, int]:
    """Frames first to last - 1 of `reject_outliers`, in one pass; the counts of both kinds."""
    isolated = streaks = 0
    width = -(-z.shape[1] // WORD) * WORD
    doubtful, begins, at = np.zeros(width, np.bool_), np.zeros(width, np.bool_), np.empty(width, np.int64)
    for i in range(first, last):
        _doubt(z[i], keep[i], np.float32(0.995 * tolerance), doubtful)
        for j in range(z.shape[1]):
            left[i, j] = keep[i, j]
        for k in range(_set_ones(doubtful, at)):
            j = at[k]
            if not (_supported(z[i], keep[i], j, tolerance) or _steady(z, keep, pass_index, i, j, reach, tolerance)):
                left[i, j] = False
                isolated += 1
        streaks += _drop_short_runs(z[i], left[i], tolerance, jump, begins, at)
    return isolated, streaks


@kernel
def _set_ones(flags: Bool, at: Int) -> int:
    """Fill in the numbers of the flags that are set, and how many: few are, so that words of them are looked at."""
    words, count = flags.view(np.uint64), 0
    for w in range(words.size):
        if words[w] != 0:
            for j in range(w * WORD, (w + 1) * WORD):
                at[count] = j
                count += flags[j]
    return count


@kernel
def _doubt(z: Float32, keep: Bool, tolerance: np.float32, doubtful: Bool) -> None:
    """Mark the kept points of a profile that do not obviously lie on the line of two columns next to them.

    No branch: nearly all points are settled here, many at a time. A second difference must stay below `tolerance`, or
    twice that about the middle; it is the least bit less than what `_supported` allows, for float32 rounds.
    """
    for j in range(z.size):
        doubtful[j] = keep[j]
    if z.size < 5:
        return
    far, near, here, near_on, far_on = z[:-4], z[1:-3], z[2:-2], z[3:-1], z[4:]
    had_far, had, has, had_on, had_far_on = keep[:-4], keep[1:-3], keep[2:-2], keep[3:-1], keep[4:]
    out, twice = doubtful[2:], np.float32(2.0) * tolerance
    for j in range(here.size):
        before, after = here[j] - near[j], near_on[j] - here[j]
        between = had[j] & had_on[j] & (abs(after - before) < twice)
        goes_on = had_far[j] & had[j] & (abs(before - (near[j] - far[j])) < tolerance)
        begins = had_on[j] & had_far_on[j] & (abs(after - (far_on[j] - near_on[j])) < tolerance)
        out[j] = has[j] & ~(between | goes_on | begins)


@kernel
def _next(keep: Bool, j: int, step: int, start: int) -> int:
    """Columns from j to the first kept one more than `start` away; 0: none within reach."""
    for d in range(start + 1, REACH_COLUMNS + 1):
        k = j + d * step
        if k < 0 or k >= keep.size:
            return 0
        if keep[k]:
            return d
    return 0


@kernel
def _supported(z: Float32, keep: Bool, j: int, tolerance: float) -> bool:
    """Does point j of a profile continue the line of two neighbours on one side, or lie between one on each?"""
    near_left, near_right = _next(keep, j, -1, 0), _next(keep, j, 1, 0)
    here = np.float64(z[j])
    if near_left and near_right:
        a, b = np.float64(z[j - near_left]), np.float64(z[j + near_right])
        if abs(here - a - (b - a) * near_left / (near_left + near_right)) < tolerance:
            return True
    for step, near in ((-1, near_left), (1, near_right)):
        far = _next(keep, j, step, near) if near else 0
        if far:
            a, b = np.float64(z[j + step * near]), np.float64(z[j + step * far])
            if abs(here - a + (b - a) * near / (far - near)) < tolerance:
                return True
    return False


@kernel
def _steady(z: Float32, keep: Bool, pass_index: Int, i: int, j: int, reach: int, tolerance: float) -> bool:
    """Does point (i, j) lie between its neighbours in the frames before and after, or next to either?"""
    for d in range(1, reach + 1):
        before = i - d >= 0 and pass_index[i - d] == pass_index[i] and keep[i - d, j]
        after = i + d < z.shape[0] and pass_index[i + d] == pass_index[i] and keep[i + d, j]
        if before and abs(np.float64(z[i, j]) - z[i - d, j]) < tolerance:
            return True
        if after and abs(np.float64(z[i, j]) - z[i + d, j]) < tolerance:
            return True
        if before and after and abs(z[i, j] - 0.5 * (np.float64(z[i - d, j]) + z[i + d, j])) < tolerance:
            return True
    return False


@kernel
def _drop_short_runs(z: Float32, keep: Bool, tolerance: float, jump: float, begins: Bool, at: Int) -> int:
    """Take runs of fewer than SHORT_RUN points that stand off their neighbours out of a profile; how many points.

    No branch in the first loop: nearly all points go on from the column before. begins, at: room to work in.
    """
    before, here, had, has, out = z[:-1], z[1:], keep[:-1], keep[1:], begins[1:]
    for j in range(here.size):
        out[j] = has[j] & ~(had[j] & (abs(here[j] - before[j]) < jump))
    begins[0] = keep[0]
    start, dropped = -1, 0
    for k in range(_set_ones(begins, at)):
        j = at[k]
        last = j - 1
        while last >= 0 and j - last <= GAP_COLUMNS and not keep[last]:
            last -= 1
        gap = j - last if start >= 0 else GAP_COLUMNS + 1
        goes_on = gap <= REACH_COLUMNS and abs(z[j] - z[last]) < jump * gap
        if REACH_COLUMNS < gap <= GAP_COLUMNS:
            goes_on = _on_line(z, keep, j, last, -1, tolerance) or _on_line(z, keep, last, j, 1, tolerance)
        if not goes_on:
            dropped += _drop_if_short(keep, start, j)
            start = j
    return dropped + _drop_if_short(keep, start, z.size)


@kernel
def _on_line(z: Float32, keep: Bool, j: int, end: int, way: int, tolerance: float) -> bool:
    """Does point j lie on the line of the surface that ends at column `end` and reaches from there along `way`?"""
    far = end
    for d in range(1, LINE_COLUMNS + 1):
        if 0 <= end + d * way < z.size and keep[end + d * way]:
            far = end + d * way
    if abs(far - end) < LINE_COLUMNS // 2:
        return False
    ahead = (j - end) / (end - far)
    off = np.float64(z[j]) - z[end] - (np.float64(z[end]) - z[far]) * ahead
    return bool(abs(off) < tolerance * (1.0 + abs(ahead)))


@kernel
def _drop_if_short(keep: Bool, start: int, end: int) -> int:
    """Take the run of points from column start to end - 1 out if it has fewer than SHORT_RUN; how many it had then."""
    size, j = 0, max(start, 0)
    while start >= 0 and j < end and size < SHORT_RUN:
        size += keep[j]
        j += 1
    if size == SHORT_RUN:
        return 0
    for k in range(max(start, 0), j):
        keep[k] = False
    return size
