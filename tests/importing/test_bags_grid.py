"""Profiles of any number go into a grid without needing much more room than it."""

import tracemalloc

import numpy as np
import pytest

from workbench.importing.bags_profiles import Grid


@pytest.mark.parametrize("ragged", [False, True])
def test_the_peak_is_less_than_three_grids(ragged: bool) -> None:
    """Rows come one by one; a grid of 1,500 x 1,000 is 12 MB, and is there once while rows are given up."""
    x, grid = np.linspace(-20.0, 20.0, 1000), Grid(by_spacing=True)
    tracemalloc.start()
    for i in range(1500):
        row = x[: 1000 - i % 5] if ragged else x
        grid.append(0.01 * i, 0, row, row + 100, None, "bag")
    made = grid.frames("bag", None)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    size = made.x_mm.nbytes + made.z_mm.nbytes
    assert peak < (2.9 if ragged else 1.8) * size
    assert made.z_mm.shape == (1500, 1000)
    np.testing.assert_array_equal(made.z_mm[4, :996], np.float32(x[:996] + 100))
    assert grid.blocks["x"] == []


def test_many_blocks_are_laid_out_alike() -> None:
    """Holes move over the rows, 2,000 of them: a column is the same x in all of them."""
    x, grid = np.linspace(-5.0, 5.0, 101), Grid(by_spacing=True)
    for i in range(2000):
        seen = np.ones(101, bool)
        seen[i % 90 : i % 90 + 1 + i % 7] = False
        grid.append(0.01 * i, 0, x[seen], x[seen], np.flatnonzero(seen), "bag")
    made = grid.frames("bag", 1.0)
    assert made.intensity is not None
    assert made.x_mm.shape == (2000, 101)
    np.testing.assert_allclose(np.nanmax(made.x_mm, axis=0), x, atol=1e-6)
    np.testing.assert_allclose(np.nanmin(made.x_mm, axis=0), x, atol=1e-6)
    np.testing.assert_array_equal(
        made.intensity[1999][np.isfinite(made.z_mm[1999])], np.flatnonzero(np.isfinite(made.z_mm[1999]))
    )
