"""Frames and what they show in their order along an edge: pass by pass, by their places, in windows about stations."""

from __future__ import annotations

import numpy as np

from workbench.geometry.medians import median
from workbench.units import AnyArray, Bool, Float, Int

LEAST_MEDIAN = 3  # frames


def by_pass(pass_index: AnyArray, on: Bool | None = None) -> list[Int]:
    """The frames of each pass (N,), in their order: those that are `on` (N,), of passes that have one.

    Example:
        >>> [one.tolist() for one in by_pass(np.array([1, 0, 1, 2]), np.array([True, True, True, False]))]
        [[1], [0, 2]]
    """
    frames = np.arange(len(pass_index)) if on is None else np.flatnonzero(on)
    return [frames[pass_index[frames] == number] for number in np.unique(pass_index[frames])]


def in_order(s: Float, *values: Float) -> Int:
    """The frames in the order of their places s (N,), those that have a place and all values, (N,) each; NaN: none.

    Example:
        >>> in_order(np.array([3.0, np.nan, 1.0, 2.0]), np.array([0.0, 0.0, 0.0, np.nan])).tolist()
        [2, 0]
    """
    on = np.flatnonzero(np.isfinite(sum(values, s)))
    return on[np.argsort(s[on], kind="stable")]


def near(s: Float, at: Float, reach_mm: float) -> tuple[Int, Int]:
    """The first of rising places s (n,) within reach of each station (m,), and the one after the last, (m,) each.

    Example:
        >>> [one.tolist() for one in near(np.arange(5.0), np.array([0.0, 2.5]), 1.0)]
        [[0, 2], [2, 4]]
    """
    return np.searchsorted(s, at - reach_mm), np.searchsorted(s, at + reach_mm, side="right")


def between(s: Float, value: Float, at: Float) -> Float:
    """Values (N,) of frames at s (N,) mm at places (k,) between them; NaN is left out, without any it is 0."""
    on = in_order(s, value)
    return np.interp(at, s[on], value[on]) if on.size else np.zeros(np.shape(at))


def running_median(s: Float, value: Float, at: Float, reach_mm: float) -> Float:
    """Median of values (N,) at s (N,) within reach of stations (m,); between them where there are none.

    Example:
        >>> place = np.arange(9.0)
        >>> running_median(place, np.where(place == 4.0, 9.0, 1.0), np.array([4.0]), 2.0).tolist()
        [1.0]
    """
    on = in_order(s, value)
    first, last = near(s[on], at, reach_mm)
    some = np.flatnonzero(last - first >= min(LEAST_MEDIAN, on.size))
    if not some.size:  # so few frames so far apart: each stands for itself
        return between(s, value, at)
    ordered = value[on]
    middle = [median(ordered[first[k] : last[k]]) for k in some]
    return np.interp(at, at[some], middle)
