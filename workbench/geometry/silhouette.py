"""Where a face ends along the edge, when each frame knows it only to the step between two columns.

A frame says that the end lies between its last return and the next column (the half-pixel rule), blurred by the
frame's own noise. Frames that cut the face at other phases of the column step share what they know; frames that all cut
it at the same phase know no more than one. Both follow from the likelihood of the frames in each short stretch of edge
(docs/method.md, eq. (8)), and from how much of it the stretches around say again (eq. (9)): what is left is given to
the one estimator, `geometry.course`, as a value with a variance (expectation propagation, eq. (10)).

Before that, the ends in neighbouring frames are freed of noise that these do not share.
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from workbench.geometry.along import by_pass, in_order, near
from workbench.geometry.blocks import as_input
from workbench.geometry.course import ALONE, BIN_MM, HIDDEN_MM, Course, fit_course
from workbench.geometry.fading import beyond_columns, returns_share
from workbench.geometry.medians import medians, robust_sd
from workbench.geometry.processes import Shared
from workbench.kernels import kernel
from workbench.units import Float, Int, Shaped

LEAST_FRAMES = 30  # of a pass: fewer do not tell noise from vibration
LIMIT_SIGMAS = 1.5  # room for noise at a column's limits where frames share it
ALIKE = 15.0  # frames at most that count as one: returns are lost in each by itself
BLOCKS = 60  # of a pass, by whose middle columns it is told whether the end passes from column to column
PASSED = 5.0  # odds, for each column passed, that the columns moved against a smooth end: noise to a column's step
STRAY = 0.01  # probability that a frame's last return tells nothing about the end
MISSES = 6  # columns of the face that may have gone without return at its end, beside those over which it fades
FADED = 0.25  # of what a fading end hides: u of that, since it need not fade evenly
LEAST_CELLS = 20  # of BIN_MM of edge, or parts of a short one
GRID = 161  # places of the end about the course
REACH_STEPS, REACH_SIGMAS = 1.5, 6.0  # half width of that grid
# Rounds: settled where one moves the course nowhere by this share of its u; from which on only part of a step is taken,
# since whole ones may swing; at most.
SETTLED_U, WHOLE_ROUNDS, PART_STEP, MOST_ROUNDS = 0.1, 3, 0.5, 12
UNSEEN_STEPS = 0.05  # of a column step, by which the end may wave unseen over HIDDEN_MM
# Frames that show the face beyond its told end: by how many columns and sigmas, how many at least.
FURTHER_STEPS, FURTHER_SIGMAS, FURTHER_SHARE, FURTHER_LEAST = 1.0, 4.0, 0.1, 3
LEAST_TOGETHER = 4  # cells that count as known together, however loose the course
NOTHING = 36.0  # logarithms below the greatest: a share below the digits of a number
FAR_SIGMAS, NORMAL = 7.0, 4097  # where no noise is left to tell of; values in a table


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
    for mine in by_pass(group, np.isfinite(low + s + sigma) & (step > 0)):
        if mine.size < LEAST_FRAMES:
            continue
        moved = low[mine] - (column[mine] - np.median(column[mine])) * np.median(step[mine])
        course = fit_course(s[mine], moved, sigma[mine] ** 2)
        rough = moved - course.value(s[mine])
        spread = robust_sd(rough) ** 2
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
    block = ((np.arange(column.size) + 0.5) * BLOCKS / column.size).astype(np.int64)
    middle = [np.median(column[block == b]).round() for b in np.unique(block)]
    return np.unique(middle).size - 1


class Ends(NamedTuple):
    """The last return on a face in each of n frames, counted from some place in the frame, mm."""

    s: Shaped[Float, " n"]  # arc length, rising
    low: Shaped[Float, " n"]  # the face reaches at least to here
    step: Shaped[Float, " n"]  # the next column lies this much further; 0: `low` is a measured corner
    sigma: Shaped[Float, " n"]  # noise of low
    missing: Shaped[Float, " n"]  # probability that a column of the face is without return
    fade: Shaped[Float, " n"]  # columns before the end over which returns become rare; below 0.5: none do
    weight: Shaped[Float, " n"]  # what the frame counts: below 1 where neighbours share their noise
    doubt: Shaped[Float, " n"]  # probability that the end waves with `low`, rather than the columns against it


@dataclass(frozen=True, slots=True, eq=False)
class EndCourse:
    """The end along the edge."""

    course: Course  # mm
    s: Shaped[Float, " c"]  # middle of each stretch of edge, mm
    middle: Shaped[Float, " c"]  # of the column steps there, whatever the course says, mm
    middle_u: Shaped[Float, " c"]  # what the step leaves open, mm


def find_end(
    ends: Ends,
    first: Course,
    shared: Shared = ALONE,
    orders: tuple[int, int] = (1, 2),
) -> EndCourse:
    """The end along the edge; first: a course through the middles of the column steps; the others: as `fit_course`."""
    length = max(float(ends.s[-1] - ends.s[0]), 1e-3)
    cells = max(math.ceil(length / BIN_MM), min(LEAST_CELLS, ends.s.size // 3), 1)
    cell = np.minimum((ends.s - ends.s[0]) / length * cells, cells - 1).astype(np.int64)
    _, cell = np.unique(cell, return_inverse=True)
    count = np.bincount(cell)
    place = np.bincount(cell, ends.s) / count
    silhouette = ends.step > 0
    sigma = float(np.median(ends.sigma)) + 1e-6
    step = float(np.median(ends.step[silhouette])) if silhouette.any() else 0.0
    beyond, scatter = (of * ends.step for of in beyond_columns(ends.fade))
    hidden = float(np.median(beyond))
    grid = np.linspace(-1.0, 1.0, GRID) * (REACH_STEPS * step + REACH_SIGMAS * sigma + hidden)
    unseen = UNSEEN_STEPS * step, HIDDEN_MM
    course, prior = first, np.full(place.size, math.hypot(step + hidden, 4.0 * sigma))
    about = course.value(place)
    said = np.bincount(cell, ends.sigma**2 + ends.step**2 / 12.0) / count**2 * first.noise_factor
    precision, weighted = np.zeros((2, place.size))  # of the sites together: 1/mm^2, and that times their values
    for number in range(MOST_ROUNDS):
        logs = np.zeros((place.size, GRID))
        low = ends.low - course.value(ends.s)
        _add_up(as_input(cell), Ends(*map(as_input, ends._replace(low=low))), _normal(), grid, logs)
        mean, variance = _sites(logs, grid, prior)
        together = said / course.u(place) ** 2
        said = variance * _overstated(logs, grid, variance, together)
        step_share = 1.0 if number < WHOLE_ROUNDS else PART_STEP
        precision = (1.0 - step_share) * precision + step_share / said
        weighted = (1.0 - step_share) * weighted + step_share * (about + mean) / said
        said = 1.0 / precision
        known = course.stiffness if shared.processes and number > 0 else None  # saves the search
        course = fit_course(place, weighted * said, said, None, orders, known, unseen, shared)
        before, about = about, course.value(place)
        if (np.abs(about - before) < SETTLED_U * course.u(place)).all():
            break
        prior = np.minimum(2.0 * course.u(place) + 0.5 * sigma, prior)
    else:
        still = np.interp(course.at_mm, place, (about - before) / PART_STEP)
        course = replace(course, variance=course.variance + still**2)
    first_of = np.searchsorted(cell, np.arange(place.size))  # frames are in order
    most = np.maximum.reduceat(ends.weight, first_of)
    counts = ends.weight > 0.5 * most[cell]  # a pass that does not see the end says nothing of where it is
    ends, cell, beyond, scatter = Ends(*(of[counts] for of in ends)), cell[counts], beyond[counts], scatter[counts]
    count = np.bincount(cell)
    middle = medians(ends.low + 0.5 * ends.step + beyond, np.searchsorted(cell, np.arange(place.size + 1)))
    by_columns = (np.bincount(cell, ends.step) / count) ** 2 / 12.0
    middle_u = np.sqrt(by_columns + np.bincount(cell, scatter**2) / count**2 + sigma**2)
    course = _doubted(course, place, ends, cell, beyond)
    return EndCourse(course, place, middle, middle_u)


def reached_mm(s: Float, low: Float, step: Float, sigma: Float, course: Course, at: Float) -> Float:
    """By how much frames near `at` (m,) show returns on the face beyond its told end, mm; 0 where too few do.

    Most frames may have lost the end of a face (an exposure that alternates): a face does not return where it is not.
    s, low, step, sigma (N,): of the frames, as those of `Ends`, NaN where a frame does not show it.
    """
    on = in_order(np.where(step > 0.0, s, np.nan), low)
    if not on.size:
        return np.zeros(at.size)
    place = s[on]
    over = low[on] - course.value(place)
    beyond = over > np.maximum(FURTHER_STEPS * step[on], 0.5 * step[on] + FURTHER_SIGMAS * sigma[on])
    first, last = near(place, at, 0.5 * HIDDEN_MM)
    count = np.concatenate([[0], np.cumsum(beyond)])
    out = np.zeros(at.size)
    for k in np.flatnonzero(count[last] - count[first] > np.maximum(FURTHER_SHARE * (last - first), FURTHER_LEAST)):
        out[k] = np.median(over[first[k] : last[k]][beyond[first[k] : last[k]]])
    return out


def _doubted(course: Course, place: Float, ends: Ends, cell: Int, beyond: Float) -> Course:
    """The course with what its reading leaves open: the end may lie in the middle of each cell's column step.

    beyond (n,): mm of the face by which a fading end lies beyond a frame's last return.
    """
    count = np.bincount(cell)
    apart = np.bincount(cell, ends.low + 0.5 * ends.step + beyond) / count - course.value(place)
    other = apart**2 + np.bincount(cell, ends.step**2) / count / 12.0
    doubt = np.interp(course.at_mm, place, np.bincount(cell, ends.doubt) / count)
    more = doubt * (np.interp(course.at_mm, place, other) - course.variance)
    hidden = np.bincount(cell, beyond) / count
    faded = (FADED * np.interp(course.at_mm, place, hidden)) ** 2
    return replace(course, variance=course.variance + np.maximum(more, 0.0) + faded)


def _sites(logs: Float, grid: Float, prior: Float) -> tuple[Float, Float]:
    """What each cell adds to a normal prior about 0 of standard deviation `prior` (c,): value and variance (c,)."""
    rows, nothing = np.concatenate([np.zeros((1, grid.size)), logs]), np.zeros(len(logs), np.int64)
    mean, variance = _moments(rows, nothing, np.arange(1, len(rows)), prior, grid)
    before = 1.0 / _moments(rows, nothing, nothing, prior, grid)[1]  # of the grid's finite width
    added = np.maximum(1.0 / variance - before, 1e-3 * before)
    return np.clip(mean / variance / added, grid[0], grid[-1]), 1.0 / added


def _overstated(logs: Float, grid: Float, variance: Float, together: Float) -> Float:
    """Factor (c,), at least 1, by which cells of these variances claim more together than they know (eq. (9)).

    Independent cells know what the sum of their weights says; cells at one phase of the columns know no more than one.
    The course averages over so many cells about each, `together` (c,): what is further away it follows, and shares no
    error with.
    """
    out = np.ones(len(logs))
    total = np.concatenate([np.zeros((1, grid.size)), np.cumsum(logs, axis=0)])
    claimed = np.concatenate([[0.0], np.cumsum(1.0 / variance)])
    number, free = np.arange(len(logs)), np.full(len(logs), np.inf)
    for cells in LEAST_TOGETHER * 2 ** np.arange(len(logs).bit_length()):
        here = number[(cells == LEAST_TOGETHER) | (together > cells // 4)]
        first, last = np.maximum(here - cells // 2, 0), np.minimum(here + cells // 2 + 1, len(logs))
        known = _moments(total, first, last, free[here], grid)[1]
        out[here] = np.maximum(out[here], known * (claimed[last] - claimed[first]))
    return out


def _moments(rows: Float, first: Int, last: Int, prior: Float, grid: Float) -> tuple[Float, Float]:
    """Mean and variance (c,) over the grid (g,) of densities whose logarithms are rows `last` less `first` of (n, g).

    Times a normal prior about 0 of standard deviation `prior` (c,), which may be infinite.
    """
    out = np.empty((2, len(first)))
    _fill_moments(as_input(rows), as_input(first), as_input(last), as_input(prior), as_input(grid), out)
    return out[0], np.maximum(out[1], (0.3 * (grid[1] - grid[0])) ** 2)


@kernel(error_model="numpy")
def _fill_moments(rows: Float, first: Int, last: Int, prior: Float, grid: Float, out: Float) -> None:
    logs = np.empty(grid.size)
    for c in range(first.size):
        most = -np.inf
        for g in range(grid.size):
            logs[g] = rows[last[c], g] - rows[first[c], g] - 0.5 * (grid[g] / prior[c]) ** 2
            most = max(most, logs[g])
        total, mean, square = 0.0, 0.0, 0.0
        for g in range(grid.size):
            if logs[g] > most - NOTHING:
                share = math.exp(logs[g] - most)
                total += share
                mean += share * grid[g]
                square += share * grid[g] ** 2
        out[0, c] = mean / total
        out[1, c] = square / total - (mean / total) ** 2


@kernel(error_model="numpy")
def _add_up(cell: Int, ends: Ends, normal: Float, grid: Float, out: Float) -> None:
    """Add each frame's log-likelihood of an end at each place of the grid to the row of its cell (eq. (8)).

    normal: the standard normal distribution function at even steps from -FAR_SIGMAS to FAR_SIGMAS.
    """
    low, step, sigma, weight = ends.low, ends.step, ends.sigma, ends.weight
    chance = np.empty(grid.size)
    for i in range(cell.size):
        s = sigma[i]
        if step[i] <= 0.0:
            for g in range(grid.size):
                z = (low[i] - grid[g]) / s
                chance[g] = math.exp(-0.5 * z * z)
        else:
            _pass_columns(low[i], step[i], s, ends.missing[i], ends.fade[i], normal, grid, chance)
        at_last, log_at_last = -1.0, 0.0
        for g in range(grid.size):
            if chance[g] != at_last:
                at_last = chance[g]
                log_at_last = weight[i] * math.log(max(at_last, 0.0) + STRAY)
            out[cell[i], g] += log_at_last


@kernel(error_model="numpy")
def _pass_columns(
    low: float, step: float, s: float, missing: float, fade: float, normal: Float, grid: Float, chance: Float
) -> None:
    """Fill in the chance, for an end at each place of the grid, of a last return at `low`, by the columns passed.

    The last return is the one before the end, or one of those before that, MISSES or where it fades more in all: from
    column to column the share of frames is taken off that the end has not passed, but for noise, and the share beyond
    it added.
    """
    apart, per_s, share, left = grid[1] - grid[0], 1.0 / (s * FAR_SIGMAS), 0.0, 1.0
    columns = MISSES + math.ceil(fade)
    for g in range(grid.size):
        chance[g] = 0.0
    for k in range(columns + 1):
        before, share = share, left * (1.0 - missing) * returns_share(k, fade) if k < columns else 0.0
        left -= share
        column = low + k * step
        first = min(max(math.ceil((column - FAR_SIGMAS * s - grid[0]) / apart), 0), grid.size)
        last = min(max(math.ceil((column + FAR_SIGMAS * s - grid[0]) / apart), first), grid.size)
        change = before - share if first < grid.size else before  # columns beyond the grid take all the rest
        for g in range(first):
            chance[g] += change
        for g in range(first, last):
            at = ((column - grid[g]) * per_s + 1.0) * 0.5 * (normal.size - 1)
            m = min(max(int(at), 0), normal.size - 2)
            chance[g] += change * (normal[m] + (at - m) * (normal[m + 1] - normal[m]))
        if first == grid.size:
            break


@functools.cache
def _normal() -> Float:
    """Standard normal distribution function from -FAR_SIGMAS to FAR_SIGMAS: between two values a line is 4e-7 off."""
    at = np.linspace(-FAR_SIGMAS, FAR_SIGMAS, NORMAL)
    return as_input(np.array([0.5 * math.erfc(-z / math.sqrt(2.0)) for z in at]))
