"""Errors and uncertainties of root face or bevel angle over the parts of a condition."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from bench.metrology.part_result import PartResult
from workbench.units import Bool

COVERAGE = (0.93, 0.97)  # of |error| <= 2u
MOST_U_OVER_BOUND = 3.0
RESAMPLES = 2000


@dataclass(frozen=True, slots=True)
class Quantity:
    """Root face (mm) or bevel angle (deg) over the parts of a condition."""

    p95: float  # over parts, of the greatest |error| over the sections
    median: float
    bias: float  # mean error, sign kept
    bias_u: float  # its standard uncertainty, from the scatter of the parts' means
    coverage: float  # share of sections with |error| <= 2u
    coverage_low: float  # 95 % interval, by resampling parts
    coverage_high: float
    mean_u: float
    bound_p95: float  # over parts, of the greatest bound of the sections
    u_over_bound: float  # mean over sections
    u_over_bound_p95: float  # 95th percentile of the sections
    goal: float

    @property
    def accurate(self) -> bool:
        return self.p95 <= self.goal

    @property
    def covered(self) -> bool:
        return COVERAGE[0] <= self.coverage <= COVERAGE[1]

    @property
    def surely_not_covered(self) -> bool:
        """Even the interval that the number of parts leaves open lies outside."""
        return self.coverage_high < COVERAGE[0] or self.coverage_low > COVERAGE[1]

    @property
    def sharp(self) -> bool:
        return self.u_over_bound <= MOST_U_OVER_BOUND


def quantity(results: list[PartResult], name: str, unit: str, goal: float) -> Quantity:
    """Errors, coverage and uncertainties of `root` in `mm` or `bevel` in `deg`."""
    value, true, u, bound = (
        [np.array(getattr(r, f"{name}{what}_{unit}"), dtype=float) for r in results]
        for what in ("", "_true", "_u", "_bound")
    )
    signed = [v - t for v, t in zip(value, true, strict=True)]
    error = [np.abs(e) for e in signed]
    means = np.array([np.nanmean(e) for e in signed if np.isfinite(e).any()])
    worst = np.array([greatest_error(r, name, unit) for r in results])
    inside = [(e <= 2 * w)[np.isfinite(e)] for e, w in zip(error, u, strict=True)]
    low, high = coverage_interval(inside)
    unseen = [r.root_unseen_u_mm if name == "root" else 0.0 for r in results]  # the bound is that of noise alone
    noise = [np.sqrt(np.maximum(w**2 - v**2, 0.0)) for w, v in zip(u, unseen, strict=True)]
    ratio = np.concatenate(noise) / np.concatenate(bound)
    ratio = ratio[np.isfinite(ratio) & (ratio > 0)]
    return Quantity(
        p95=percentile(worst, 95),
        median=percentile(worst, 50),
        bias=float(means.mean()) if len(means) else float("nan"),
        bias_u=float(means.std() / max(1, len(means) - 1) ** 0.5) if len(means) else float("nan"),
        coverage=float(np.concatenate(inside).mean()) if inside else float("nan"),
        coverage_low=low,
        coverage_high=high,
        mean_u=float(np.nanmean(np.concatenate(u))) if u else float("nan"),
        bound_p95=percentile([np.nanmax(b) for b in bound if np.isfinite(b).any()], 95),
        u_over_bound=float(ratio.mean()) if len(ratio) else float("nan"),
        u_over_bound_p95=percentile(ratio, 95),
        goal=goal,
    )


def coverage_interval(inside: list[Bool]) -> tuple[float, float]:
    """95 % interval of the pooled share: parts are resampled whole, since the sections of one share their errors."""
    if not inside:
        return float("nan"), float("nan")
    hits, counts = np.array([i.sum() for i in inside]), np.array([len(i) for i in inside])
    chosen = np.random.default_rng(0).integers(0, len(inside), (RESAMPLES, len(inside)))
    shares = hits[chosen].sum(axis=1) / np.maximum(counts[chosen].sum(axis=1), 1)
    return percentile(shares, 2.5), percentile(shares, 97.5)


def greatest_error(r: PartResult, name: str, unit: str) -> float:
    """Over the sections; 0 if none was measured."""
    value, true = (np.array(getattr(r, f"{name}{what}_{unit}"), dtype=float) for what in ("", "_true"))
    return float(np.nanmax(np.abs(value - true), initial=0.0))


def greatest_ratio(r: PartResult, name: str, unit: str) -> float:
    """Of error over u, over the sections; 0 if none was measured."""
    value, true, u = (np.array(getattr(r, f"{name}{what}_{unit}"), dtype=float) for what in ("", "_true", "_u"))
    return float(np.nanmax(np.abs(value - true) / u, initial=0.0))


def percentile(values: Any, at: float) -> float:
    """NaN of nothing."""
    return (
        float(np.percentile(values, at, method="lower" if np.isinf(values).any() else "linear"))
        if len(values)
        else float("nan")
    )
