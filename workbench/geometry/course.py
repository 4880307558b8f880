"""The one estimator of everything that runs smoothly along an edge: directions, sizes, the edge's own course.

A course f(s) is a cubic spline with one of two priors: random walks of its derivatives of two orders, or waves of all
lengths down to a shortest one, alike high (docs/method.md, eq. (1)). The data say by their marginal likelihood which,
and how strong (eq. (3)), and the answer is averaged over what they leave open (eq. (4)). Noise is that of neighbouring
bins, not of a count of frames (eq. (2)).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise, permutations
from typing import NamedTuple, TypeAlias

import numpy as np

from workbench.geometry.blocks import as_input
from workbench.geometry.medians import median, medians, row_medians
from workbench.geometry.moves import chords_mm
from workbench.geometry.penalised import LocalNoise, Penalised, penalised, with_local_noise
from workbench.geometry.processes import Correlated, Process, Shared, correlated, shape_sizes
from workbench.geometry.splines import Spline
from workbench.kernels import kernel
from workbench.units import TO_SD, AnyArray, Bool, Float, Int, Shaped

BIN_MM, LEAST_BINS = 2.0, 40  # frames are averaged over this much edge, or over this part of a short one
LEAST_PIECES = 5  # of the spline; else its knots are two bins apart
OUTLIER_SIGMAS = 5.0  # of the frames' own scatter; one in two million by chance
MEDIAN_BINS = 5  # bins whose median says roughly where the course runs
RESETTLED = 6  # times that the noise settles beside what bins share
LEAST_SHARED = 3  # bins in which passes tell how far they lie beside each other
ALL_ALIKE = 1e-12  # of the strongest: what differences of passes do not tell, the offset of all
# Of passes that share none: bins on each side that tell a step where they meet, and its own uncertainties that make it
# certain, of a bend's four freedoms.
MEETING, SURE_STEP = 6, 4.0
AGREED = 2.0  # times the usual difference of neighbours: values that leave the course by it together are no strays
DIRECTION_MM = 20.0  # over which a direction is told: a notch's flanks are none of the edge
LEAST_VALUES = 5  # of a pass that is judged, or may lie beside the others, by itself
READMITTED = 5  # times at most that outliers are told again, by the course that was fitted without them
CHANCE = 2.0  # standard deviations by which two passes differ where nothing is wrong
LEAST_OWN = 0.01  # of what neighbours differ, that they do not share
LEAST_FACTOR = 1e-12  # of noise: exact values have none
STIFFNESSES = 9  # grid of each random walk's strength, from unseen to free, a factor of about 5 apart
STIFFEST_MM = 150.0  # no course is taken for straighter than over this length
DIGITS = 1e-9  # of a value: what rounding may leave of values without noise
LEAST_SHARE = 2e-3  # of the posterior, for a stiffness to count
HIDDEN, HIDDEN_MM = 0.3, 20.0  # waves are assumed that this much edge cannot tell from noise, whatever the data say
SHORTEST_BINS, CUTS = 6.0, 5  # the shortest waves that are assumed to be as high as long ones
LEAST_WAVE_BINS = 6  # fewer know nothing of waves
SHARPEST = 3  # order of the derivative that holds shorter waves back
STEPLESS, STEP = 100.0, 0.3  # odds that values of a pass take no step; size of one, in their unit
STEP_PRIORS = 8  # one in so many of the priors is asked for steps
MOST_BINS = 250  # of values that share errors: on longer edges they are longer
# Power of the evidence between processes, none of which has a robot's own shape: Miller and Dunson, J. Am. Stat. Assoc.
# 114 (2019), 1113.
TRUSTED = 0.5
TIE = 0.1234  # which of gaps that are alike wide is taken: the first after this share of a stretch
# What may be roughness: its length, as that of a course's shortest waves or half of it, and its strength over the noise
# of bins.
ROUGH_MM, ROUGH_TIMES = (1.0, 2.0), (2.0, 6.0)
POOLED = (1, 2, 4, 8)  # bins, by whose residuals the course is tested
ALONE = Shared()
PRIOR_FREEDOM = 6.0  # weight, in bins, of the stated noise beside the noise that is found


@dataclass(frozen=True, slots=True, eq=False)
class Course:
    """A smooth function of arc length with its uncertainty: posterior mean and standard deviation."""

    spline: Spline  # mean; values () or (d,)
    at_mm: Shaped[Float, " k"]  # where the uncertainty was computed
    variance: Shaped[Float, " k"]  # of each component there
    slope_variance: Shaped[Float, " k"]  # of df/ds
    kept: Shaped[Bool, " n"]  # False: outliers, and what was not finite
    frame_factor: float  # variance of single values over the stated one
    noise_factor: float  # the same of bins of values: larger where neighbouring values share noise
    misfit: float  # mean square of the pooled residuals over their variance, the largest; 1: as the noise says
    log_evidence: float
    # under each process that values may share, (j, 4) priors: the order of the lower derivative held back, both
    # strengths, posterior share
    stiffness: tuple[Float, ...]
    step_u: float = 0.0  # standard uncertainty of its values by a step within a pass; 0 where no errors are shared
    shared_variance: Shaped[Float, " k"] | None = None  # what of `variance` is by errors that values share
    spent: float = 0.0  # how many bins' worth it takes
    between: float = 0.0  # what of `variance` is by how far passes differ

    def value(self, s: Float) -> Float:
        """f(s): (m,) or (m, d). Beyond the ends of what was seen it goes straight on."""
        return self.spline.straight_on(s)

    def slope(self, s: Float) -> Float:
        """df/ds: (m,) or (m, d)."""
        return self.spline(np.clip(s, *self.spline.ends), 1)

    def u(self, s: Float) -> Float:
        """Standard uncertainty (m,) of each component of f(s)."""
        beyond = np.asarray(s) - np.clip(s, self.at_mm[0], self.at_mm[-1])
        variance = np.interp(s, self.at_mm, self.variance)
        if beyond.any():
            variance = variance + beyond**2 * np.interp(s, self.at_mm, self.slope_variance)
        return np.sqrt(variance)

    def doubted(self, u: Float, turning_u: Float) -> Course:
        """The course with a further u (k,) of its values at `at_mm`, of which turning_u turns it, over DIRECTION_MM."""
        turn = turning_u / DIRECTION_MM
        return replace(self, variance=self.variance + u**2, slope_variance=self.slope_variance + turn**2)

    def u_without(self, s: Float, known_u: Float) -> Float:
        """`u` (m,) without errors of each pass whose u (m,) is counted elsewhere: passes differ by as much, or by more.

        By how far a few passes differ shows badly how much they err: up to CHANCE times what is known is by chance.
        """
        known = np.minimum(self.between, (CHANCE * known_u) ** 2)
        return np.sqrt(np.maximum(self.u(s) ** 2 - known, 0.0))

    def shared_u(self, s: Float) -> Float:
        """What of `u` (m,) is by errors that values share."""
        known = np.zeros(self.at_mm.size) if self.shared_variance is None else self.shared_variance
        return np.sqrt(np.interp(s, self.at_mm, known))

    def slope_u(self, s: Float) -> Float:
        """Standard uncertainty (m,) of each component of df/ds."""
        return np.sqrt(np.interp(s, self.at_mm, self.slope_variance))


@dataclass(frozen=True, slots=True, eq=False)
class Bins:
    """Values averaged over short stretches of edge, pass by pass."""

    s: Shaped[Float, " b"]  # mean
    spread: Shaped[Float, " b"]  # standard deviation of s: the mean of a bend lies off the bend
    y: Shaped[Float, "b d"]
    variance: Shaped[Float, " b"]  # as the stated variances say
    group: Shaped[Int, " b"]
    kept: Shaped[Bool, " n"]  # False: outliers, and what was not finite
    frame_factor: float  # NaN: most bins hold one value, and tell no scatter
    vector: bool = True  # of values (n, d)


def fit_course(
    s: Float,
    y: Float,
    variance: Shaped[Float, " n"] | None = None,
    group: Shaped[Int, " n"] | None = None,
    orders: tuple[int, int] = (1, 2),
    stiffness: tuple[Float, ...] | None = None,
    unseen: tuple[float, float] = (0.0, 1.0),
    shared: Shared = ALONE,
) -> Course:
    """The smooth course of values y (n,) or (n, d) at arc lengths s (n,) mm, in any order; NaN is left out.

    Args:
        s: arc lengths, mm.
        y: values; components of a vector share stiffness and noise.
        variance: (n,) stated variance of each value; None: unknown and equal. What the bins scatter more is added.
        group: (n,) pass of each value: noise is taken from neighbours in one pass.
        orders: derivatives that walk randomly; (1, 2): constant but for waves; (2, 3): straight but for these.
        unseen: by how much the course may move, over how many mm, without the values showing it.
        stiffness: that of an earlier course through the same values, which saves the search.
        shared: what values share beside their noise.

    Example:
        >>> s = np.linspace(0.0, 100.0, 400)
        >>> course = fit_course(s, 2.0 + 0.01 * s)
        >>> bool(abs(course.value(np.array([50.0]))[0] - 2.5) < 1e-3)
        True
    """
    bin_mm, stated = shared.over_mm or BIN_MM, variance is not None
    if shared.processes:  # whose equations are full
        bin_mm = max(bin_mm, float(np.nanmax(s) - np.nanmin(s)) / MOST_BINS)
    values = _as_values(s, y, variance, group, bin_mm)
    kept = _inliers(values, shared.resolution)
    bins = _means(values, kept)
    course = _fit(values, bins, stated, orders, stiffness, unseen, bin_mm, shared)
    for _ in range(READMITTED):  # what leaves the course itself, not the first look at it, is an outlier
        before, kept, held = kept, _near(course, values, kept, shared.resolution), True
        if orders[0] > 1:
            ends = _ends_of(values, kept)
            kept |= ends
            held = not (ends & ~before).any()  # a stiffness told without the ends is not that with them
        if (kept == before).all():
            break
        bins = _means(values, kept)
        course = _fit(values, bins, stated, orders, course.stiffness if held else None, unseen, bin_mm, shared)
    course = _or_rough(course, values, bins, stated, orders, unseen, shared)
    if shared.may_step:
        course = replace(course, step_u=_step_u(values, bins, stated, orders, shared))
    return _unfollowed(course, values)


def _or_rough(
    course: Course,
    values: Values,
    bins: Bins,
    stated: bool,
    orders: tuple[int, int],
    unseen: tuple[float, float],
    shared: Shared,
) -> Course:
    """The mean of the course and those beside a roughness that neighbouring bins share, by their evidence.

    Waves as short as the shortest of a course look alike; one that has none of these follows no roughness.
    """
    if not shared.may_be_rough or course.spent * SHORTEST_BINS * BIN_MM < float(np.ptp(bins.s)):
        return course
    noise = bins.variance * course.noise_factor
    strengths = [times * math.sqrt(median(noise)) for times in ROUGH_TIMES]
    possible = [Process(one, mm, by_pass=False) for mm in ROUGH_MM for one in strengths]
    each = [_under(one, values, bins, stated, orders, None, unseen, BIN_MM) for one in possible]
    log = np.array([course.log_evidence, *(evidence for evidence, _ in each)])
    log[0] += math.log(len(possible)) - 0.5 * bins.y.shape[1] * float(np.log(noise).sum())
    share = shares(log)
    counts = np.flatnonzero(share[1:] > LEAST_SHARE)
    mean = _averaged([course, *(each[k][1]() for k in counts)], share[[0, *(counts + 1)]])
    evidence = course.log_evidence + float(np.logaddexp.reduce(log) - log[0])
    return replace(
        course,
        spline=mean.spline,
        variance=mean.variance,
        slope_variance=mean.slope_variance,
        log_evidence=evidence,
    )


def _unfollowed(course: Course, values: Values) -> Course:
    """The course, uncertain by all that successive values leave it by together, dropped or not.

    Strays are single values. Where most of LEAST_VALUES in a row lie off by more than neighbours differ and the others
    lie off, there is a notch, a step, or lost returns: nothing here tells which. They count by their weight among all
    values of their station: what one pass shows and others do not may move the course by no more.
    """
    off, weight = values.y - course.value(values.s).reshape(values.y.shape), 1.0 / values.variance
    together = np.zeros(weight.size)
    for mine in values.passes:
        if mine.stop - mine.start < LEAST_VALUES:
            continue
        own = off[mine] * np.sqrt(weight[mine])[:, None]
        each = [_neighbours(np.linalg.norm(one, axis=1), LEAST_VALUES) for one in (off[mine], own)]
        size, sure = (row_medians(one) for one in each)
        limit = max(1.0, AGREED * median(chords_mm(own)), OUTLIER_SIGMAS * median(sure) * TO_SD)
        together[mine] = size * (sure > limit)  # in their own noise: values that know little depart from little
    if not together.any():
        return course
    order, knots = np.argsort(values.s), course.spline.t
    half = 0.125 * (knots[4] - knots[3])  # of a station: more would water down a short notch
    ends = np.searchsorted(values.s[order], course.at_mm + np.array([[-half], [half]]))
    pull, total = (np.diff(np.append(0.0, np.cumsum((weight * of)[order]))[ends], axis=0)[0] for of in (together, 1.0))
    departure = _neighbours(pull / np.where(pull > 0.0, total, 1.0), 5).max(axis=-1)
    return course.doubted(departure, departure)


def _neighbours(value: AnyArray, count: int) -> Float:
    """Each of values (n,) with those around it (n, count), an odd number; shifted inwards at the ends."""
    first = np.clip(np.arange(len(value)) - count // 2, 0, max(len(value) - count, 0))
    return np.asarray(value[np.minimum(first[:, None] + np.arange(count), len(value) - 1)])


def _fit(
    values: Values,
    bins: Bins,
    stated: bool,
    orders: tuple[int, int],
    stiffness: tuple[Float, ...] | None,
    unseen: tuple[float, float],
    bin_mm: float,
    shared: Shared,
) -> Course:
    """The course on average over the processes that are possible, as over priors (eq. (4))."""
    possible = shared.possible
    known = stiffness or (None,) * len(possible)
    each = [
        _under(process, values, bins, stated, orders, held, unseen, bin_mm)[1]()
        for (process, _), held in zip(possible, known, strict=True)
    ]
    if len(each) == 1:
        return each[0]
    stiffness = tuple(one.stiffness[0] for one in each)
    return replace(_averaged(each, np.array([share for _, share in possible])), stiffness=stiffness)


def _averaged(each: Sequence[Course], share: Float) -> Course:
    """The mean of courses (k,) through the same values by their shares (k,), else as the likeliest."""
    at, spline = each[0].at_mm, each[0].spline
    spline = replace(spline, c=np.average([one.spline.c for one in each], axis=0, weights=share))
    parts = []
    for one in each:
        off = replace(spline, c=one.spline.c - spline.c)
        value, slope = ((off(at, k).reshape(at.size, -1) ** 2).mean(axis=1) for k in (0, 1))
        parts.append((one.variance + value, one.slope_variance + slope, one.shared_u(at) ** 2 + value))
    variance, slope_variance, by_shared = np.average(parts, axis=0, weights=share)
    return replace(
        each[int(np.argmax(share))],
        spline=spline,
        variance=variance,
        slope_variance=slope_variance,
        shared_variance=by_shared,
    )


def _under(
    process: Process | None,
    values: Values,
    bins: Bins,
    stated: bool,
    orders: tuple[int, int],
    stiffness: Float | None,
    unseen: tuple[float, float],
    bin_mm: float,
) -> tuple[float, Callable[[], Course]]:
    """The evidence of one process, or none, that values share; and the course under it, for when it is asked for."""
    bins, between, pass_turn = _aligned(bins, orders[0] > 1)
    noise_factor = _noise(bins, stated, orders, process)
    alone = 1.0 if stated else noise_factor  # a bin of one value scatters as the value does
    frame_factor = alone if math.isnan(bins.frame_factor) else bins.frame_factor
    weight = _weight(bins, noise_factor, process)
    knots = _knots(values.s, 2.0 * bin_mm)  # bins end before the values do, and outliers have a place
    trend = _trend(bins, weight, orders[0])  # what no prior holds back; taken off, since sums of squares lose digits
    inside = np.clip(bins.s, knots[3], knots[-4])
    together = process.covariance(bins.s, bins.spread, bins.group) if process and process.by_pass else None
    covariance: Float | LocalNoise | None = None if together is None else np.diag(1.0 / weight) + together
    if process and together is None:
        covariance = process.near(bins.s, bins.spread, 1.0 / weight, np.unique(bins.group).size)
    problems = _problems(inside, bins.y - trend(bins.s), weight, knots, orders, covariance)
    hidden = process.density(HIDDEN_MM) if process else 0.0
    grid = _grid(bins, weight, orders, unseen, hidden) if stiffness is None else stiffness[:, :3]
    scores = np.zeros(len(grid))
    for low, problem in problems.items():
        scores[grid[:, 0] == low] = problem.evidence(grid[grid[:, 0] == low, 1:])
    share = shares(scores)
    evidence = float(np.logaddexp.reduce(scores) - math.log(scores.size))
    if isinstance(covariance, LocalNoise):
        evidence -= 0.5 * bins.y.shape[1] * covariance.log_determinant
    counts = share > LEAST_SHARE
    found = np.column_stack([grid[counts], share[counts] / share[counts].sum()])

    def course() -> Course:
        y, of, each, white = bins.y, problems, weight, np.ones(weight.size)
        stations = np.linspace(knots[3], knots[-4], min(4 * (knots.size - 7), knots.size + 200))
        coefficients, value, slope, spent = _average(of, found, stations, knots)
        if orders[0] > 1:  # the mean of a bin lies off the bend
            y = y - 0.5 * bins.spread[:, None] ** 2 * Spline(knots, coefficients)(inside, 2)
            of = _problems(inside, y - trend(bins.s), weight, knots, orders, covariance)
            coefficients, value, slope, spent = _average(of, found, stations, knots)
        coefficients = coefficients + trend(knots[2:-2])  # of a straight line its values at the knots' averages
        spline = Spline(knots, coefficients if bins.vector else coefficients[:, 0])
        left = y - spline(inside).reshape(y.shape)
        by_shared = np.zeros((2, stations.size))
        if covariance is None:
            spent = float((weight * np.interp(bins.s, stations, value)).sum())
        elif isinstance(covariance, LocalNoise):
            left, each = covariance.white(left), white
        else:
            left, each = np.linalg.solve(np.linalg.cholesky(covariance), left), white
        misfit = _misfit(left, each, bins.group, spent)
        if together is not None:
            by_shared = _variance_by(together, of, found, stations)
        # Values that leave the course by more are noisier than stated: what they share is as declared.
        raised = max(1.0, misfit)
        value, slope = raised * np.stack([value, slope]) + (1.0 - raised) * by_shared
        # Errors that their values share part passes as well.
        apart = between + pass_turn.variance * (stations - pass_turn.about_mm) ** 2
        apart = np.maximum(apart - by_shared[0], 0.0)
        value += apart
        slope += np.maximum(pass_turn.variance - by_shared[1], 0.0)
        return Course(
            spline,
            stations,
            value,
            slope,
            bins.kept,
            frame_factor,
            noise_factor,
            misfit,
            evidence,
            (found,),
            shared_variance=by_shared[0],
            spent=spent,
            between=float(apart.min()),
        )

    return evidence, course


Problems: TypeAlias = Mapping[int, Penalised] | Mapping[int, Correlated]


def _problems(
    s: Float, y: Float, weight: Float, knots: Float, orders: tuple[int, int], covariance: Float | LocalNoise | None
) -> Problems:
    """The normal equations under each kind of prior, by the order of the lower derivative that it holds back.

    A place along the edge (orders above 1) is straight but for bends: it has no prior of waves. covariance (b, b): of
    values whose noise is not each their own.
    """
    plain = {orders[0]: penalised(s, y, weight, knots, orders)}
    if orders[0] == 1:
        plain[0] = penalised(s, y, weight, knots, (0, SHARPEST), True)
    if covariance is None:
        return plain
    if isinstance(covariance, LocalNoise):
        return {low: with_local_noise(one, s, y, covariance) for low, one in plain.items()}
    inverse = np.asarray(np.linalg.inv(covariance), dtype=float)
    return {low: correlated(one, s, y, inverse) for low, one in plain.items()}


def _step_u(values: Values, bins: Bins, stated: bool, orders: tuple[int, int], shared: Shared) -> float:
    """Standard uncertainty by a sudden step of the values' first component between two bins of a pass.

    An encoder that slips, returns that are lost, what prolongs a face: nothing tells which side of a step is right. By
    the posterior over a step before each bin, and none, which is held likelier by STEPLESS before; STEP: its size then.
    """
    square = 0.0
    for process in shared.processes:
        priors = _few_priors(bins, stated, orders, process)
        size, stepped, plain = _steps(values, bins, stated, orders, process, priors)
        both = np.logaddexp(np.logaddexp.reduce(stepped, axis=None), np.logaddexp.reduce(plain))
        square += process.share * float((np.exp(stepped - both) * size**2).sum())
    return math.sqrt(square / 2.0)


def _steps(
    values: Values, bins: Bins, stated: bool, orders: tuple[int, int], process: Process, strengths: Float
) -> tuple[Float, Float, Float]:
    """Sizes (j, k) of a step before each of k bins under strengths (j, 2); log-evidences with (j, k) and without (j,).

    Of the values' first component.
    """
    together = process.covariance(bins.s, bins.spread, bins.group)
    noise_factor = _noise(bins, stated, orders, process)
    weight, knots = _weight(bins, noise_factor, process), _knots(values.s, 2.0 * values.width_mm)
    s, y = np.clip(bins.s, knots[3], knots[-4]), (bins.y - _trend(bins, weight, orders[0])(bins.s))[:, :1]
    inverse = np.asarray(np.linalg.inv(np.diag(1.0 / weight) + together), dtype=float)
    problem = correlated(penalised(s, y, weight, knots, orders), s, y, inverse)
    ahead = (bins.s[:, None] >= bins.s) & (bins.group[:, None] == bins.group)
    behind = ~ahead & (bins.group[:, None] == bins.group)
    possible = np.minimum(ahead.sum(axis=0), behind.sum(axis=0)) >= LEAST_SHARED
    plain = problem.evidence(strengths)
    size, u = shape_sizes(problem, y[:, 0], ahead[:, possible].astype(float), strengths)
    most = STEP**2 + u**2
    log = 0.5 * size**2 * (1.0 / u**2 - 1.0 / most) + 0.5 * np.log(u**2 / most) + plain[:, None]
    return size, log - math.log(STEPLESS * max(int(possible.sum()), 1)), plain


def _few_priors(bins: Bins, stated: bool, orders: tuple[int, int], process: Process) -> Float:
    """Some strengths (j, 2) of all."""
    weight = _weight(bins, _noise(bins, stated, orders, process), process)
    priors = _grid(bins, weight, orders, (0.0, 1.0), process.density(HIDDEN_MM))
    return priors[priors[:, 0] == orders[0], 1:][::STEP_PRIORS]


def likely_processes(
    s: Float, y: Float, group: Int, possible: Sequence[Process], orders: tuple[int, int] = (2, 3)
) -> tuple[Process, ...]:
    """The errors that values y (n,) at s (n,) mm may share, with their shares by the likelihood under each.

    Alike likely before, about a course as `fit_course` has it. What values cannot tell from a course keeps its share.
    """
    if len(possible) == 1:
        return tuple(possible)
    values = _as_values(s, y, None, group, max(BIN_MM, float(np.nanmax(s) - np.nanmin(s)) / MOST_BINS))
    bins, score = _means(values, _inliers(values, 0.0)), []
    # The same of a course under all of them, or what one more strength is worth passes for evidence.
    priors = _few_priors(bins, False, orders, possible[0])
    for one in possible:
        _, stepped, plain = _steps(values, bins, False, orders, one, priors)
        score.append(np.logaddexp.reduce(np.append(plain, stepped)))  # a step is none of them
    share = shares(TRUSTED * np.array(score))
    share *= share > 0.1 * share.mean()  # a tenth as likely as before
    return tuple(one._replace(share=float(of)) for one, of in zip(possible, share / share.sum(), strict=True) if of)


def shares(log: Float) -> Float:
    """What each of some possibilities is likely to be, from the logarithms of their likelihoods: they add up to 1.

    Example:
        >>> shares(np.array([-1000.0, -1000.0, -np.inf])).tolist()
        [0.5, 0.5, 0.0]
    """
    share = np.exp(log - log.max())
    return np.asarray(share / share.sum())


def _variance_by(together: Float, problems: Problems, priors: Float, at: Float) -> Float:
    """What of the variances (2, k) of value and slope at `at` (k,) is by what bins (b, b) share, over all priors."""
    parts = [problem.variance_by(together, mine[:, 1:3], mine[:, 3], at) for problem, mine in _each(problems, priors)]
    return np.asarray(np.sum(parts, axis=0))


def _each(problems: Problems, priors: Float) -> Iterator[tuple[Correlated, Float]]:
    """The kinds of priors (j, 4) that have a share, and those of each."""
    for low, problem in problems.items():
        mine = priors[priors[:, 0] == low]
        if len(mine) and isinstance(problem, Correlated):
            yield problem, mine


def _average(problems: Problems, priors: Float, at: Float, knots: Float) -> tuple[Float, Float, Float, float]:
    """Mean coefficients, variances of value and slope at `at`, bins spent, over priors (j, 4) by their shares."""
    parts = []
    for low, problem in problems.items():
        mine = priors[priors[:, 0] == low]
        if len(mine):
            share = float(mine[:, 3].sum())
            parts.append((share, *problem.average(mine[:, 1:3], mine[:, 3] / share, at)))
    mean = np.asarray(sum(share * found for share, found, *_ in parts))
    value, slope = np.zeros(at.size), np.zeros(at.size)
    for share, found, value_variance, slope_variance, _ in parts:
        off = Spline(knots, found - mean)
        value += share * (value_variance + (off(at) ** 2).mean(axis=1))
        slope += share * (slope_variance + (off(at, 1) ** 2).mean(axis=1))
    return mean, value, slope, sum(share * spent for share, *_, spent in parts)


def _misfit(left: Float, weight: Float, group: Int, spent: float) -> float:
    """Mean square of the bins' residuals over their variance, pooled from each on over several lengths: the largest.

    A few pooled values know no variance: PRIOR_FREEDOM more are taken that are as they should be.
    """
    out, passes = [], 1 + int((np.diff(group) != 0).sum())
    total = np.concatenate([[0.0], np.cumsum(weight)])
    mean = np.concatenate([np.zeros((1, left.shape[1])), np.cumsum(weight[:, None] * left, axis=0)])
    for bins in POOLED:
        first = np.flatnonzero(group[: max(group.size - bins + 1, 0)] == group[bins - 1 :])
        if not first.size:
            break
        pooled = (mean[first + bins] - mean[first]) ** 2 / (total[first + bins] - total[first])[:, None]
        count = (first.size + (bins - 1) * passes) / bins  # of them that share no bin
        square, free = count * float(pooled.mean()), count - spent
        if bins == 1:
            out.append(square / max(free, 1.0))
        elif free > PRIOR_FREEDOM:
            out.append((square + PRIOR_FREEDOM) / (free + PRIOR_FREEDOM))
    return float(max(out))


@dataclass(frozen=True, slots=True, eq=False)
class Values:
    """The m of n values that are numbers, pass by pass along s, and the bins that they lie in."""

    order: Shaped[Int, " m"]  # which of the n
    count: int  # n
    s: Shaped[Float, " m"]
    y: Shaped[Float, "m d"]
    variance: Shaped[Float, " m"]
    group: Shaped[Int, " m"]
    passes: tuple[slice, ...]
    edges: Int  # (b + 1,) where bins begin, and the end
    width_mm: float  # of bins
    vector: bool  # y was given as (n, d)


def _as_values(s: Float, y: Float, variance: Float | None, group: Int | None, bin_mm: float) -> Values:
    values = np.asarray(y, dtype=float).reshape(len(s), -1)
    stated = np.ones(len(s)) if variance is None else np.asarray(variance, dtype=float)
    passes = np.zeros(len(s), np.int64) if group is None else np.asarray(group)
    seen = np.isfinite(s) & np.isfinite(values).all(axis=1) & np.isfinite(stated) & (stated > 0)
    order = np.flatnonzero(seen)
    if not order.size:
        raise ValueError("expected a finite value")
    order = order[np.argsort(s[order], kind="stable")]
    if group is not None:
        order = order[np.argsort(passes[order], kind="stable")]
    s, passes = s[order], passes[order]
    least = LEAST_BINS if bin_mm <= BIN_MM else LEAST_BINS // 4
    width = min(bin_mm, max(float(np.ptp(s)), 1e-6) / least)
    breaks = np.flatnonzero(np.diff(passes)) + 1
    begins = np.concatenate([[0], breaks, [s.size]])
    edges = np.union1d(begins, np.flatnonzero(np.diff(stretches(s, width))) + 1)
    return Values(
        order,
        seen.size,
        s,
        values[order],
        stated[order],
        passes,
        tuple(slice(int(i), int(j)) for i, j in pairwise(begins)),
        edges,
        width,
        np.ndim(y) > 1,
    )


def _near(course: Course, values: Values, kept: Bool, resolution: float) -> Bool:
    """Values (m,) within OUTLIER_SIGMAS of the course: of their pass's own scatter about it, and of its uncertainty.

    A pass of LEAST_VALUES or more may run beside the course as a whole. kept (m,): of before.
    """
    off = values.y - course.value(values.s).reshape(values.y.shape)
    for mine in values.passes:
        if kept[mine].sum() >= LEAST_VALUES:
            off[mine] -= [median(part) for part in off[mine][kept[mine]].T]
    size = np.sqrt(np.einsum("nd,nd->n", off, off) / values.variance)
    typical = np.full(size.size, median(size))
    for mine in values.passes:
        if len(values.passes) > 1 and mine.stop - mine.start >= LEAST_VALUES:
            typical[mine] = median(size[mine])
    limit = np.maximum(typical * TO_SD, _digits(values, resolution))
    limit = np.hypot(limit, course.u(values.s) / np.sqrt(values.variance))
    return np.asarray(size <= OUTLIER_SIGMAS * limit)


def _ends_of(values: Values, kept: Bool) -> Bool:
    """Values (m,) before the first or after the last that is kept, LEAST_VALUES and more: nothing says where else they
    should lie, as a place that goes straight on is no knowledge.
    """
    out = np.zeros(kept.size, bool)
    inside = values.s[kept]
    for end in (values.s < inside.min(), values.s > inside.max()):
        out |= end & (end.sum() >= LEAST_VALUES)
    return out


def _digits(values: Values, resolution: float) -> float:
    """What rounding, to digits or a resolution, may leave of values, over the least of their standard deviations."""
    rounded = max(DIGITS * float(np.abs(values.y).max()), resolution / math.sqrt(12.0))
    return rounded / math.sqrt(float(values.variance.min()))


class PassTurn(NamedTuple):
    """How passes that bend together turn against each other."""

    variance: float = 0.0  # of the slope that they have together
    about_mm: float = 0.0


def _aligned(bins: Bins, bends: bool) -> tuple[Bins, float, PassTurn]:
    """The bins with each pass's own offset taken off (they still average to 0), and the variance that this leaves.

    Passes differ by what the robot repeats within a pass and not between passes: that is no wave of the course. A place
    that `bends` (an edge) has a turn of each pass as well, where passes share most of their way. Where they share no
    part of it, such a course tells where they meet.
    """
    passes = np.unique(bins.group)
    if passes.size < 2:
        return bins, 0.0, PassTurn()
    of_pass = [np.flatnonzero(bins.group == p) for p in passes]
    width = 2.0 * max(median(np.diff(bins.s[mine])) if mine.size > 1 else 0.0 for mine in of_pass) + 1e-9
    pairs = [(i, j, *_against(bins, of_pass[i], of_pass[j], width)) for i, j in permutations(range(passes.size), 2)]
    shared = [np.concatenate([at for i, _, at, *_ in pairs if i == k]) for k in range(passes.size)]
    count = np.array([at.size for at in shared])
    seen = count >= LEAST_SHARED
    if not seen.any():
        return (*(_meeting(bins, of_pass) if bends else (bins, 0.0)), PassTurn())
    every = np.concatenate(shared)
    middle, half = 0.5 * float(every.min() + every.max()), 0.5 * float(np.ptp(every)) + 1e-9
    most = (np.ptp(at) > 0.5 * np.ptp(bins.s[mine]) for mine, at in zip(of_pass, shared, strict=True))
    terms = 2 if bends and bool((count > 2 * LEAST_SHARED).all()) and all(most) else 1
    known, side = np.zeros((passes.size, terms, passes.size, terms)), np.zeros((passes.size, terms, bins.y.shape[1]))
    weight = np.zeros(passes.size)
    for i, j, at, differ, tells in pairs:
        shape = (((at - middle) / half)[:, None] ** np.arange(terms)).T
        one = shape * tells @ shape.T
        known[i, :, i] += one
        known[j, :, j] += one
        known[i, :, j] -= one
        known[j, :, i] -= one
        side[i] += shape * tells @ differ
        side[j] -= shape * tells @ differ
        weight[i] += tells.sum()
    size = passes.size * terms
    # Differences tell no offset that all have: the least.
    found = np.linalg.lstsq(known.reshape(size, size), side.reshape(size, -1), rcond=ALL_ALIKE)[0]
    off = np.zeros((passes.size, 2, bins.y.shape[1]))
    off[:, :terms] = found.reshape(side.shape)
    off[seen] -= np.average(off[seen], axis=0, weights=weight[seen])
    off[:, 1] /= half
    off[~seen] = 0.0
    number = np.searchsorted(passes, bins.group)
    between, slope_variance = (off[seen] ** 2).mean(axis=2).sum(axis=0) / max(seen.sum() * (seen.sum() - 1), 1)
    y = bins.y - off[number, 0] - off[number, 1] * (bins.s - middle)[:, None]
    return replace(bins, y=y), float(between), PassTurn(float(slope_variance), middle)


def _against(bins: Bins, mine: Int, other: Int, width: float) -> tuple[Float, Float, Float]:
    """Where (k,) bins of a pass lie between two bins of another; by how much beside the line through these (k, d).

    And what that counts (k,): frames beside a shadow show little of a face.
    """
    after = np.searchsorted(bins.s[other], bins.s[mine]).clip(1, max(other.size - 1, 1))
    distances = [np.abs(bins.s[other[np.minimum(i, other.size - 1)]] - bins.s[mine]) for i in (after - 1, after)]
    near = np.minimum.reduce(distances) < width
    on = mine[near & (bins.s[mine] >= bins.s[other[0]]) & (bins.s[mine] <= bins.s[other[-1]])]
    both = *bins.y[other].T, bins.variance[other]
    *there, variance = (np.interp(bins.s[on], bins.s[other], of) for of in both)
    return bins.s[on], bins.y[on] - np.transpose(there), 1.0 / (bins.variance[on] + variance)


def _meeting(bins: Bins, of_pass: list[Int]) -> tuple[Bins, float]:
    """As `_aligned`, of passes (indices of their bins) one after the other, by the steps that are certain between them.

    A step of the course itself looks alike: nothing tells which, so half of it is uncertain on both sides.
    """
    order = sorted(of_pass, key=lambda mine: float(bins.s[mine[0]]))
    off = np.zeros((len(order), bins.y.shape[1]))
    for k, (before, after) in enumerate(pairwise(order), 1):
        near = np.concatenate([before[-MEETING:], after[:MEETING]])
        beyond = np.isin(near, after).astype(float)
        place = bins.s[near] - 0.5 * (bins.s[before[-1]] + bins.s[after[0]])
        shape = np.stack([beyond, np.ones(near.size), place, place**2], axis=1)
        free = near.size - shape.shape[1]
        if free < LEAST_SHARED:
            continue
        inverse = np.linalg.pinv(shape.T @ shape)
        step = inverse @ (shape.T @ bins.y[near])
        left = float(((bins.y[near] - shape @ step) ** 2).mean(axis=1).sum()) / free
        if (step[0] ** 2).mean() > SURE_STEP**2 * left * inverse[0, 0]:
            off[k:] += step[0]
    off -= off.mean(axis=0)
    between = float((off**2).mean(axis=1).sum()) / max(len(order) * (len(order) - 1), 1)
    y = bins.y.copy()
    for mine, shift in zip(order, off, strict=True):
        y[mine] -= shift
    return replace(bins, y=y), between


def stretches(s: Float, width_mm: float) -> Int:
    """Number (n,) of the stretch of edge, each `width_mm` long, that values at s (n,) mm lie in; from 0.

    The stretches meet where the fewest values are near: in the middle of the widest gap that they all leave. So a
    value's stretch depends on no digits of s, as it would if stretches met at values of a regular pitch.
    """
    about = s - float(np.mean(s))
    phase = np.sort(about / width_mm % 1.0)
    gap = np.diff(phase, append=phase[0] + 1.0)
    middle = (phase + 0.5 * gap) % 1.0
    widest = middle[gap > gap.max() - 1e-6]
    meet = widest[np.argmin((widest - TIE) % 1.0)]
    along = np.floor(about / width_mm - meet).astype(np.int64)
    return np.asarray(along - along.min())


def _inliers(values: Values, resolution: float) -> Bool:
    """Values (m,) within OUTLIER_SIGMAS of the way along the running medians of bins, in one pass.

    Components are judged together: noise of a frame may lie along one direction only. What leaves that way where the
    course bends, as at its ends, `_near` takes back.
    """
    kept = np.ones(values.s.size, bool)
    for mine in values.passes:
        if mine.stop - mine.start < LEAST_VALUES:
            continue
        edges = values.edges[(values.edges >= mine.start) & (values.edges <= mine.stop)]
        place = medians(values.s, edges)
        middle = [np.median(_neighbours(medians(part, edges), MEDIAN_BINS), axis=1) for part in values.y.T]
        about = np.stack([np.interp(values.s[mine], place, one) for one in middle], axis=1)
        size = np.linalg.norm(values.y[mine] - about, axis=1) / np.sqrt(values.variance[mine])
        kept[mine] = size <= OUTLIER_SIGMAS * max(median(size) * TO_SD, _digits(values, resolution))
    return kept


class Binned(NamedTuple):
    """Values in the order of their arc lengths, by bins."""

    edges: Shaped[Int, " e"]
    s: Shaped[Float, " m"]
    y: Shaped[Float, "m d"]
    variance: Shaped[Float, " m"]
    kept: Shaped[Bool, " m"]


class BinLines(NamedTuple):
    """The lines through the means of f bins that hold something."""

    number: Shaped[Int, " b"]  # of each bin's line
    place: Shaped[Float, " f"]
    mean: Shaped[Float, "f d"]
    slope: Shaped[Float, "f d"]


def _means(values: Values, kept: Bool) -> Bins:
    """The bins of what is kept (m,)."""
    components = values.y.shape[1]
    sums = np.zeros((values.edges.size - 1, 4 + components))
    binned = Binned(values.edges, values.s, values.y, values.variance, as_input(kept))
    _sum_up(binned, sums)
    full = sums[:, 0] > 0
    of = np.cumsum(full) - 1
    count, total, place, spread, mean = *sums[full, :4].T, sums[full, 4:]
    near = np.diff(place, prepend=-np.inf, append=np.inf)  # slope within the bin, from the bins beside it
    joined = (np.abs(near) < 3.0 * values.width_mm) & (near > 0)
    step = np.diff(mean, axis=0, prepend=np.nan, append=np.nan)
    both = np.where(joined[:, None], step, 0.0) / np.where(joined, near, 1.0)[:, None]
    slope = (both[:-1] + both[1:]) / np.maximum(joined[:-1].astype(float) + joined[1:], 1.0)[:, None]
    free = max(float((count - 1).sum()), 0.0) * components
    scatter = _scatter(binned, BinLines(as_input(of), as_input(place), as_input(mean), as_input(slope)))
    factor = scatter / free if free >= 10 else math.nan
    all_kept = np.zeros(values.count, bool)
    all_kept[values.order] = kept
    group = values.group[values.edges[:-1]][full]
    return Bins(place, np.sqrt(spread), mean, 1.0 / total, group, all_kept, factor, values.vector)


@kernel
def _sum_up(binned: Binned, out: Float) -> None:
    """Fill `out` (b, 4 + d): count, weight, mean and variance of s, means of y of each bin."""
    edges, s, y, variance, kept = binned
    for b in range(out.shape[0]):
        for m in range(edges[b], edges[b + 1]):
            if kept[m]:
                weight = 1.0 / variance[m]
                out[b, 0] += 1.0
                out[b, 1] += weight
                share = weight / out[b, 1]
                ahead = s[m] - out[b, 2]
                out[b, 2] += share * ahead
                out[b, 3] += share * ((1.0 - share) * ahead * ahead - out[b, 3])
                for d in range(y.shape[1]):
                    out[b, 4 + d] += share * (y[m, d] - out[b, 4 + d])


@kernel
def _scatter(binned: Binned, lines: BinLines) -> float:
    """Sum of squares of what is kept about the line of its bin, over the variances."""
    edges, s, y, variance, kept = binned
    number, place, mean, slope = lines
    total = 0.0
    for b in range(edges.size - 1):
        i = number[b]
        for m in range(edges[b], edges[b + 1]):
            if kept[m]:
                for d in range(y.shape[1]):
                    total += (y[m, d] - mean[i, d] - slope[i, d] * (s[m] - place[i])) ** 2 / variance[m]
    return total


def _weight(bins: Bins, noise_factor: float, process: Process | None) -> Float:
    return 1.0 / (bins.variance * noise_factor + (process.least_variance if process else 0.0))


def _noise(bins: Bins, stated: bool, orders: tuple[int, int], process: Process | None) -> float:
    """The factor of the bins' own variances, beside what they share."""
    return max(_noise_factor(bins, stated, min(orders), process), float(stated))


def _noise_factor(bins: Bins, stated: bool, order: int, process: Process | None) -> float:
    """Variance of the bins' means over the stated one, from what each differs from its neighbours (eq. (2)).

    From their line, where a course is constant but for waves (order 1), from the cubic of four where it is straight but
    for bends (order 2): these are no noise.
    """
    reach = order
    factor = 1.0 if math.isnan(bins.frame_factor) else bins.frame_factor
    known = max(1.0, factor) if stated else factor
    gap = np.diff(bins.s)
    widest = 2.5 * median(gap[gap > 0]) if (gap > 0).any() else 0.0
    run = np.concatenate([[0], np.cumsum((np.diff(bins.group) != 0) | (gap <= 0) | (gap > widest))])
    k = np.arange(reach, bins.s.size - reach)
    k = k[run[k - reach] == run[k + reach]]
    if k.size < 4:
        return _noise_factor(bins, stated, 1, process) if order > 1 else max(known, LEAST_FACTOR)
    offsets = np.concatenate([np.arange(-reach, 0), np.arange(1, reach + 1)])
    at = bins.s[k[:, None] + offsets] - bins.s[k][:, None]
    share = np.stack(
        [
            np.prod([at[:, i] / (at[:, i] - at[:, j]) for i in range(2 * reach) if i != j], axis=0)
            for j in range(2 * reach)
        ],
        axis=1,
    )
    off = bins.y[k] - np.einsum("kj,kjd->kd", share, bins.y[k[:, None] + offsets])
    expected = bins.variance[k] + (share**2 * bins.variance[k[:, None] + offsets]).sum(axis=1)
    z2 = (off**2).mean(axis=1) / expected  # of all components: the frame that they are given in does not matter
    found = _bounded_mean(z2)
    if process:
        row, column = np.concatenate([np.ones((k.size, 1)), -share], axis=1), k[:, None] + np.append(0, offsets)
        together = process.covariance(bins.s[column], bins.spread[column], bins.group[column])
        alike = np.einsum("ki,kij,kj->k", row, together, row) / expected
        least = LEAST_OWN * found  # or no digits are left
        for _ in range(RESETTLED):  # what is left beside what they share
            found *= _bounded_mean(z2 / (found + alike))
        found = max(found, least)
    free = k.size * off.shape[1] / 2.0  # neighbours share values
    prior = PRIOR_FREEDOM if stated else 0.0
    return float(max((free * found + prior * known) / (free + prior), LEAST_FACTOR))


def _bounded_mean(z2: Float) -> float:
    """Mean of squares (k,), each counted as nine times the typical one at most."""
    return float(np.minimum(z2, 9.0 * median(z2) / 0.4549).mean())


def _knots(s: Float, knots_mm: float) -> Float:
    first, last = float(s.min()), float(s.max())
    last = max(last, first + 1e-3)
    pieces = max(LEAST_PIECES, math.ceil((last - first) / knots_mm))
    step = (last - first) / pieces
    return np.asarray(first + step * np.arange(-3, pieces + 4))


def _trend(bins: Bins, weight: Float, order: int) -> Callable[[Float], Float]:
    """The least-squares constant (order 1) or straight line (order 2) through the bins."""
    middle = float(np.average(bins.s, weights=weight))
    mean = np.average(bins.y, axis=0, weights=weight)
    off = bins.s - middle
    spread = float((weight * off**2).sum())
    slope = (weight * off) @ (bins.y - mean) / spread if order > 1 and spread > 0 else np.zeros(mean.size)
    return lambda s: np.asarray(mean + (s - middle)[:, None] * slope)


def _grid(bins: Bins, weight: Float, orders: tuple[int, int], unseen: tuple[float, float], shared: float) -> Float:
    """Priors (j, 3) to choose from: the lower derivative's order, and the strengths of what is held back.

    A walk of order d with strength q takes a course about q^(1/2) length^(d - 1/2) away over a length: from a tenth of
    what all bins together resolve to ten times their spread. Waves that are alike high down to a length have the
    density q k^(2d) at its wave number k, from what is hidden to ten times their spread. shared: density of what the
    bins share.
    """
    low, high = orders
    way = max(float(np.ptp(bins.s)), 1e-3)
    density = way / float(weight.sum()) + shared  # of the noise: variance times length
    least = 0.1 * math.sqrt(density / way)
    most = 10.0 * max(math.sqrt(float(bins.y.var(axis=0).sum())), least)
    length = min(way, STIFFEST_MM)
    hidden = HIDDEN**2 * density / HIDDEN_MM  # what HIDDEN_MM of edge cannot tell
    mm = min(HIDDEN_MM, length)
    if unseen[0] ** 2 > hidden:
        hidden, mm = unseen[0] ** 2, min(unseen[1], length)
    least_one = hidden / mm ** (2 * low - 1)
    shortest_mm = HIDDEN_MM if shared else length  # what a process may do as well, the course must be free to do
    one = np.geomspace(
        least_one, max(most**2 / min(shortest_mm, length) ** (2 * low - 1), 10.0 * least_one), STIFFNESSES
    )
    least_two = least_one / mm ** (2 * (high - low))
    most_two = most**2 / (2.0 * BIN_MM) ** (2 * high - 1)
    two = np.geomspace(least_two, max(most_two, 10.0 * least_two), 2 * STIFFNESSES)
    walks = np.column_stack([np.full(one.size * two.size, low), np.repeat(one, two.size), np.tile(two, one.size)])
    if low > 1 or bins.s.size < LEAST_WAVE_BINS:
        return walks
    shortest, grid = SHORTEST_BINS * BIN_MM, [walks]
    for wave in np.geomspace(shortest, max(length, 2.0 * shortest), CUTS):
        k, least_flat = 2.0 * math.pi / wave, 0.5 * hidden * mm
        q = np.geomspace(least_flat, max(most**2 * wave, 30.0 * least_flat), STIFFNESSES)
        grid.append(np.column_stack([np.full(q.size, low - 1), q * k ** (2 * low - 2), q * k ** (2 * SHARPEST)]))
    return np.concatenate(grid)
