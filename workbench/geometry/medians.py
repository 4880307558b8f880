"""Medians of few values, compiled: numpy's takes longer to be called than to find one."""

from __future__ import annotations

import numpy as np

from workbench.geometry.blocks import as_input
from workbench.kernels import kernel
from workbench.units import TO_SD, AnyArray, Float, Int


def median(values: AnyArray) -> float:
    """The median of values (n,) without NaN, n at least 1; of an even number the mean of the middle two."""
    return float(_median(as_input(np.asarray(values, dtype=np.float64))))


def robust_sd(left: AnyArray) -> float:
    """Standard deviation (n, at least 1) of what scatters about 0, by the median of its sizes: strays do not count."""
    return TO_SD * median(np.abs(left))


def medians(values: Float, edges: Int) -> Float:
    """The median (r,) of each run of values (n,) between edges (r + 1,); NaN of an empty one."""
    out = np.empty(edges.size - 1)
    _medians(as_input(values), as_input(edges), out)
    return out


def row_medians(values: Float) -> Float:
    """The median (n,) of each row of values (n, m) less its NaN; NaN of a row that has nothing else."""
    out = np.empty(len(values))
    _row_medians(as_input(values), out)
    return out


@kernel
def _row_medians(values: Float, out: Float) -> None:
    known = np.empty(values.shape[1])
    for i in range(values.shape[0]):
        count = 0
        for j in range(values.shape[1]):
            if not np.isnan(values[i, j]):
                known[count] = values[i, j]
                count += 1
        out[i] = median_of(known, count) if count else np.nan


@kernel
def _medians(values: Float, edges: Int, out: Float) -> None:
    for k in range(out.size):
        size = edges[k + 1] - edges[k]
        out[k] = median_of(values[edges[k] : edges[k + 1]].copy(), size) if size else np.nan


@kernel
def _median(values: Float) -> float:
    return median_of(values.copy(), values.size)


@kernel
def median_of(work: Float, size: int) -> float:
    """The median of the first `size` values of `work`, which are put in another order."""
    middle = select(work, size, size // 2)
    if size % 2:
        return middle
    below = work[0]
    for i in range(1, size // 2):
        below = max(below, work[i])
    return float(0.5 * (below + middle))


@kernel
def select(work: Float, size: int, k: int) -> float:
    """The value that k of the first `size` of `work` do not exceed; none before it is greater then.

    By partition without branches (Lomuto's): which way a value goes is chance, and a processor that guesses waits.
    """
    first, last = 0, size - 1
    while first < last:
        low, middle, high = work[first], work[(first + last) // 2], work[last]
        pivot = max(min(low, middle), min(max(low, middle), high))
        beyond = first  # of those that are not greater
        for i in range(first, last + 1):
            one = work[i]
            work[i], work[beyond] = work[beyond], one
            beyond += one <= pivot
        if k >= beyond:
            first = max(beyond, first + 1)  # where NaN has come in, no value compares
        elif 8 * (beyond - first) < 7 * (last - first):
            last = beyond - 1
        else:  # most are alike, or the pivot is the greatest
            equal = first
            for i in range(first, beyond):
                one = work[i]
                work[i], work[equal] = work[equal], one
                equal += one < pivot
            if k >= equal:
                return float(pivot)
            last = equal - 1
    return float(work[k])
