"""Freeing the ends of a face, frame by frame, of noise that neighbouring frames do not share."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from workbench.geometry.course import fit_course
from workbench.units import Float, Int, Shaped

LEAST_FRAMES = 30  # of a pass: fewer do not tell noise from vibration
LIMIT_SIGMAS = 1.5  # room for noise at a column's limits where frames share it
ALIKE = 15.0  # frames at most that count as one: returns are lost in each by itself
BLOCKS = 60  # of a pass, by whose middle columns it is told whether the end passes from column to column
PASSED = 5.0  # odds, for each column passed, that the columns moved against a smooth end: noise to a column's step


@dataclass(frozen=True, slots=True, eq=False)
class SettledEnds:
    """The last return in each of n frames, freed of noise that neighbouring frames do not share."""

    low: Shaped[Float, " n"]  # mm
    step: Shaped[Float, " n"]  # mm
    sigma: Shaped[Float, " n"]  # what remains of the noise, mm
    weight: Shaped[Float, " n"]  # what the frame counts
    doubt: Shaped[Float, " n"]  # probability that the end waves with `low`, and the columns stand still against it


def settled(s: Float, low: Float, step: Float, sigma: Float, column: Int, group: Int) -> SettledEnds:
    """Ends freed of noise that neighbouring frames do not share.

    Noise of the corner that `low` is counted from blurs the steps of the columns, and blurred steps feign knowledge of
    where between two columns the end lies. Frames at arc lengths s (n,), column (n,) of the last return counted
    outwards: low - column * step runs smoothly, but for noise and vibration; what the noise explains of its scatter
    about its course is taken off. What remains is shared by neighbours: while the end passes one limit of a column
    slowly, they say one thing, and it may lie on the limit in all of them; `low` and `step` then leave room for it.

    A `low` that waves while its column stays the same has two readings: the columns move against an even end, or the
    end waves and the columns stand still against it. Every column that is passed speaks for the first.
    """
    low, step, sigma, weight = low.copy(), step.copy(), sigma.copy(), np.ones(low.size)
    doubt = np.zeros(low.size)
    for g in np.unique(group):
        mine = np.flatnonzero((group == g) & np.isfinite(low) & np.isfinite(s) & np.isfinite(sigma) & (step > 0))
        if mine.size < LEAST_FRAMES:
            continue
        moved = low[mine] - (column[mine] - np.median(column[mine])) * np.median(step[mine])
        course = fit_course(s[mine], moved, sigma[mine] ** 2)
        rough = moved - course.value(s[mine])
        spread = float(np.median(np.abs(rough)) / 0.6745) ** 2
        noise = float(np.median(sigma[mine]) ** 2)
        share = min(1.0, noise / max(spread, 1e-12))
        low[mine] -= share * np.clip(rough, -3.0 * sigma[mine], 3.0 * sigma[mine])
        shared = course.u(s[mine])
        sigma[mine] = np.minimum(np.hypot(math.sqrt(1.0 - share) * sigma[mine], shared), sigma[mine])
        drift = np.abs(course.slope(s[mine])) * max(float(np.ptp(s[mine])) / mine.size, 1e-9)  # from frame to frame
        alike = np.clip(2.0 * shared / np.maximum(drift, 1e-9), 1.0, ALIKE)
        weight[mine] = 1.0 / (1.0 + share**2 * (alike - 1.0))
        room = LIMIT_SIGMAS * sigma[mine] * (1.0 - weight[mine])
        low[mine] -= room
        step[mine] += 2.0 * room
        doubt[mine] = 1.0 / (1.0 + PASSED ** _passed(column[mine]))
    return SettledEnds(low, step, sigma, weight, doubt)


def _passed(column: Int) -> int:
    """How many columns the end passes along a pass; single lost returns are none."""
    block = np.arange(column.size) * BLOCKS // column.size
    middle = [np.median(column[block == b]).round() for b in np.unique(block)]
    return np.unique(middle).size - 1
