"""Figures over the parts of a condition: errors beside their goal, and how often the uncertainty covers them."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

from bench.metrology.quantity import COVERAGE, coverage_interval, percentile

LEAST_PARTS = 10  # with fewer, resampling parts says nothing about the interval


@dataclass(frozen=True, slots=True)
class Spread:
    """One value a part over the parts. NaN: no part has it."""

    median: float
    p95: float
    worst: float
    goal: float | None = None  # greatest value that is good; None: there is none

    @property
    def met(self) -> bool:
        """Every part reaches the goal."""
        return self.goal is None or bool(self.worst <= self.goal)


def spread(values: Iterable[float | None], goal: float | None = None) -> Spread:
    """Of all that are not None."""
    known = np.array([v for v in values if v is not None], dtype=float)
    return Spread(percentile(known, 50), percentile(known, 95), percentile(known, 100), goal)


@dataclass(frozen=True, slots=True)
class Cover:
    """Errors beside their standard uncertainties, pooled over all places of all parts."""

    parts: int
    share: float  # with |error| <= 2u
    low: float  # 95 % interval of it, by resampling parts
    high: float
    bias: float  # mean error
    rms: float
    mean_u: float

    @property
    def surely_not_covered(self) -> bool:
        """Even the interval that the number of parts leaves open lies outside the goal."""
        return self.parts >= LEAST_PARTS and (self.high < COVERAGE[0] or self.low > COVERAGE[1])


def cover(pairs: Iterable[tuple[Any, Any]]) -> Cover:
    """Of (errors, uncertainties) of each part; None and NaN: not measured."""
    known = []
    for e, u in pairs:
        both = np.broadcast_arrays(np.array(e, dtype=float), np.array(u, dtype=float))
        good = np.isfinite(both[0]) & np.isfinite(both[1])
        if good.any():
            known.append((both[0][good], both[1][good]))
    if not known:
        return Cover(0, *[float("nan")] * 6)
    inside = [np.abs(e) <= 2 * u for e, u in known]
    error, u = (np.concatenate(values) for values in zip(*known, strict=True))
    low, high = coverage_interval(inside)
    rms = float(np.sqrt(np.mean(error**2)))
    return Cover(len(known), float(np.concatenate(inside).mean()), low, high, float(error.mean()), rms, float(u.mean()))
