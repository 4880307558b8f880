"""Compiled medians against numpy's."""

from __future__ import annotations

import numpy as np
import pytest

from workbench.geometry.medians import median, medians


@pytest.mark.parametrize("size", [1, 2, 3, 4, 5, 16, 101, 1000])
def test_as_numpy(size: int) -> None:
    rng = np.random.default_rng(size)
    for values in (rng.normal(size=size), rng.integers(0, 3, size), np.arange(size)[::-1]):
        before = values.copy()
        assert median(values) == np.median(values)
        assert (values == before).all()


def test_of_runs() -> None:
    values, edges = np.random.default_rng(1).normal(size=40), np.array([0, 1, 7, 30, 40])
    expected = [np.median(run) for run in np.split(values, edges[1:-1])]
    np.testing.assert_array_equal(medians(values, edges), expected)


def test_an_empty_run_has_no_median() -> None:
    found = medians(np.array([3.0, 1.0, 2.0]), np.array([0, 0, 3, 3]))
    np.testing.assert_array_equal(found, [np.nan, 2.0, np.nan])
