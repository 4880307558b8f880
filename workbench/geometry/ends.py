"""Where a face ends, when its end is a silhouette: the place where its returns stop.

A single frame knows the end only to the step between two columns (the half-pixel rule). Neighbouring frames cut the
face at other phases of that step, so together they know it far better; if all cut it at the same phase they know no
more than one, and the likelihood says so. The end is fitted along the edge as a spline, by maximum likelihood.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import BSpline
from scipy.linalg import solveh_banded

from workbench.kernels import kernel
from workbench.units import Bool, Float, Int

STRAY = 0.01  # probability that a frame's last return tells nothing about the end
NEXT_MM = 3.0  # frames this near to a place may overrule the smooth course there
CONTRADICTION_SIGMAS = 5.0
MISSES = 6  # columns of the face that may have gone without return at its end
KNOTS_MM = (32.0, 16.0, 8.0)  # knot distances to choose from: waves shorter than this go unseen, longer ones may hide
#                                in the column step of frames that all cut the face at one phase
SHARP = 0.9  # what `settled` leaves of the noise, of what it reports
SCATTER_PARTS = (0.25, 0.1, 0.04, 0.02)  # of a column step
EM_STEPS = 8  # at each
BOUNDARY_LOSS = 0.8  # of log-likelihood a frame, times noise over column step, that the truth is expected to lose
PRICE = 3.0  # of a parameter, between the criteria of Akaike (2) and Schwarz (log n): intervals are easily overfitted
OVER_RELAX = 1.7
NEWTON_STEPS, NEWTON_DAMPING, NEWTON_GAIN = 25, 0.6, 0.01
BEND_PER_MM = 0.0005  # second derivative (1/mm) that a root size drifting by tenths of a mm over 100 mm may have
CHOICE_FRAMES = 4000  # the knot distance is chosen on this many neighbouring frames
ROOT_HALF, DENSITY = math.sqrt(0.5), 1.0 / math.sqrt(2.0 * math.pi)  # of the standard normal distribution
FAR_SIGMAS = 7.0  # beyond this much of its noise nothing is left of a column's probability


@dataclass(frozen=True, slots=True, eq=False)
class Ends:
    """The last return on a face in each of n frames, sorted by arc length, counted from some place in the frame, mm."""

    s: Float  # (n,) arc length
    low: Float  # (n,) the face reaches at least to here
    step: Float  # (n,) the next column lies this much further; 0: `low` is a measured corner
    sigma: Float  # (n,) noise of low
    missing: Float  # (n,) probability that a column of the face is without return
    weight: Float  # (n,) what the frame counts: less than 1 where its neighbours share its noise and its phase

    def part(self, chosen: slice) -> Ends:
        return Ends(self.s[chosen], self.low[chosen], self.step[chosen], self.sigma[chosen], self.missing[chosen],
                    self.weight[chosen])  # fmt: skip


@dataclass(frozen=True, slots=True, eq=False)
class SmoothEnd:
    """The end along the edge: a cubic spline with evenly spaced knots."""

    spline: BSpline
    knots_mm: float


def fit_end(ends: Ends, knots_mm: tuple[float, ...] = KNOTS_MM) -> SmoothEnd:
    """The most likely smooth end, with knots as far apart as the frames allow, of the distances `knots_mm`.

    A curve that keeps to the middle of the column steps seems likelier than the true one, which must touch their
    limits: by `slack` in all, for noise blurs the limits. Only what a finer curve gains beyond that speaks for it.
    """
    middle = max(0, (ends.s.size - CHOICE_FRAMES) // 2)
    sample = ends.part(slice(middle, middle + CHOICE_FRAMES))
    silhouette = sample.step > 0
    slack = BOUNDARY_LOSS * float((sample.weight * sample.sigma / np.maximum(sample.step, 1e-9))[silhouette].sum())
    fits = [(_most_likely(sample, distance), distance) for distance in knots_mm]
    best = max(found for (_, found), _ in fits)
    price = [PRICE * len(spline.c) - 2.0 * min(found, best - slack) for (spline, found), _ in fits]
    chosen = int(np.argmin(price))
    spline = fits[chosen][0][0] if sample.s.size == ends.s.size else _most_likely(ends, knots_mm[chosen])[0]
    return SmoothEnd(spline, knots_mm[chosen])


def _most_likely(ends: Ends, distance: float) -> tuple[BSpline, float]:
    """Spline with knots `distance` mm apart of (locally) greatest likelihood, and that log-likelihood.

    Expectation and maximisation in turn; the ends' own scatter about the spline shrinks from a part of the column step
    to the measured noise, so that the fit first sees all intervals and in the end only their hard limits.
    """
    length = max(float(ends.s[-1] - ends.s[0]), 1e-3)
    pieces = max(1, round(length / distance))
    grid = np.linspace(ends.s[0], ends.s[-1], pieces + 1)
    piece, basis = _basis(ends.s, grid)
    weight = ends.weight / (ends.sigma**2 + ends.step**2 / 12.0 + 1e-8)
    coefficients = _solve(piece, basis, ends.low + 0.5 * ends.step, weight, pieces)
    for part in SCATTER_PARTS:
        scatter = np.hypot(SHARP * ends.sigma, ends.step * part) + 1e-6
        for _ in range(EM_STEPS):
            now = _value(piece, basis, coefficients)
            target, weight = _expected_ends(now, ends.low, ends.step, scatter, ends.missing)
            relaxed = now + OVER_RELAX * (target - now)
            coefficients = _solve(piece, basis, relaxed, ends.weight * weight / scatter**2, pieces)
    coefficients = _straightened(piece, basis, coefficients, ends, scatter, length / pieces)
    now = _value(piece, basis, coefficients)
    found = _likelihood_slopes(now, ends.low, ends.step, scatter, ends.missing, ends.weight)[2]
    return BSpline(np.r_[[grid[0]] * 3, grid, [grid[-1]] * 3], coefficients, 3), found


def _straightened(piece: Int, basis: Float, coefficients: Float, ends: Ends, scatter: Float, knots_mm: float) -> Float:
    """The least bent of the about equally likely splines: Newton steps on likelihood and bending together.

    Inside the column steps the likelihood is flat, and the spline would keep to their middle, saw tooth by saw tooth.
    """
    size = coefficients.size
    bending = _bending(size) / (BEND_PER_MM * knots_mm**2) ** 2
    best, best_score = coefficients, -math.inf
    for _ in range(NEWTON_STEPS):
        now = _value(piece, basis, coefficients)
        pull, stiffness, found = _likelihood_slopes(now, ends.low, ends.step, scatter, ends.missing, ends.weight)
        score = found - 0.5 * float(coefficients @ _band_product(bending, coefficients))
        if abs(score - best_score) < NEWTON_GAIN or score < best_score - 1.0:
            break
        if score > best_score:
            best, best_score = coefficients, score
        band, right = _normal_equations(piece, basis, pull / stiffness, stiffness, size)
        right -= _band_product(bending, coefficients)
        coefficients = coefficients + NEWTON_DAMPING * solveh_banded(band + bending, right)
    return best


def _bending(size: int) -> Float:
    """Sum of squared second differences of spline coefficients as a banded matrix (4, size), upper form."""
    band = np.zeros((4, size))
    for shift, own, by_one in ((0, 1.0, 0.0), (1, 4.0, -2.0), (2, 1.0, -2.0)):  # of the differences 1, -2, 1
        band[3, shift : size - 2 + shift] += own
        band[2, shift : size - 2 + shift] += by_one
    band[1, 2:] = 1.0
    return band


def _band_product(band: Float, x: Float) -> Float:
    """Product of a symmetric banded matrix (4, n), upper form, with x (n,)."""
    out = band[3] * x
    for d in (1, 2, 3):
        out[:-d] += band[3 - d, d:] * x[d:]
        out[d:] += band[3 - d, d:] * x[:-d]
    return np.asarray(out)


@kernel
def _likelihood_slopes(now: Float, low: Float, step: Float, scatter: Float, missing: Float,
                       counts: Float) -> tuple[Float, Float, float]:  # fmt: skip
    """First and (at least a little) negative second derivative of each frame's log-likelihood by `now`, and its sum."""
    pull, stiffness = np.empty(now.size), np.empty(now.size)
    total = 0.0
    for i in range(now.size):
        s = scatter[i]
        if step[i] <= 0.0:
            z = (low[i] - now[i]) / s
            p = math.exp(-0.5 * z * z)
            weight = p / (p + STRAY)
            pull[i], stiffness[i] = counts[i] * weight * z / s, counts[i] * max(weight, 1e-3) / (s * s)
            total += counts[i] * math.log(p + STRAY)
            continue
        mass, first, second = 0.0, 0.0, 0.0
        a, share = (low[i] - now[i]) / s, 1.0 - missing[i]
        below, da = cdf(a), _density(a)
        for k in range(MISSES):
            b = (low[i] + (k + 1) * step[i] - now[i]) / s
            above, db = cdf(b), _density(b)
            mass += share * (above - below)
            first += share * (da - db) / s
            second += share * (a * da - b * db) / (s * s)
            if b > FAR_SIGMAS:
                break
            a, below, da, share = b, above, db, share * missing[i]
        slope = first / (mass + STRAY)
        pull[i] = counts[i] * slope
        stiffness[i] = counts[i] * max(slope * slope - second / (mass + STRAY), 1e-4 / (s * s))
        total += counts[i] * math.log(mass + STRAY)
    return pull, stiffness, total


def contradicted(ends: Ends, course: Float, at_mm: Float) -> Bool:
    """Do most frames next to each place (m,) say something else than the course (n,) of the end has at those frames?

    A smooth course through an edge that breaks off, or through a gouge, takes the frames there for strays: it must not
    speak for them. A frame contradicts where the course lies before its last return, or columns beyond it.
    """
    beyond = course > ends.low + 1.5 * ends.step + CONTRADICTION_SIGMAS * ends.sigma
    before = course < ends.low - 0.5 * ends.step - CONTRADICTION_SIGMAS * ends.sigma
    count = np.concatenate([[0], np.cumsum(beyond | before)])
    first, last = np.searchsorted(ends.s, at_mm - NEXT_MM), np.searchsorted(ends.s, at_mm + NEXT_MM)
    return np.asarray(2 * (count[last] - count[first]) > np.maximum(last - first, 3))


def local_end(ends: Ends, at_mm: Float) -> tuple[Float, Float]:
    """The end by the frames next to each place alone, where they contradict the smooth course; u is their spread."""
    value, u = np.empty(at_mm.size), np.empty(at_mm.size)
    for i, at in enumerate(at_mm):
        near = slice(*np.searchsorted(ends.s, [at - NEXT_MM, at + NEXT_MM]))
        middle = ends.low[near] + 0.5 * ends.step[near]
        value[i] = np.median(middle)
        spread = np.median(np.abs(middle - value[i])) / 0.6745
        u[i] = math.hypot(float(np.median(ends.step[near])) / math.sqrt(12.0), float(spread))
    return value, u


def _basis(s: Float, grid: Float) -> tuple[Int, Float]:
    """Piece number (n,) and the four cubic B-splines (n, 4) that are not zero at each s."""
    knots = np.r_[[grid[0]] * 3, grid, [grid[-1]] * 3]
    piece = np.clip(np.searchsorted(grid, s, side="right") - 1, 0, grid.size - 2)
    return piece, _de_boor(s, knots, piece + 3)


@kernel
def _de_boor(s: Float, knots: Float, span: Int) -> Float:
    out, left, right = np.zeros((s.size, 4)), np.empty(4), np.empty(4)
    for i in range(s.size):
        j = span[i]
        out[i, 0] = 1.0
        for d in range(1, 4):
            left[d], right[d] = s[i] - knots[j + 1 - d], knots[j + d] - s[i]
            saved = 0.0
            for r in range(d):
                term = out[i, r] / (right[r + 1] + left[d - r])
                out[i, r] = saved + right[r + 1] * term
                saved = left[d - r] * term
            out[i, d] = saved
    return out


@kernel
def _normal_equations(piece: Int, basis: Float, target: Float, weight: Float, size: int) -> tuple[Float, Float]:
    """Banded normal matrix (4, size), upper form of scipy.linalg.solveh_banded, and right side (size,)."""
    band, right = np.zeros((4, size)), np.zeros(size)
    for i in range(target.size):
        for p in range(4):
            right[piece[i] + p] += weight[i] * basis[i, p] * target[i]
            for q in range(p, 4):
                band[3 - (q - p), piece[i] + q] += weight[i] * basis[i, p] * basis[i, q]
    return band, right


@kernel
def _value(piece: Int, basis: Float, coefficients: Float) -> Float:
    out = np.empty(piece.size)
    for i in range(piece.size):
        value = 0.0
        for p in range(4):
            value += basis[i, p] * coefficients[piece[i] + p]
        out[i] = value
    return out


def _solve(piece: Int, basis: Float, target: Float, weight: Float, pieces: int) -> Float:
    """Weighted least squares; a slight pull against bending carries the spline over gaps."""
    size = pieces + 3
    band, right = _normal_equations(piece, basis, target, weight, size)
    pull = 1e-4 * float(band[3].mean()) + 1e-12
    band += pull * _bending(size)
    band[3] += 1e-9 * pull
    return np.asarray(solveh_banded(band, right))


@kernel
def cdf(z: float) -> float:
    """Standard normal distribution function; 0 or 1 beyond FAR_SIGMAS."""
    if abs(z) > FAR_SIGMAS:
        return 1.0 if z > 0.0 else 0.0
    return 0.5 * math.erfc(-z * ROOT_HALF)


@kernel
def _density(z: float) -> float:
    """Standard normal density; 0 beyond FAR_SIGMAS."""
    return DENSITY * math.exp(-0.5 * z * z) if abs(z) < FAR_SIGMAS else 0.0


@kernel
def _expected_ends(now: Float, low: Float, step: Float, scatter: Float, missing: Float) -> tuple[Float, Float]:
    """Expected end of each frame given the smooth one `now` (n,), and the weight it deserves.

    Ends scatter about the smooth one with standard deviation `scatter`; the frame says that its own lies in
    [low, low + step], or k steps further with probability missing^k.
    """
    target, weight = np.empty(now.size), np.empty(now.size)
    for i in range(now.size):
        if step[i] <= 0.0:
            z = (low[i] - now[i]) / scatter[i]
            p = math.exp(-0.5 * z * z)
            target[i], weight[i] = low[i], p / (p + STRAY)
            continue
        mass, first = 0.0, 0.0
        a, share = (low[i] - now[i]) / scatter[i], 1.0 - missing[i]
        below, da = cdf(a), _density(a)
        for k in range(MISSES):
            b = (low[i] + (k + 1) * step[i] - now[i]) / scatter[i]
            above, db = cdf(b), _density(b)
            mass += share * (above - below)
            first += share * (da - db)
            if b > FAR_SIGMAS:
                break
            below, da, share = above, db, share * missing[i]
        if mass > 1e-12:
            target[i] = now[i] + scatter[i] * first / mass
        else:
            target[i] = now[i]
        weight[i] = mass / (mass + STRAY)
    return target, weight
