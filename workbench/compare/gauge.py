"""Gauge studies: analysis of variance, repeatability and reproducibility, agreement with a reference.

Names of AIAG's Measurement Systems Analysis (4th ed. 2010): EV repeatability, AV reproducibility, GRR both, PV part
variation, TV total, %GRR, ndc.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import scipy

from workbench.compare.measurements import Study, title_of
from workbench.errors import InputError
from workbench.units import COVERAGE, Float, Int, Shaped

CLEAR = 0.1  # of the squares of an operator's differences, what another order leaves of them if it is the right one


class Source(NamedTuple):
    """A row of the table, mean of the sections. NaN: the study has one level of it, or nothing to compare it with."""

    name: str
    sum_of_squares: float
    freedom: int  # of one section
    f: float  # against the interaction, or the repeatability where that is pooled
    p: float
    known_as: float  # degrees of freedom that the mean square is as well known as: more where sections are independent

    @property
    def mean_square(self) -> float:
        """Sum of squares over degrees of freedom; 0 where there are none."""
        return self.sum_of_squares / self.freedom if self.freedom else 0.0


class Anova(NamedTuple):
    """The table and the sizes of the study."""

    parts: int
    operators: int
    trials: int
    part: Source
    operator: Source
    interaction: Source  # as tested, before pooling
    repeatability: Source  # with the interaction in it where `pooled`
    pooled: bool
    correlation: float  # of the repeatability's errors between sections of one recording, 0 to 1

    @property
    def sources(self) -> tuple[Source, ...]:
        """The rows of the table."""
        return self.part, self.operator, self.interaction, self.repeatability


def analyse(values: Float, interaction_alpha: float) -> Anova:
    """The table of values (parts, operators, trials, sections): every section by itself, sums of squares averaged.

    Where the interaction is not significant at `interaction_alpha`, it is pooled with the repeatability (AIAG,
    Measurement Systems Analysis, 4th ed. 2010, appendix A; Montgomery and Runger, Quality Engineering 6, 1993, 289).
    Sections of one recording share errors. So they do not multiply the degrees of freedom of parts and operators, and
    those of the repeatability only as far as the errors are seen to be independent (Satterthwaite).
    """
    p, o, r, s = values.shape
    grand, cell = values.mean(axis=(0, 1, 2)), values.mean(axis=2)
    by_part, by_operator = cell.mean(axis=1), cell.mean(axis=0)
    error = values - cell[:, :, None]
    correlation = _correlation(error.reshape(-1, s))
    part = o * r * float(((by_part - grand) ** 2).sum()) / s, p - 1
    operator = p * r * float(((by_operator - grand) ** 2).sum()) / s, o - 1
    both = r * float(((cell - by_part[:, None] - by_operator + grand) ** 2).sum()) / s, (p - 1) * (o - 1)
    within = float((error**2).sum()) / s, p * o * (r - 1)
    interaction = _row("part x operator", both, within)
    pooled = not (interaction.p <= interaction_alpha)
    rest = (within[0] + both[0], within[1] + both[1]) if pooled else within
    against = rest if pooled else both
    known_as = rest[1] * s / (1.0 + (s - 1) * correlation**2)
    repeatability = Source("repeatability", *rest, np.nan, np.nan, known_as)
    return Anova(
        p,
        o,
        r,
        _row("part", part, against),
        _row("operator", operator, against),
        interaction,
        repeatability,
        pooled,
        correlation,
    )


def _row(name: str, of: tuple[float, int], against: tuple[float, int]) -> Source:
    """A row with its F test; no test without degrees of freedom or where nothing varies."""
    (square, freedom), (other, other_freedom) = of, against
    if not freedom or not other_freedom or other <= 0:
        return Source(name, square, freedom, np.nan, np.nan, freedom)
    f = (square / freedom) / (other / other_freedom)
    return Source(name, square, freedom, f, float(scipy.special.fdtrc(freedom, other_freedom, f)), freedom)


def _correlation(error: Float) -> float:
    """Mean correlation between the columns of errors (n, S) about the mean of their cell; not below 0."""
    s, total = error.shape[1], float((error**2).sum())
    if s == 1 or total == 0:
        return 0.0
    return float(np.clip(((error.sum(axis=1) ** 2).sum() - total) / ((s - 1) * total), 0.0, 1.0))


SPREAD = 6.0  # standard deviations that count as the range of a variation (AIAG)
CATEGORIES = 1.41  # of PV / GRR: data categories that can be told apart (AIAG)
DRAWS = 20_000
NAMES = ("EV", "AV", "GRR", "PV", "TV")


class Component(NamedTuple):
    """A part of the variation: standard deviation and its 95 % interval, in the unit of the values; None: not shown."""

    name: str
    sd: float | None
    interval: tuple[float, float] | None
    contribution_percent: float | None  # of the total variance
    study_percent: float | None  # of the total standard deviation: AIAG's %EV, %AV, %GRR, %PV
    tolerance_percent: float | None  # SPREAD * sd over the width of the tolerance


class Gauge(NamedTuple):
    """What a study says about the measuring system."""

    components: tuple[Component, ...]
    categories: int | None  # ndc, AIAG: cut to a whole number, 5 or more are wanted; None: no part variation to tell

    def of(self, name: str) -> Component:
        """One of NAMES."""
        return self.components[NAMES.index(name)]


def gauge(anova: Anova, tolerance_width: float | None) -> Gauge:
    """Components of variance of a study, all effects random.

    Intervals are generalised confidence intervals: each mean square's expectation is drawn as its sum of squares over
    a chi-square (Hamada and Weerahandi, J. Quality Technology 32, 2000; Burdick, Borror and Montgomery, "Design and
    Analysis of Gauge R&R Studies", SIAM 2005). With two or three operators that of AV is wide: it knows no better.
    """
    found = _standard_deviations(anova, {row.name: np.array(row.mean_square) for row in anova.sources})
    drawn = _standard_deviations(anova, _draws(anova))
    total = float(found["TV"])
    rows = []
    for name in NAMES:
        if np.isnan(found[name]):
            rows.append(Component(name, None, None, None, None, None))
            continue
        sd, (low, high) = float(found[name]), np.percentile(drawn[name], [2.5, 97.5])
        share = sd / total if total > 0 and not np.isnan(found["PV"]) else None
        rows.append(
            Component(
                name,
                sd,
                (float(low), float(high)),
                None if share is None else 100 * share**2,
                None if share is None else 100 * share,
                None if tolerance_width is None else 100 * SPREAD * sd / tolerance_width,
            )
        )
    part, grr = float(found["PV"]), float(found["GRR"])
    return Gauge(tuple(rows), max(1, int(CATEGORIES * part / grr)) if grr > 0 and not np.isnan(part) else None)


def _standard_deviations(anova: Anova, mean: Mapping[str, Float]) -> dict[str, Float]:
    """Of EV, AV, GRR, PV, TV, for mean squares of any one shape; NaN where the study has one level only."""
    p, o, r = anova.parts, anova.operators, anova.trials
    error = mean["repeatability"]
    against = error if anova.pooled else mean["part x operator"]
    # A variance is none below zero: the effect is smaller than the study can show.
    both = np.maximum(against - error, 0.0) / r
    operator = np.maximum(mean["operator"] - against, 0.0) / (p * r)
    part = np.maximum(mean["part"] - against, 0.0) / (o * r) if p > 1 else np.full_like(error, np.nan)
    reproducibility = operator + both if o > 1 else np.full_like(error, np.nan)
    grr = error + np.nan_to_num(reproducibility)
    variances = (error, reproducibility, grr, part, grr + np.nan_to_num(part))
    return {name: np.sqrt(variance) for name, variance in zip(NAMES, variances, strict=True)}


def _draws(anova: Anova) -> dict[str, Float]:
    """Expectations of the mean squares as the study knows them; the same draws for every study."""
    rng = np.random.default_rng(20260101)

    def draw(row: Source) -> Float:
        if not row.freedom:
            return np.zeros(DRAWS)
        return np.asarray(row.mean_square * row.known_as / rng.chisquare(row.known_as, DRAWS))

    return {row.name: draw(row) for row in anova.sources}


class Agreement(NamedTuple):
    """P parts, O operators, R trials, S sections; NaN where there is no reference or no stated uncertainty."""

    bias: Shaped[Float, "P S"]  # mean of all measurements less the reference
    bias_u: Shaped[Float, "P S"]
    e_n: Shaped[Float, "P O R S"]  # |E_n| <= 1: the difference is within what both sides state
    observed_over_stated: float  # repeatability over the RMS of the stated uncertainties

    @property
    def has_reference(self) -> bool:
        """Whether any section has a reference."""
        return bool(np.isfinite(self.bias).any())

    @property
    def significant(self) -> int:
        """How many of the biases are larger than their expanded uncertainty."""
        return int((np.abs(self.bias) > COVERAGE * self.bias_u).sum())


def agreement(study: Study, name: str, gauge: Gauge) -> Agreement:
    """Bias and E_n of one characteristic.

    The mean of O operators and R trials has the variance AV^2 / O + EV^2 / (O R), to which the reference adds its own.
    E_n = (x - X) / sqrt(U_x^2 + U_X^2) with expanded uncertainties (ISO 13528:2022, 9.7; ISO/IEC 17043:2023, annex B).
    """
    values, reference, reference_u = study.measured[name], study.reference[name], study.reference_u[name]
    _, o, r, _ = values.shape
    ev, av = (gauge.of(one).sd or 0.0 for one in ("EV", "AV"))
    mean_u = math.sqrt(av**2 / o + ev**2 / (o * r))
    stated = study.stated_u[name]
    both = COVERAGE * np.sqrt(stated**2 + reference_u[:, None, None] ** 2)
    with np.errstate(divide="ignore", invalid="ignore"):
        e_n = (values - reference[:, None, None]) / both
    rms = math.sqrt(float(np.nanmean(stated**2))) if np.isfinite(stated).any() else math.nan
    return Agreement(
        values.mean(axis=(1, 2)) - reference,
        np.hypot(mean_u, reference_u),
        np.where(np.isfinite(e_n), e_n, np.nan),
        ev / rms if rms > 0 else math.nan,
    )


@dataclass(frozen=True, slots=True)
class SectionGauge:
    """One section: its place, mean value and the gauge there."""

    index: int
    arc_length_mm: float
    mean: float
    gauge: Gauge


class Characteristic(NamedTuple):
    """What was found of one characteristic."""

    name: str
    limits: tuple[float, float] | None
    anova: Anova
    gauge: Gauge  # all sections
    sections: tuple[SectionGauge, ...]
    agreement: Agreement
    warnings: tuple[str, ...]

    @property
    def title(self) -> str:
        """Its name for a reader."""
        return title_of(self.name)


def confused(values: Float, study: Study, name: str) -> tuple[str, ...]:
    """Operators whose values (parts, operators, trials, sections) agree with the others' in another order only."""
    cell, told = values.mean(axis=2), []
    for o, who in enumerate(study.operators):
        mine, others = cell[:, o] - cell[:, o].mean(), np.delete(cell, o, axis=1).mean(axis=1)
        others = others - others.mean()
        level = mine - mine.mean(axis=0) + others.mean(axis=0)  # less what the operator errs in each section
        apart = ((level[:, None] - others) ** 2).sum(axis=2)
        taken = scipy.optimize.linear_sum_assignment(apart)[1]
        swapped = [f"{study.parts[k]} as {study.parts[p]}" for k, p in enumerate(taken) if p != k]
        if apart[np.arange(len(taken)), taken].sum() < CLEAR * np.trace(apart):
            told.append(
                f"{title_of(name).lower()}: by the others' values {who} measured {', '.join(swapped)}: confused?"
            )
        elif ((mine[:, ::-1] - others) ** 2).sum() < CLEAR * ((mine - others) ** 2).sum():
            told.append(f"{title_of(name).lower()}: the sections of {who} run the other way than the others'")
    return tuple(told)


def seen_everywhere(study: Study, name: str) -> tuple[Int, tuple[str, ...]]:
    """Positions of the sections where every recording has a value, and a word on those left out."""
    seen = np.isfinite(study.measured[name]).all(axis=(0, 1, 2))
    if not seen.any():
        raise InputError(
            f"compare.repeatability: {title_of(name).lower()}",
            "expected a section in which every recording has a value, found none",
        )
    out = [str(study.section[k]) for k in np.flatnonzero(~seen)]
    words = (
        () if not out else (f"{title_of(name).lower()}: section {', '.join(out)} left out: hidden in some recording",)
    )
    return np.flatnonzero(seen), words
