"""What else than the face itself the ends along an edge may show: a burr that prolongs it, returns that are lost.

A milled edge changes smoothly. Where the end of a face jumps, something may stand out of it on one side, or its returns
may be lost on the other. Three readings of the ends are weighed by their evidence (docs/method.md, section 4): all of
them are the face's; where not, it is prolonged; where not, it is shortened. In the two latter every way counts to part
the cells into the face's own and stretches off it, by ragged heights or by one (a hidden semi-Markov chain: Yu,
Artificial Intelligence 174 (2010), 215). A stretch off by one height may as well be the edge itself, which steps.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from workbench.checks.residuals import CERTAIN, LEAST_FRAMES
from workbench.geometry.along import by_pass, in_order, near
from workbench.geometry.blocks import as_input
from workbench.geometry.course import ALONE, BIN_MM, Course, fit_course, shares, stretches
from workbench.geometry.medians import median, robust_sd
from workbench.geometry.processes import Process, Shared
from workbench.geometry.splines import through
from workbench.kernels import kernel
from workbench.units import TO_SD, Bool, Float, Int, Shaped

# Of a cell: that a stretch off the face begins, and ends, with ragged heights and with one height.
BEGIN, END = np.array([0.1, 0.01]), np.array([0.3, 0.2])
# Logarithms: of none beginning, and of the sum over how a face begins. A reduction in a kernel loads scipy.linalg
LOG_NONE, LOG_ALL = math.log1p(-BEGIN.sum()), math.log1p((BEGIN / END).sum())
OFF_MM, RAGGED_MM = 0.1, 0.02  # usual height off the face; by which ragged ones change from cell to cell
STRAY = 1e-3  # density, 1/mm, of a cell that says nothing
# Of an edge that is prolonged somewhere, and of one that is shortened, against neither: burrs are more usual
ODDS = 0.3, 0.15
STEPPED = 0.3  # of stretches that stand off by one height: that the edge itself steps, as no return tells
JUMP = 3.0  # standard deviations of neighbours: half a column's step, as ends pass from column to column, is 2.4
# Cells on each side, of which so many are taken for the face's own at first; how far so many lie low by chance
NEAR, LOW, LOWER = 10, 0.25, 1.0 / TO_SD
LEAST_CELLS, LEAST_OWN, MOST_ROUNDS, SETTLED = 8, 0.2, 3, 0.01
LONGEST = 200  # cells of a stretch
LEAST_SHARE = 0.3  # of the cells that are the face's own: what fewer say is no face, however well the others follow
# Standard deviations, from which on a share below is told by its series, one above is all; the density's constant.
FAR, SURE, FULL = 30.0, 6.0, math.sqrt(2.0 * math.pi)
NIL = -25.0  # logarithm of a share that counts no more
FOOT_MM = 0.15  # usual width of what stands on a face, beside its end
NEAR_MM, LEAST_BURRED = 1.2, 0.5  # of a station, whose frames have a say; of them, that show a burr
LAGS, STRAYS = (1, 2, 3), 4.0  # frames apart; standard deviations
AVERAGED_MM = 1.0  # of edge, beyond which waves of a face's direction are its own: texture is shorter

STEP_NOTE = (
    "{} lies {:.2f} mm {} its course over {:.0f} mm of edge, about {:.0f} mm along it: returns are lost there, a burr "
    "stands out, or the edge itself steps: look at it; what a step would cost is in u"
)
TOLD_MM = 0.03  # of a step, at least


def step_note(end: str, step_mm: Float, at: Float) -> tuple[str, ...]:
    """The largest step (m,) that an end may have at arc lengths `at` (m,), which are evenly spaced, in words."""
    off = np.abs(step_mm) > TOLD_MM
    if not off.any():
        return ()
    most = np.argmax(np.abs(step_mm))
    where = "beyond" if step_mm[most] > 0.0 else "short of"
    return (STEP_NOTE.format(end, abs(step_mm[most]), where, (at[1] - at[0]) * off.sum(), at[most]),)


class Readings(NamedTuple):
    """What the readings together say beside a course: mean and standard uncertainty at m places, mm."""

    shift_mm: Shaped[Float, " m"]
    u_mm: Shaped[Float, " m"]
    own: Shaped[Float, " c"]  # probability that a cell shows the face's own end
    step_mm: Shaped[Float, " m"]  # by which the edge itself may step there
    turning_u_mm: Shaped[Float, " m"]  # what of u_mm is no such step

    def sure_step_mm(self, course: Course) -> Float:
        """`step_mm` (m,) where it stands out of what the course leaves open, else 0."""
        return np.where(np.abs(self.step_mm) > 2.0 * course.u(course.at_mm), self.step_mm, 0.0)

    def moved(self, course: Course) -> Course:
        """The course, whose own places these are, where they say that the face itself ends."""
        if not self.shift_mm.any():
            return course
        return replace(course, spline=through(course.at_mm, course.value(course.at_mm) + self.shift_mm))


class _Reading(NamedTuple):
    evidence: float
    own: Shaped[Float, " c"]
    course: Course
    even: Shaped[Float, " c"]  # probability that it does
    height: Shaped[Float, " c"]  # by which then, mm
    sense: float


class _Noise(NamedTuple):
    """By what a face's own ends scatter, of cells (c,)."""

    u: Shaped[Float, " c"]  # mm
    is_all: bool  # that is all
    shared: Process | None  # but for errors that cells share

    def course(self, s: Float, value: Float, variance: Float, stiffness: tuple[Float, ...] | None = None) -> Course:
        """The course of values (c,) at s (c,) mm."""
        shared = Shared(processes=(self.shared,)) if self.shared else ALONE
        return fit_course(s, value, variance, stiffness=stiffness, shared=shared)

    def of(self, course: Course) -> Float:
        """Standard deviation (c,) about a course, mm."""
        own = self.u if self.is_all else self.u * math.sqrt(course.noise_factor)
        return np.hypot(own, self.shared.strength) if self.shared else own


def readings(
    s: Float,
    value: Float,
    u: Float,
    at: Float,
    course: Course | None = None,
    *,
    is_all: bool = True,
    shared: Process | None = None,
) -> Readings:
    """Of ends (c,), outwards, of cells at rising s (c,) mm, u (c,) of one; `course` takes all for the face's.

    is_all: `u` is all by which a face's own end scatters, as what columns leave open is; else it may scatter by more.
    shared: errors that cells share beside it.
    """
    nothing = Readings(np.zeros(at.size), np.zeros(at.size), np.ones(s.size), np.zeros(at.size), np.zeros(at.size))
    if s.size < LEAST_CELLS:
        return nothing
    noise = _Noise(u, is_all, shared)
    plain = noise.course(s, value, u**2)
    course, sigma = course or plain, noise.of(plain)
    found = [one for sense in (1.0, -1.0) for one in _off_the_face(s, sense * value, noise, sigma, sense)]
    if not found:
        return nothing._replace(own=plain.kept.astype(float))
    if shared:
        log = _clean(value - plain.value(s), sigma).sum() - _cost(plain, s.size)
    else:  # over all courses, which tells burrs apart better where cells err each by itself
        own = np.log(FULL * sigma[plain.kept]) + 0.5 * plain.noise_factor * (u[plain.kept] / sigma[plain.kept]) ** 2
        log = plain.log_evidence - (own - 0.5).sum() + math.log(STRAY) * (~plain.kept).sum()
    logs = np.array([log, *(one.evidence + math.log(ODDS[one.sense < 0.0]) for one in found)])
    share = shares(logs)
    apart = np.stack([np.zeros(at.size), *(one.sense * one.course.value(at) - course.value(at) for one in found)])
    own_u = np.stack([np.zeros(at.size), *(one.course.u(at) for one in found)])
    off = np.stack([np.zeros(at.size), *(_own_step(one, s, value, at) for one in found)])
    shift = share @ apart
    own = share @ np.stack([plain.kept.astype(float), *(one.own * one.course.kept for one in found)])
    turning = share @ ((apart - shift) ** 2 + own_u**2)
    stepping = STEPPED * (share @ off**2)
    return Readings(shift, np.sqrt(turning + stepping), own, share @ off, np.sqrt(turning))


def _own_step(one: _Reading, s: Float, value: Float, at: Float) -> Float:
    """By how much the edge itself may step at places (m,), mm, in a reading of cells (c,) of these values.

    One height may be a step; where material may be lost, any height: a burr of uneven height is none of the edge.
    """
    lost = (1.0 - one.own) * np.maximum(-value - one.course.value(s), 0.0)
    height = one.even * one.height if one.sense > 0.0 else -lost
    right = np.searchsorted(s, at).clip(1, s.size - 1)  # it begins anywhere between two cells
    further = np.where(np.abs(height[right - 1]) > np.abs(height[right]), right - 1, right)
    return height[further]


def _off_the_face(s: Float, value: Float, noise: _Noise, sigma: Float, sense: float) -> list[_Reading]:
    """The readings by which cells, that scatter by sigma (c,), lie above the face's own end, from each start.

    None where none does.
    """
    near = np.lib.stride_tricks.sliding_window_view(np.pad(value, NEAR, mode="symmetric"), 2 * NEAR + 1)
    around = np.sort(near, axis=1)[:, round(2 * NEAR * LOW)] + LOWER * sigma
    if (_posterior(value - around, sigma).own > 0.5).all():
        return []
    step = np.diff(value, prepend=value[0])  # a stretch may be longer than what is near: without what jumps
    jumped = np.cumsum(
        np.where(np.abs(step) > JUMP * np.hypot(noise.u, np.append(noise.u[:1], noise.u[:-1])), step, 0.0)
    )
    starts = around, value - jumped + np.quantile(jumped, LOW)
    settled = [_settled(s, value, noise, _posterior(value - start, sigma), sense) for start in starts]
    return [one._replace(evidence=one.evidence - math.log(len(starts))) for one in settled if one is not None]


def _settled(s: Float, value: Float, noise: _Noise, posterior: _Posterior, sense: float) -> _Reading | None:
    """The reading to which a first `posterior` of the cells leads (expectation maximisation).

    Cells that stand off by one height tell the face's shape with its own.
    """
    stiffness = None
    for _ in range(MOST_ROUNDS):
        known = np.maximum(posterior.own, posterior.even)
        if (posterior.own > LEAST_OWN).sum() < LEAST_CELLS // 2:
            return None
        shown = np.where(posterior.even > posterior.own, value - posterior.height, value)
        variance = noise.u**2 / np.maximum(known, LEAST_OWN)
        course = noise.course(s, np.where(known > LEAST_OWN, shown, np.nan), variance, stiffness)
        stiffness = course.stiffness
        before, posterior = posterior.own, _posterior(value - course.value(s), noise.of(course))
        if np.abs(posterior.own - before).max() < SETTLED:
            break
    if (posterior.own > 0.5).all() or (posterior.own > 0.5).mean() < LEAST_SHARE:
        return None
    evidence = posterior.evidence - _cost(course, int((known > LEAST_OWN).sum()))
    return _Reading(evidence, posterior.own, course, posterior.even.clip(0.0, 1.0), posterior.height, sense)


def _cost(course: Course, cells: int) -> float:
    """What its freedom costs a course through so many cells: Schwarz's criterion with the cells' worth it takes.

    Corrected where these are many of the cells: McQuarrie, Statistics & Probability Letters 44 (1999), 79.
    """
    return 0.5 * course.spent * math.log(cells) * cells / max(cells - course.spent - 2.0, 1.0)


def _clean(off: Float, u: Float) -> Float:
    """Logarithmic densities of cells `off` (c,) the face that show its own end."""
    return np.log(np.exp(-0.5 * (off / u) ** 2) / (FULL * u) + STRAY)


class _Posterior(NamedTuple):
    """What cells (c,) off a face show, over all ways to divide them into stretches."""

    evidence: float  # log-likelihood
    own: Shaped[Float, " c"]  # probability that a cell shows the face's own end
    even: Shaped[Float, " c"]  # that it stands off by one height with its neighbours
    height: Shaped[Float, " c"]  # that height then, mm


def _posterior(off: Float, u: Float) -> _Posterior:
    """Of cells `off` (c,) the face, mm, with standard uncertainties (c,)."""
    below = -0.5 * (np.minimum(off, 0.0) / u) ** 2  # nothing off the face lies below it, but for noise
    change, change_u = np.diff(off, prepend=off[0]), np.hypot(u, np.append(u[:1], u[:-1]))
    apart = np.hypot(RAGGED_MM, change_u)
    ragged = below - np.log(math.pi * apart * (1.0 + (change / apart) ** 2))
    # Half of what a height costs where the stretch begins, half where it ends: the same from either side.
    limit = -0.5 * (np.maximum(off, 0.0) / OFF_MM + math.log(OFF_MM))
    longest = min(off.size, LONGEST)
    kinds, height = np.empty((2, off.size, longest)), np.empty((off.size, longest))
    weight, chance, clean = 1.0 / u**2, np.log([BEGIN, END, 1.0 - END]), _clean(off, u)
    of = (off, weight, np.log(weight / (2.0 * math.pi)), limit, below, ragged, clean)
    reach = np.zeros(off.size, np.int64)
    _stretches(_Cells(*map(as_input, of)), chance, kinds, height, reach)
    out = np.zeros((3, off.size + 1))
    log = _forward_backward(np.concatenate([[0.0], clean, [0.0]]), kinds, height, reach, out)
    own, even, total = out[:, :-1]
    return _Posterior(log, own, even, total / np.maximum(even, 1e-6))


class _Cells(NamedTuple):
    """Cells off a face, mm, and logarithmic densities of ragged ones (c,)."""

    off: Shaped[Float, " c"]
    weight: Shaped[Float, " c"]  # 1 / variance
    log_weight: Shaped[Float, " c"]  # logarithm of weight / 2 pi
    limit: Shaped[Float, " c"]  # half of that of a stretch's limit
    first: Shaped[Float, " c"]  # of the first
    further: Shaped[Float, " c"]  # of one after another
    clean: Shaped[Float, " c"]  # the same of the face's own ends


@kernel
def _stretches(cells: _Cells, chance: Float, out: Float, height: Float, reach: Int) -> None:
    """Fill in out (2, c, n): log-likelihoods of stretches off the face, from each cell on over 1 to n, of either kind.

    chance (3, 2): logarithms of the probabilities that one begins, ends at a cell, and does not; a limit of all cells
    is none of it. One height, exponential before, is integrated out; height (c, n): its mean. reach (c,): how many of
    the lengths are worth a look: beyond, what is off the face had better end, or begin later.
    """
    size, most, highest = cells.off.size, math.log(FULL / OFF_MM), 0.0
    for off in cells.off:
        highest = max(highest, off)
    least = NIL - highest / OFF_MM  # what a height costs is no reason to end
    for b in range(size):
        ragged, weight, total, square = cells.first[b] - cells.further[b], 0.0, 0.0, 0.0
        own, best = 0.0, 0.0
        for c in range(b, min(b + height.shape[1], size)):
            w, off = cells.weight[c], cells.off[c]
            weight += w
            total += w * off
            square += w * off**2 - cells.log_weight[c]
            ragged += cells.further[c]
            mean = (total - 1.0 / OFF_MM) / weight
            even = 0.5 * (weight * mean**2 - square - math.log(weight)) + most
            z = mean * math.sqrt(weight)  # heights lie above the face: the normal distribution's share there
            if z < -FAR:
                even -= 0.5 * z * z + math.log(-FULL * z)
            elif z < SURE:
                even += math.log(0.5 * math.erfc(-z / math.sqrt(2.0)))
            limits, within = 1.0 - (1.0 if b == 0 else 0.0) - (1.0 if c == size - 1 else 0.0), c - b
            for k in range(2):
                stretch = ragged + cells.limit[b] + cells.limit[c] if k == 0 else even
                out[k, b, within] = stretch + chance[0, k] + limits * chance[1, k] + within * chance[2, k]
            height[b, within] = max(mean, 0.0)
            reach[b] = within + 1
            own += cells.clean[c]
            likelier = max(out[0, b, within], out[1, b, within]) - own
            best = max(best, likelier)
            if likelier < best + least:
                break


@kernel
def _forward_backward(clean: Float, kinds: Float, height: Float, reach: Int, out: Float) -> float:
    """Fill in out (3, c + 1), probabilities of own and even cells, and the latter times the height; log-likelihood.

    clean (c + 2,): logarithmic densities of the face's own ends, 0 beside the first and the last cell; kinds (2, c, n)
    and height (c, n): of stretches from each cell on over 1 to n, of which reach (c,) are known.
    """
    size, longest = clean.size - 2, height.shape[1]
    ahead, behind, term = np.zeros(size + 2), np.zeros(size + 2), np.empty(2 * size + 3)
    for i in range(1, size + 2):
        term[0], count = ahead[i - 1] + (LOG_NONE if 1 < i < size + 1 else 0.0), 1
        for n in range(min(i - 1, longest)):
            b = i - 2 - n
            if n < reach[b]:
                for k in range(2):
                    term[count], count = ahead[b] + kinds[k, b, n], count + 1
        ahead[i] = clean[i] + _sum_of(term, count)
    for i in range(size, 0, -1):
        term[0], count = behind[i + 1] + clean[i + 1] + (LOG_NONE if i < size else 0.0), 1
        for n in range(reach[i] if i < size else 0):
            for k in range(2):
                term[count], count = kinds[k, i, n] + clean[i + n + 2] + behind[i + n + 2], count + 1
        behind[i] = _sum_of(term, count)
        out[0, i - 1] = math.exp(ahead[i] + behind[i] - ahead[size + 1])
    _add_heights(ahead, behind, kinds[1], height, reach, clean, out)
    return float(ahead[size + 1] - LOG_ALL)


@kernel
def _add_heights(ahead: Float, behind: Float, even: Float, height: Float, reach: Int, clean: Float, out: Float) -> None:
    """Fill in rows 1 and 2 of out of `_forward_backward`, by log-likelihoods of all cells before and after (c + 2,)."""
    size = clean.size - 2
    for b in range(size):
        for n in range(reach[b]):
            e = b + n + 2
            log = ahead[b] + even[b, n] + clean[e] + behind[e] - ahead[size + 1]
            if log > NIL:
                for row, of in ((1, math.exp(log)), (2, math.exp(log) * height[b, n])):
                    out[row, b] += of
                    out[row, e - 1] -= of
    for row in range(1, 3):
        for c in range(1, size):
            out[row, c] += out[row, c - 1]


@kernel
def _sum_of(logs: Float, count: int) -> float:
    """Logarithm of the sum of what the first `count` of these are the logarithms of."""
    most, total = -np.inf, 0.0
    for i in range(count):
        most = max(most, logs[i])
    if most == -np.inf:
        return most
    for i in range(count):
        if logs[i] > most + NIL:
            total += math.exp(logs[i] - most)
    return most + math.log(total)


def own_directions(s: Float, angle: Float, variance: Float, width_mm: float) -> Float:
    """Probability (n,) that frames at s (n,) mm show a face's own direction, angle (n,) rad of such variance (n,).

    What stands on either end of a face `width_mm` wide, over a stretch of the edge, turns its line by six times its
    height and its foot over the width's square, whether or not it is told as a burr; `readings` weigh that height.
    """
    by_mm = width_mm**2 / (6.0 * FOOT_MM)
    return own_places(s, by_mm * angle, by_mm**2 * variance)


def own_places(s: Float, value: Float, variance: Float) -> Float:
    """Probability (n,) that frames at s (n,) mm show where a face itself ends, value (n,) mm of such variance (n,)."""
    out, on = np.ones(s.size), np.isfinite(s + value + variance)
    _, cell = np.unique(stretches(s[on], BIN_MM), return_inverse=True)
    weight = 1.0 / variance[on]
    total = np.bincount(cell, weight)
    place, mean = (np.bincount(cell, weight * of[on]) / total for of in (s, value))
    order = np.argsort(place)
    place, mean, u = place[order], mean[order], 1.0 / np.sqrt(total[order])
    if place.size >= LEAST_CELLS:
        own = readings(place, mean, u, place, is_all=False).own
        out[on] = np.interp(s[on], place, np.maximum(own, STRAY))
    return out


def burr_stations(s: Float, at: Float, *burred: Bool) -> Int:
    """Stations (of `at`, mm) at which most frames, at s (N,) mm, show one of some burrs, (N,) each."""
    order = in_order(s)
    first, last = near(s[order], at, NEAR_MM)
    shown = np.stack([np.append(0, np.cumsum(one[order])) for one in burred])
    shown = (shown[:, last] - shown[:, first]).max(axis=0)
    return np.flatnonzero((shown > 1) & (shown >= LEAST_BURRED * (last - first)))


def slow_waves_u(s: Float, left: Float, pass_index: Int) -> float:
    """As `waves_u`, of the means over AVERAGED_MM: what fewer frames share is averaged out along the edge."""
    on = np.isfinite(s + left)
    if not on.any():
        return 0.0
    along = stretches(s[on], AVERAGED_MM)
    _, cell = np.unique(pass_index[on] * (along.max() + 1) + along, return_inverse=True)
    count = np.bincount(cell)
    place, mean, group = (np.bincount(cell, of[on]) / count for of in (s, left, pass_index))
    return waves_u(place, mean, group.astype(np.int64), 0.0)


def waves_u(s: Float, left: Float, pass_index: Int, floor: float) -> float:
    """Root mean square of what neighbouring frames leave together, of residuals (N,) of frames at s (N,); 0: nothing.

    Noise is each frame's own. What goes together from frame to frame, or turns its sign with them, is a wave that the
    course does not follow (chatter). By the autocovariance, where it is certain; `floor`: what frames share by columns.
    """
    found = 0.0
    for mine in by_pass(pass_index):
        on = mine[in_order(s[mine], left[mine])]
        if on.size < LEAST_FRAMES:
            continue
        value = left[on]
        value = value - median(value)  # passes may lie beside each other
        usual = STRAYS * robust_sd(value)
        value = value.clip(-usual, usual)
        own = float((value**2).mean())
        shared = max(abs(float((value[lag:] * value[:-lag]).mean())) for lag in LAGS)
        if shared > CERTAIN * own / math.sqrt(on.size):
            found = max(found, shared)
    return math.sqrt(max(found - floor**2, 0.0))
