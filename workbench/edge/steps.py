"""What else than the face itself the ends along an edge may show: a burr that prolongs it, returns that are lost.

A milled edge changes smoothly. Where the end of a face jumps, something may stand out of it on one side, or its returns
may be lost on the other. Three readings of the ends are weighed by their evidence (docs/method.md, section 4): all of
them are the face's; where not, it is prolonged; where not, it is shortened. In the two latter cells follow a hidden
Markov chain (Rabiner, Proc. IEEE 77 (1989), 257): the face's own end, off it by ragged heights, off it by one height.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from workbench.geometry.blocks import as_input
from workbench.geometry.course import Course, fit_course
from workbench.geometry.medians import median
from workbench.kernels import kernel
from workbench.units import Float, Int, Shaped

# Of a cell: that a stretch off the face begins, and ends, with ragged heights and with one height.
BEGIN, END = np.array([0.03, 0.01]), np.array([0.2, 0.2])
OFF_MM, RAGGED_MM = 0.2, 0.02  # usual height off the face; by which ragged heights change from cell to cell
STRAY = 1e-3  # density, 1/mm, of a cell that says nothing
ODDS = 0.15  # of an edge that is prolonged somewhere, and of one that is shortened, against neither
NEAR, LOW = 10, 0.25  # cells on each side, of which so many are taken for the face's own at first
LEAST_CELLS, LEAST_OWN, MOST_ROUNDS, SETTLED = 8, 0.2, 8, 0.01
LEAST_SHARE = 0.3  # of the cells that are the face's own: what fewer say is no face, however well the others follow
NOISIER = 2.0  # variance of cells over the stated one, by which heights off the face are not told from noise
LAGS, LEAST_FRAMES, CERTAIN, STRAYS = (1, 2, 3), 48, 5.0, 4.0  # frames apart; of a pass; standard deviations


class Readings(NamedTuple):
    """What the readings together say beside a course: mean and standard uncertainty at m places, mm."""

    shift_mm: Shaped[Float, " m"]
    u_mm: Shaped[Float, " m"]
    own: Shaped[Float, " c"]  # probability that a cell shows the face's own end


class _Reading(NamedTuple):
    evidence: float
    own: Shaped[Float, " c"]
    course: Course
    sense: float


def readings(s: Float, value: Float, u: Float, course: Course, at: Float) -> Readings:
    """Of ends (c,), outwards, of cells at rising s (c,) mm, u (c,) of one, whose `course` takes all for the face's."""
    nothing = Readings(np.zeros(at.size), np.zeros(at.size), np.ones(s.size))
    if s.size < LEAST_CELLS:
        return nothing
    found = [one for sense in (1.0, -1.0) if (one := _off_the_face(s, sense * value, u, sense)) is not None]
    if not found:
        return nothing
    plain = fit_course(s, value, u**2)
    sigma = u * math.sqrt(plain.noise_factor)
    log = _clean(value - plain.value(s), sigma).sum() - _spent(plain, s, sigma)
    logs = np.array([log, *(one.evidence + math.log(ODDS) for one in found)])
    share = np.exp(logs - logs.max())
    share /= share.sum()
    apart = np.stack([np.zeros(at.size), *(one.sense * one.course.value(at) - course.value(at) for one in found)])
    own_u = np.stack([np.zeros(at.size), *(one.course.u(at) for one in found)])
    shift = share @ apart
    own = share @ np.stack([np.ones(s.size), *(one.own for one in found)])
    return Readings(shift, np.sqrt(share @ ((apart - shift) ** 2 + own_u**2)), own)


def _off_the_face(s: Float, value: Float, u: Float, sense: float) -> _Reading | None:
    """The best reading by which cells lie above the face's own end; None: none does."""
    near = np.lib.stride_tricks.sliding_window_view(np.pad(value, NEAR, mode="symmetric"), 2 * NEAR + 1)
    around = np.sort(near, axis=1)[:, round(2 * NEAR * LOW)]
    if (_own(value - around, u)[1] > 0.5).all():
        return None
    whole = np.full(value.size, np.quantile(value, LOW))  # a stretch may be longer than what is near
    found = [one for start in (around, whole) if (one := _settled(s, value, u, start, sense)) is not None]
    return max(found, key=lambda one: one.evidence, default=None)


def _settled(s: Float, value: Float, u: Float, face: Float, sense: float) -> _Reading | None:
    """The reading to which the face's own end `face` (c,) leads (expectation maximisation)."""
    _, own = _own(value - face, u)
    for _ in range(MOST_ROUNDS):
        shown = own > LEAST_OWN
        if shown.sum() < LEAST_CELLS // 2:
            return None
        course = fit_course(s, np.where(shown, value, np.nan), u**2 / np.maximum(own, LEAST_OWN))
        before, sigma = own, u * math.sqrt(min(course.noise_factor, NOISIER))
        evidence, own = _own(value - course.value(s), u)
        if np.abs(own - before).max() < SETTLED:
            break
    evidence, own = _own(value - course.value(s), sigma)
    if (own > 0.5).all() or (own > 0.5).mean() < LEAST_SHARE:
        return None
    return _Reading(evidence - _spent(course, s[shown], sigma[shown]), own, course, sense)


def _spent(course: Course, s: Float, sigma: Float) -> float:
    """What its freedom costs a course of cells at s (c,), by Schwarz's criterion with the cells' worth it takes."""
    freedom = (course.u(s) ** 2 / (max(1.0, course.misfit) * sigma**2)).sum()
    return 0.5 * float(freedom) * math.log(s.size)


def _clean(off: Float, u: Float) -> Float:
    """Logarithmic densities of cells `off` (c,) the face that show its own end."""
    return np.log(np.exp(-0.5 * (off / u) ** 2) / (u * math.sqrt(2.0 * math.pi)) + STRAY)


def _own(off: Float, u: Float) -> tuple[float, Float]:
    """Log-likelihood of cells `off` (c,) the face, and the probability of each that it shows its own end."""
    below = -0.25 * (np.minimum(off, 0.0) / u) ** 2  # nothing off the face lies below it, but for noise: each way half
    both = below + np.append(below[:1], below[:-1])
    change, beside = np.diff(off, prepend=off[0]), np.sqrt(0.5 * (u**2 + np.append(u[:1], u[:-1]) ** 2))
    apart, same = np.hypot(RAGGED_MM, math.sqrt(2.0) * beside), _clean(change, beside)
    ragged = -np.log(math.pi * apart * (1.0 + (change / apart) ** 2))
    # Half of what a height costs where the stretch begins, half where it ends: the same from either side.
    height = -0.5 * (np.maximum(off, 0.0) / OFF_MM + math.log(OFF_MM))
    own = np.empty(off.size)
    stays = np.stack([ragged + both, same + both], axis=1)
    return _chain(as_input(_clean(off, u)), as_input(height + below), as_input(stays), BEGIN, END, own), own


@kernel
def _chain(clean: Float, limit: Float, stays: Float, begin: Float, end: Float, own: Float) -> float:
    """Fill in own (c,), the probability of the face's own end; the log-likelihood of a chain of cells.

    clean (c,), limit (c,), stays (c, 2): logarithmic densities of the face's own end, of half of a limit of a stretch
    off it, of a cell that goes on with one. begin, end (2,): probabilities of its limits.
    """
    size, states = clean.size, begin.size + 1
    log, start = np.full((states, states), -np.inf), np.zeros(states)
    log[0, 0] = math.log(1.0 - begin.sum())
    for k in range(1, states):
        log[0, k], log[k, 0], log[k, k] = math.log(begin[k - 1]), math.log(end[k - 1]), math.log(1.0 - end[k - 1])
        start[k] = math.log(begin[k - 1] / end[k - 1])
    start -= _sum_of(start)
    ahead, behind, term = np.zeros((size, states)), np.zeros((size, states)), np.empty(states)
    for j in range(states):
        ahead[0, j] = start[j] + (limit[0] if j > 0 else clean[0])
        behind[size - 1, j] = limit[size - 1] if j > 0 else 0.0
    for c in range(1, size):
        for j in range(states):
            for i in range(states):
                term[i] = log[i, j] + _step(clean, limit, stays, c, i, j) + ahead[c - 1, i]
            ahead[c, j] = _sum_of(term)
    for c in range(size - 2, -1, -1):
        for i in range(states):
            for j in range(states):
                term[j] = log[i, j] + _step(clean, limit, stays, c + 1, i, j) + behind[c + 1, j]
            behind[c, i] = _sum_of(term)
    likelihood = _sum_of(ahead[size - 1] + behind[size - 1])
    for c in range(size):
        own[c] = math.exp(ahead[c, 0] + behind[c, 0] - likelihood)
    return likelihood


@kernel
def _step(clean: Float, limit: Float, stays: Float, c: int, i: int, j: int) -> float:
    """Logarithmic density of cell c in state j after one in state i."""
    if i == j and j > 0:
        return float(stays[c, j - 1])
    new = limit[c] if j > 0 else clean[c]
    return float(new + limit[c - 1] if i > 0 else new)


@kernel
def _sum_of(logs: Float) -> float:
    """Logarithm of the sum of what these (n,) are the logarithms of."""
    most = float(logs.max())
    return most if most == -np.inf else most + math.log(np.exp(logs - most).sum())


def waves_u(s: Float, left: Float, pass_index: Int, floor: float) -> float:
    """Root mean square of what neighbouring frames leave together, of residuals (N,) of frames at s (N,); 0: nothing.

    Noise is each frame's own. What goes together from frame to frame, or turns its sign with them, is a wave that the
    course does not follow (chatter). By the autocovariance, where it is certain; `floor`: what frames share by columns.
    """
    found = 0.0
    for number in np.unique(pass_index):
        on = np.flatnonzero((pass_index == number) & np.isfinite(s) & np.isfinite(left))
        if on.size < LEAST_FRAMES:
            continue
        value = left[on[np.argsort(s[on], kind="stable")]]
        value = value - median(value)  # passes may lie beside each other
        usual = STRAYS * 1.4826 * median(np.abs(value))
        value = value.clip(-usual, usual)
        own = float((value**2).mean())
        shared = max(abs(float((value[lag:] * value[:-lag]).mean())) for lag in LAGS)
        if shared > CERTAIN * own / math.sqrt(on.size):
            found = max(found, shared)
    return math.sqrt(max(found - floor**2, 0.0))
