"""Outliers of an organised scan, told from its grid: neighbours are the columns and frames next door."""

from __future__ import annotations

import numpy as np
from numba import njit, prange

from workbench.units import AnyArray, Bool, Float32

REACH_COLUMNS = 4  # a neighbour may be this many columns away: returns go missing
SHORT_RUN = 4  # a run of fewer returns than this, far from both neighbours, is no surface


@njit(cache=True, nogil=True)
def _supported(z: Float32, keep: Bool, j: int, tolerance: float) -> bool:
    """Does point j of a profile continue the line of two neighbours on one side, or lie between one on each?"""
    found = np.empty((2, 2))
    place = np.empty((2, 2))
    count = np.zeros(2, np.int64)
    for side in range(2):
        step = 1 if side else -1
        for d in range(1, REACH_COLUMNS + 1):
            k = j + d * step
            if k < 0 or k >= z.size or count[side] == 2:
                break
            if keep[k]:
                found[side, count[side]], place[side, count[side]] = z[k], d * step
                count[side] += 1
    for side in range(2):
        if count[side] == 2:
            slope = (found[side, 1] - found[side, 0]) / (place[side, 1] - place[side, 0])
            if abs(z[j] - found[side, 0] + slope * place[side, 0]) < tolerance:
                return True
    if count[0] and count[1]:
        slope = (found[1, 0] - found[0, 0]) / (place[1, 0] - place[0, 0])
        if abs(z[j] - found[0, 0] + slope * place[0, 0]) < tolerance:
            return True
    return False


@njit(cache=True, nogil=True)
def _beside(z: Float32, keep: Bool, i: int, j: int, window: int, tolerance: float) -> bool:
    """Does point (i, j) lie between its neighbours in the frames before and after, or next to either?"""
    for d in range(1, window + 1):
        before, after = i - d >= 0 and keep[i - d, j], i + d < z.shape[0] and keep[i + d, j]
        if before and after and abs(z[i, j] - 0.5 * (z[i - d, j] + z[i + d, j])) < tolerance:
            return True
        if (before and abs(z[i, j] - z[i - d, j]) < tolerance) or (after and abs(z[i, j] - z[i + d, j]) < tolerance):
            return True
    return False


@njit(cache=True, nogil=True, parallel=True)
def isolated(z: Float32, keep: Bool, tolerance_mm: float, window_frames: int, out: Bool) -> None:
    """Mark in `out` (N, M) the kept points that neither their own profile nor the frames next door support.

    z (N, M) mm; tolerance_mm: how far off the line of its neighbours a good point may lie.
    """
    reach = window_frames // 2
    quick = 0.5 * tolerance_mm
    for i in prange(z.shape[0]):
        for j in range(z.shape[1]):
            if not keep[i, j]:
                continue
            if 0 < j < z.shape[1] - 1 and keep[i, j - 1] and keep[i, j + 1]:  # nearly all points end here
                if abs(z[i, j - 1] - 2.0 * z[i, j] + z[i, j + 1]) < quick:
                    continue
            if _supported(z[i], keep[i], j, tolerance_mm):
                continue
            out[i, j] = not _beside(z, keep, i, j, reach, tolerance_mm)


@njit(cache=True, nogil=True, parallel=True)
def short_runs(z: Float32, keep: Bool, jump_mm: float, out: Bool) -> None:
    """Mark in `out` (N, M) runs of fewer than SHORT_RUN returns that stand off their neighbours by jumps in range."""
    for i in prange(z.shape[0]):
        start = -1  # first column of the run, last column of it so far, and its size
        last, size = -1, 0
        for j in range(z.shape[1] + 1):
            inside = j < z.shape[1] and keep[i, j]
            if not inside and j < z.shape[1]:
                continue
            joined = inside and start >= 0 and abs(z[i, j] - z[i, last]) < jump_mm * (j - last)
            if joined and j - last <= REACH_COLUMNS:
                last, size = j, size + 1
                continue
            if start >= 0 and size < SHORT_RUN:
                for k in range(start, last + 1):
                    if keep[i, k]:
                        out[i, k] = True
            start, last, size = j, j, 1


def points_marked(mask: AnyArray) -> int:
    """Number of True entries."""
    return int(np.count_nonzero(mask))
