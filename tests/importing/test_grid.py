"""Columns of ragged profiles."""

from __future__ import annotations

import numpy as np
import pytest

from workbench.importing.neutral import columns_by_count, columns_by_spacing


@pytest.mark.parametrize("sense", [1.0, -1.0])
def test_dropped_points_leave_their_columns_free(sense: float) -> None:
    """A sensor's x varies by a tenth of its pitch; a third of the points is dropped at random, ends included."""
    rng = np.random.default_rng(3)
    frames, columns = 30, 200
    x = sense * (0.05 * np.arange(columns) - 4.0 + rng.uniform(-0.005, 0.005, (frames, columns)))
    kept = rng.random((frames, columns)) > 1 / 3
    frame, column = np.nonzero(kept)
    got = columns_by_spacing(x[kept], np.diff(frame, prepend=-1) > 0)
    assert got is not None
    np.testing.assert_array_equal(got, column - column.min())


def test_nothing_is_made_of_x_that_runs_both_ways() -> None:
    first = np.array([True, False, False, False])
    assert columns_by_spacing(np.array([0.0, 1.0, 0.5, 2.0]), first) is None
    assert columns_by_spacing(np.array([0.0, 1.0, np.nan, 2.0]), first) is None
    assert columns_by_spacing(np.array([0.0, 1.0, 2.0, 900.0]), first) is None  # a gap out of proportion
    assert columns_by_spacing(np.array([0.0, 1.0]), np.array([True, True])) is None


def test_counted() -> None:
    first = np.array([True, False, False, True, True, False])
    np.testing.assert_array_equal(columns_by_count(first), [0, 1, 2, 0, 0, 1])
