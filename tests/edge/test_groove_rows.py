"""Corners of a groove in rows of ranges alone, among reflections and lost returns."""

import numpy as np

from workbench.edge.groove_rows import corners_of_rows
from workbench.units import Float


def rows(count: int, seed: int, sense: float = 1.0) -> tuple[Float, Float]:
    """Ranges (count, 1200) across a V groove that wanders, and its corners' columns (count, 3)."""
    rng = np.random.default_rng(seed)
    column = np.arange(1200.0)
    wander = np.cumsum(rng.normal(0, 4, count))
    at = np.array([350.0, 600.0, 820.0]) + wander[:, None]
    z = np.empty((count, 1200))
    for i in range(count):
        z[i] = np.interp(column, [0, *at[i], 1199], [470, 480, 600, 490, 495]) + rng.normal(0, 1.0, 1200)
        flank = (column > at[i, 1] - 60) & (column < at[i, 1] + 120)
        astray = flank & (rng.random(1200) < 0.5)
        z[i, astray] += rng.uniform(-80, 150, astray.sum())
        z[i, (column > at[i, 0] + 50) & (rng.random(1200) < 0.3)] = np.nan
    return sense * z, at


def test_corners_are_found_in_every_row_whichever_way_ranges_count() -> None:
    for sense in (1.0, -1.0):
        z, at = rows(12, 11, sense)
        found = corners_of_rows(z)
        assert found is not None
        assert found.found.all()
        off = np.abs(found.column - at)
        assert np.median(off) < 2.0
        assert np.quantile(off, 0.95) < 8.0


def test_a_flat_plate_has_none() -> None:
    z = np.random.default_rng(1).normal(500.0, 1.0, (10, 800))
    assert corners_of_rows(z) is None


def test_a_root_says_how_far_the_next_return_of_its_flanks_lies() -> None:
    column = np.arange(1200)
    ranges = np.interp(column, [300, 600, 900], [2500, 1585, 2500]) + np.random.default_rng(1).normal(0, 2, (6, 1200))
    seen = corners_of_rows(ranges)
    lost = corners_of_rows(np.where(np.abs(column - 600) < 60, np.nan, ranges))
    assert seen is not None
    assert lost is not None
    assert (seen.root_away < 2.0).all()
    assert np.allclose(lost.root_away, 60.0, atol=1.0)
