"""Gauge repeatability and reproducibility out of an analysis of variance, with confidence intervals.

Names of AIAG's Measurement Systems Analysis (4th ed. 2010): EV repeatability, AV reproducibility, GRR both, PV part
variation, TV total, %GRR, ndc.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from workbench.compare.anova import Anova, Source
from workbench.units import Float

SPREAD = 6.0  # standard deviations that count as the range of a variation (AIAG)
CATEGORIES = 1.41  # of PV / GRR: data categories that can be told apart (AIAG)
DRAWS = 20_000
NAMES = ("EV", "AV", "GRR", "PV", "TV")


@dataclass(frozen=True, slots=True)
class Component:
    """A part of the variation: standard deviation and its 95 % interval, in the unit of the values; None: not shown."""

    name: str
    sd: float | None
    interval: tuple[float, float] | None
    contribution_percent: float | None  # of the total variance
    study_percent: float | None  # of the total standard deviation: AIAG's %EV, %AV, %GRR, %PV
    tolerance_percent: float | None  # SPREAD * sd over the width of the tolerance


@dataclass(frozen=True, slots=True)
class Gauge:
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
    return Gauge(tuple(rows), _categories(float(found["PV"]), float(found["GRR"])))


def _categories(part: float, grr: float) -> int | None:
    return max(1, int(CATEGORIES * part / grr)) if grr > 0 and not np.isnan(part) else None


def _standard_deviations(anova: Anova, mean: Mapping[str, Float]) -> dict[str, Float]:
    """Of EV, AV, GRR, PV, TV, for mean squares of any one shape; NaN where the study has one level only."""
    p, o, r = anova.parts, anova.operators, anova.trials
    error = mean["repeatability"]
    against = error if anova.pooled else mean["part x operator"]
    both = _positive(against - error) / r
    operator = _positive(mean["operator"] - against) / (p * r)
    part = _positive(mean["part"] - against) / (o * r) if p > 1 else np.full_like(error, np.nan)
    reproducibility = operator + both if o > 1 else np.full_like(error, np.nan)
    grr = error + np.nan_to_num(reproducibility)
    variances = (error, reproducibility, grr, part, grr + np.nan_to_num(part))
    return {name: np.sqrt(variance) for name, variance in zip(NAMES, variances, strict=True)}


def _positive(variance: Float) -> Float:
    """A variance is none below zero: the effect is smaller than the study can show."""
    return np.maximum(variance, 0.0)


def _draws(anova: Anova) -> dict[str, Float]:
    """Expectations of the mean squares as the study knows them; the same draws for every study."""
    rng = np.random.default_rng(20260101)

    def draw(row: Source) -> Float:
        if not row.freedom:
            return np.zeros(DRAWS)
        return np.asarray(row.mean_square * row.known_as / rng.chisquare(row.known_as, DRAWS))

    return {row.name: draw(row) for row in anova.sources}
