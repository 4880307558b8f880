"""The kernel that rejects outliers against the same rules in plain Python, point by point."""

from __future__ import annotations

import numpy as np
import pytest

from workbench.geometry.outliers import REACH_COLUMNS, SHORT_RUN, reject_outliers
from workbench.units import Bool, Float32, Int

TOLERANCE_MM, WINDOW, JUMP_MM = 0.1, 5, 1.0


def scene(seed: int, frames: int = 30, columns: int = 60) -> tuple[Float32, Bool, Int]:
    """Three faces, one of them steep, with gaps, isolated outliers, streaks, empty frames and two passes."""
    rng = np.random.default_rng(seed)
    u = np.arange(columns)
    z = 150 + np.where(u < 25, 0.02 * u, np.where(u < 40, 0.5 + 0.4 * (u - 25), 6.5 - 1.7 * (u - 40)))
    grid = z + rng.normal(0, 0.012, (frames, columns)) + rng.normal(0, 0.05, (frames, 1))
    wild = rng.random(grid.shape) < 0.05
    grid[wild] += rng.uniform(-4, 4, wild.sum())
    for _ in range(10):  # streaks over columns and over frames
        i, j, long = rng.integers(frames), rng.integers(columns), rng.integers(1, 7)
        along = np.s_[i, j : j + long] if rng.random() < 0.5 else np.s_[i : i + long, j]
        grid[along] += rng.uniform(-4, 4)
    keep = rng.random(grid.shape) > rng.choice([0.02, 0.5], (frames, 1), p=[0.8, 0.2])
    keep[:, 20:27] &= rng.random((frames, 7)) < 0.4
    keep[rng.integers(frames)] = False
    grid[~keep] = np.where(rng.random((~keep).sum()) < 0.5, np.nan, grid[~keep])
    return grid.astype(np.float32), keep, np.repeat([7, -2], [frames // 3, frames - frames // 3])


def isolated(z: Float32, keep: Bool, number: Int, i: int, j: int) -> bool:
    """Is return (i, j) off the line of its neighbours on either side, between them, and off the frames next door?"""
    here = float(z[i, j])
    sides = []
    for step in (-1, 1):
        near = [j + step * d for d in range(1, REACH_COLUMNS + 1) if 0 <= j + step * d < z.shape[1]]
        sides.append([k for k in near if keep[i, k]][:2])
    pairs = [side for side in sides if len(side) == 2]
    pairs += [[sides[0][0], sides[1][0]]] if sides[0] and sides[1] else []
    for a, b in pairs:
        slope = (float(z[i, b]) - float(z[i, a])) / (b - a)
        if abs(here - (float(z[i, a]) + slope * (j - a))) < TOLERANCE_MM:
            return False
    for d in range(1, WINDOW // 2 + 1):
        rows = [k for k in (i - d, i + d) if 0 <= k < len(z) and number[k] == number[i] and keep[k, j]]
        values = [float(z[k, j]) for k in rows]
        values += [sum(values) / 2] if len(values) == 2 else []
        if any(abs(here - value) < TOLERANCE_MM for value in values):
            return False
    return True


def short_runs(z: Float32, keep: Bool) -> list[int]:
    """Columns of a profile in runs of fewer than SHORT_RUN returns."""
    runs: list[list[int]] = []
    for j in map(int, np.flatnonzero(keep)):
        last = runs[-1][-1] if runs else None
        if last is not None and j - last <= REACH_COLUMNS and abs(z[j] - z[last]) < JUMP_MM * (j - last):
            runs[-1].append(j)
        else:
            runs.append([j])
    return [j for run in runs if len(run) < SHORT_RUN for j in run]


@pytest.mark.parametrize("seed", range(6))
def test_the_same_as_point_by_point(seed: int) -> None:
    z, keep, number = scene(seed)
    expected, alone, streaks = keep.copy(), 0, 0
    for i, j in np.argwhere(keep):
        if isolated(z, keep, number, i, j):
            expected[i, j] = False
            alone += 1
    for i, row in enumerate(expected):
        for j in short_runs(z[i], row):
            row[j] = False
            streaks += 1
    before = z.copy(), keep.copy()
    left, *counts = reject_outliers(z, keep, number, TOLERANCE_MM, WINDOW, JUMP_MM)
    np.testing.assert_array_equal(left, expected)
    assert counts == [alone, streaks]
    assert min(counts) > 10
    for given, then in zip((z, keep), before, strict=True):
        np.testing.assert_array_equal(given, then)


def test_blocks_of_frames_do_not_show(monkeypatch: pytest.MonkeyPatch) -> None:
    grid = scene(9)
    whole = reject_outliers(*grid, TOLERANCE_MM, WINDOW, JUMP_MM)
    monkeypatch.setattr("workbench.geometry.blocks.BLOCK_POINTS", 4 * 60)
    blocks = reject_outliers(*grid, TOLERANCE_MM, WINDOW, JUMP_MM)
    np.testing.assert_array_equal(blocks[0], whole[0])
    assert blocks[1:] == whole[1:]


@pytest.mark.parametrize("columns", [1, 2, 3])
def test_the_narrowest_profiles(columns: int) -> None:
    z, keep = np.zeros((3, columns), np.float32), np.ones((3, columns), bool)
    left, alone, streaks = reject_outliers(z, keep, np.zeros(3, int), TOLERANCE_MM, WINDOW, JUMP_MM)
    assert (int(left.sum()), alone, streaks) == (0, 0, 3 * columns)  # one short run a frame
