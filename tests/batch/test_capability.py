"""Capability: a published example, and intervals that cover what they say over simulated processes."""

import math

import numpy as np
import pytest

from workbench.batch.control import capability, line


def series(n: int, mean: float, s: float) -> np.ndarray:
    """n values with exactly this mean and standard deviation."""
    raw = np.linspace(-1.0, 1.0, n)
    return mean + s * raw / raw.std(ddof=1)


def test_montgomerys_example() -> None:
    """Introduction to Statistical Quality Control, chapter 8.3.4: n = 20, s = 1.75, limits 38 and 62."""
    found = capability(series(20, 50.0, 1.75), np.zeros(20), 38.0, 62.0)
    assert found.cp == pytest.approx(2.29, abs=0.005)
    assert found.cp_interval == pytest.approx((1.57, 3.01), abs=0.01)
    assert found.cpk == pytest.approx(found.cp)


def test_what_measurement_adds_to_the_spread() -> None:
    found = capability(series(50, 1.6, 0.05), np.full(50, 0.03), 1.0, 2.0)
    assert (found.s, found.u, found.s_part) == pytest.approx((0.05, 0.03, 0.04))
    assert found.cpk == pytest.approx(0.4 / 0.15)
    assert capability(series(50, 1.6, 0.02), np.full(50, 0.03), 1.0, 2.0).s_part == 0.0
    assert capability(np.full(36, 40.2), np.zeros(36), 39.0, 41.0).s == 0.0  # whatever rounding its mean has


def test_parts_spread_is_found_under_noise() -> None:
    rng = np.random.default_rng(6)
    u = rng.uniform(0.02, 0.06, 4000)
    found = capability(rng.normal(1.5, 0.05, 4000) + u * rng.normal(size=4000), u, 1.0, 2.0)
    assert found.s_part == pytest.approx(0.05, rel=0.05)


def test_intervals_cover() -> None:
    rng = np.random.default_rng(7)
    runs, n, slope = 1500, 30, 0.02
    hits = np.zeros(4)
    for _ in range(runs):
        noise = rng.normal(0.5, 1.0, n)
        found = capability(noise, np.zeros(n), -4.0, 4.0)
        _, ends = line(np.arange(n, dtype=float), noise + slope * np.arange(n))
        for k, ((low, high), truth) in enumerate(
            [(found.s_interval, 1.0), (found.cp_interval, 8 / 6), (found.cpk_interval, 3.5 / 3), (ends, slope)]
        ):
            hits[k] += low <= truth <= high
    assert np.all(np.abs(hits / runs - 0.95) < 0.02), hits / runs


@pytest.mark.parametrize("values", [[], [1.5], [1.5, 1.6, np.nan, 1.4]])
def test_too_few_parts_say_nothing(values: list[float]) -> None:
    found = capability(np.array(values), np.zeros(len(values)), 1.0, 2.0)
    assert math.isnan(found.cp)
    assert not found.trend
