"""Removing what a moving cutter sweeps from lines (dexels) normal to the bevel: one compiled kernel.

The cutter stands still at steps along its path; each line is cut exactly, where it enters the cylinder or the half
sphere at its end. Between two
steps, `step` apart, a ridge of at most step^2 / (8 radius) stays: 0.25 micrometres at 0.1 mm and a radius of 5 mm.
(Dexels: T. Van Hook, Real-time shaded NC milling display, SIGGRAPH 1986, 15.)
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from workbench.kernels import kernel
from workbench.units import Float, Int, Shaped

_ALMOST_PARALLEL = 1e-12
_ALONG = 0.1  # an axis that leans more than this out of the plane is not looked at twice


class Lines(NamedTuple):
    """The lines: (U, W) of them start at base + w across and run along up, in the part's frame; mm."""

    base: Shaped[Float, "U 3"]
    across: Shaped[Float, "U 3"]  # unit, up the bevel's plane
    up: Shaped[Float, "U 3"]  # unit, the plane's outward normal
    w_first: float
    w_step: float
    floor: Shaped[Float, "U W"]  # height at which a line leaves the part below


class Sweep(NamedTuple):
    """A motion of the cutter through k poses, in the part's frame; between two of them it is linear."""

    tip_frame: Shaped[Float, "k 3"]  # the frame's origin
    x: Shaped[Float, "k 3"]  # unit, into the material: the axis runs `axis_offset` behind
    z: Shaped[Float, "k 3"]  # unit, along the axis, from shank to tip
    radius: Shaped[Float, " k"]
    axis_offset: float
    tip: float  # how far the cylinder reaches beyond the frame's origin, along z; the shank has no end
    ball: bool  # there a half sphere of the same radius goes on; else it is flat
    first: Int  # (k-1,) columns of lines that each piece of the motion can reach: first, and
    last: Int  # (k-1,) the one after the last


@kernel
def _cut_column(
    height: Float, lines: Lines, column: int, c: Float, a: Float, radius: float, tip: float, ball: bool
) -> None:
    """Cut one column's lines by the cylinder of axis c + s a, s <= tip, and by the ball at its end."""
    ba, aa, bq, qa, q_aside, qq = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for k in range(3):
        up, across, q = lines.up[column, k], lines.across[column, k], lines.base[column, k] - c[k]
        ba += up * a[k]
        aa += across * a[k]
        bq += up * q
        qa += q * a[k]
        q_aside += q * across
        qq += q * q
    bb = 1.0 - ba * ba  # squared length of the line's direction across the axis
    inner = qq - qa * qa - radius * radius
    for row in range(height.shape[1]):
        w = lines.w_first + row * lines.w_step
        along = (bq - qa * ba) - w * aa * ba
        outside = inner + 2.0 * w * (q_aside - qa * aa) + w * w * (1.0 - aa * aa)
        below, above = -math.inf, math.inf
        if bb > _ALMOST_PARALLEL:
            reach = along * along - bb * outside
            if reach <= 0.0:
                continue  # nor does it meet the ball, which the cylinder's sides enclose
            root = math.sqrt(reach)
            below, above = (-along - root) / bb, (-along + root) / bb
        elif outside >= 0.0:
            continue
        beyond = qa + w * aa - tip  # of the line's foot, beyond the tip
        if abs(ba) > _ALMOST_PARALLEL:
            if ba > 0.0:
                above = min(above, -beyond / ba)
            else:
                below = max(below, -beyond / ba)
        elif beyond > 0.0:
            above = -math.inf
        if ball:  # |line - (c + tip a)| = radius
            middle = bq - tip * ba
            square = middle * middle - outside - beyond * beyond
            if square > 0.0:
                root = math.sqrt(square)
                below = min(below, -middle - root) if below < above else -middle - root
                above = max(above, -middle + root)
        if below < above and below < height[column, row] and above > lines.floor[column, row]:
            height[column, row] = max(below, lines.floor[column, row])


@kernel
def _passes_above(lines: Lines, rows: int, column: int, c: Float, a: Float, radius: float, highest: float) -> bool:
    """Whether the cylinder surely stays above `highest` on all lines of a column: then nothing is to be cut.

    Where it is `aside` from the column's plane, it reaches down sqrt(radius^2 - aside^2) from its axis at most.
    """
    up, across, forward, height, w, aside = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for k in range(3):
        n, m = (k + 1) % 3, (k + 2) % 3
        tangent = lines.up[column, n] * lines.across[column, m] - lines.up[column, m] * lines.across[column, n]
        q = c[k] - lines.base[column, k]
        up += lines.up[column, k] * a[k]
        across += lines.across[column, k] * a[k]
        forward += tangent * a[k]
        height += lines.up[column, k] * q
        w += lines.across[column, k] * q
        aside += tangent * q
    if abs(across) < _ALONG:
        return False
    low = (lines.w_first - radius - w) / across  # the stretch of the axis that can come near these lines
    high = (lines.w_first + (rows - 1) * lines.w_step + radius - w) / across
    nearest = min(abs(aside + low * forward), abs(aside + high * forward))
    if (aside + low * forward) * (aside + high * forward) < 0.0:
        nearest = 0.0
    down = math.sqrt(max(radius * radius - nearest * nearest, 0.0))
    return nearest >= radius or height + min(low * up, high * up) - down >= highest


@kernel
def _highest(heights: Float) -> float:
    best = -math.inf
    for value in heights:
        best = max(best, value)
    return best


@kernel
def cut_lines(height: Float, lines: Lines, sweep: Sweep, step: float) -> None:
    """Lower `height` (U, W) to what the sweep leaves, in place; the cutter is set down every `step` mm or closer."""
    c, a, x, rows = np.empty(3), np.empty(3), np.empty(3), height.shape[1]
    highest = np.array([_highest(column) for column in height])
    for i in range(len(sweep.first)):
        if sweep.last[i] <= sweep.first[i]:
            continue
        way, turn = 0.0, 0.0
        for k in range(3):
            way += (sweep.tip_frame[i + 1, k] - sweep.tip_frame[i, k]) ** 2
            turn += (sweep.x[i + 1, k] - sweep.x[i, k]) ** 2 + (sweep.z[i + 1, k] - sweep.z[i, k]) ** 2
        reach = sweep.axis_offset + rows * lines.w_step
        pieces = max(1, math.ceil((math.sqrt(way) + reach * math.sqrt(turn)) / step))
        for piece in range(pieces + 1):
            f = piece / pieces
            a_length, x_length = 0.0, 0.0
            for k in range(3):
                a[k] = (1.0 - f) * sweep.z[i, k] + f * sweep.z[i + 1, k]
                x[k] = (1.0 - f) * sweep.x[i, k] + f * sweep.x[i + 1, k]
                a_length += a[k] * a[k]
                x_length += x[k] * x[k]
            for k in range(3):
                origin = (1.0 - f) * sweep.tip_frame[i, k] + f * sweep.tip_frame[i + 1, k]
                a[k] /= math.sqrt(a_length)
                c[k] = origin - sweep.axis_offset * x[k] / math.sqrt(x_length)
            radius = (1.0 - f) * sweep.radius[i] + f * sweep.radius[i + 1]
            for column in range(sweep.first[i], sweep.last[i]):
                if not _passes_above(lines, rows, column, c, a, radius, highest[column]):
                    _cut_column(height, lines, column, c, a, radius, sweep.tip, sweep.ball)
                    highest[column] = _highest(height[column])
