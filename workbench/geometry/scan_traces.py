"""The traces that scan lines leave on a flat patch of a face, in points of any order: of one pass, or of several.

A line's points lie in the laser's plane whatever its noise, so that on a patch the lines of a pass are straight,
parallel and evenly spaced. Seen along them, the points of that pass stand on a comb, those of any other pass do not.
"""

from __future__ import annotations

from typing import Literal

import numpy as np

from workbench.units import Bool, Float

TANGENTS = np.arange(-0.36, 0.3601, 0.004)  # directions of lines that are tried, against square to the edge
HALF_WIDTH_MM = 0.004  # of a line, seen along it
LEAST_ON_LINE = 6  # other points
ALONE, FURTHER = 0.4, 0.12  # share of points on the comb of an only pass, at the least; on that of a further one
LEAST_LINES, FULL = 5, 0.4  # of a patch; points that a line has, in parts of a usual one's
UNEVEN = 0.3  # half the range of the middle half of steps between lines, in parts of the median: two combs in one

Traces = Literal["none", "one pass", "several passes"]


def traces(x_mm: Float, s_mm: Float) -> Traces:
    """Which lines the points (n,) of a patch of about a millimetre show; x across the edge and s along it, in the face.

    "none": the points do not stand on lines, as after thinning; nothing can then be said.
    """
    first, tangent = _comb(x_mm, s_mm)
    rest = ~first
    second = _comb(x_mm[rest], s_mm[rest])[0].sum() if rest.any() else 0
    if second >= FURTHER * x_mm.size:
        return "several passes"
    if first.mean() < ALONE:
        return "none"
    return "several passes" if _uneven(s_mm - tangent * x_mm) else "one pass"


def _comb(x: Float, s: Float) -> tuple[Bool, float]:
    """Points (n,) that stand on lines of the direction in which most do, and its tangent."""
    best, at = np.zeros(x.size, bool), 0.0
    for tangent in TANGENTS:
        u = s - tangent * x
        ordered = np.sort(u)
        near = np.searchsorted(ordered, u + HALF_WIDTH_MM) - np.searchsorted(ordered, u - HALF_WIDTH_MM)
        on = near > LEAST_ON_LINE
        if on.sum() > best.sum():
            best, at = on, float(tangent)
    return best, at


def _uneven(u: Float) -> bool:
    """Whether lines, seen along them (n points), are not evenly spaced."""
    u = np.sort(u)
    line = np.cumsum(np.diff(u, prepend=u[0]) > HALF_WIDTH_MM)
    points = np.bincount(line)
    place = (np.bincount(line, u) / points)[points >= FULL * np.median(points[line])]
    if place.size < LEAST_LINES:
        return False
    low, middle, high = np.quantile(np.diff(place), [0.25, 0.5, 0.75])
    return bool(0.5 * (high - low) > UNEVEN * middle)
