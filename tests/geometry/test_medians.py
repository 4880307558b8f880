"""Compiled medians against numpy's."""

from __future__ import annotations

import numpy as np
import pytest

from workbench.geometry.medians import median, medians


@pytest.mark.parametrize("size", [0, 1, 2, 3, 4, 5, 16, 101, 1000])
def test_as_numpy(size: int) -> None:
    """Of the whole and of runs, one of them empty, which has none; the values stay."""
    rng = np.random.default_rng(size)
    for values in (rng.normal(size=size), rng.integers(0, 3, size).astype(float), np.arange(size)[::-1] * 1.0):
        before, edges = values.copy(), np.sort([0, 0, size, *rng.integers(0, size + 1, 3)])
        expected = [np.median(run) if run.size else np.nan for run in np.split(values, edges[1:-1])]
        np.testing.assert_array_equal(medians(values, edges), expected)
        assert not size or median(values) == np.median(values)
        assert (values == before).all()
