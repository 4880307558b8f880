"""Shares with their interval, and percentiles, over the parts of a condition."""

from __future__ import annotations

from typing import Any

import numpy as np

from workbench.units import Bool

COVERAGE = (0.93, 0.97)  # of |error| <= 2u
RESAMPLES = 2000


def coverage_interval(inside: list[Bool]) -> tuple[float, float]:
    """95 % interval of the pooled share: parts are resampled whole, since the sections of one share their errors."""
    if not inside:
        return float("nan"), float("nan")
    hits, counts = np.array([i.sum() for i in inside]), np.array([len(i) for i in inside])
    chosen = np.random.default_rng(0).integers(0, len(inside), (RESAMPLES, len(inside)))
    shares = hits[chosen].sum(axis=1) / np.maximum(counts[chosen].sum(axis=1), 1)
    return percentile(shares, 2.5), percentile(shares, 97.5)


def percentile(values: Any, at: float) -> float:
    """NaN of nothing."""
    return (
        float(np.percentile(values, at, method="lower" if np.isinf(values).any() else "linear"))
        if len(values)
        else float("nan")
    )
