"""Analysis of variance of a crossed gauge study: parts x operators x trials, all random, equally many trials a cell."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy

from workbench.units import Float


@dataclass(frozen=True, slots=True)
class Source:
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


@dataclass(frozen=True, slots=True)
class Anova:
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
