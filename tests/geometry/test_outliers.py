"""The kernel that rejects outliers against the same rules in plain Python, point by point."""

from __future__ import annotations

import numpy as np
import pytest

from workbench.geometry.outliers import GAP_COLUMNS, LINE_COLUMNS, REACH_COLUMNS, SHORT_RUN, reject_outliers
from workbench.units import Bool, Float32, Int

TOLERANCE_MM, WINDOW, JUMP_MM = 0.1, 5, 1.0


def scene(seed: int, frames: int = 30, columns: int = 60) -> tuple[Float32, Bool, Int]:
    """Three faces, one of them steep, with gaps, isolated outliers, streaks, empty frames and two passes."""
    rng = np.random.default_rng(seed)
    u = np.arange(columns)
    z = 150 + np.where(u < 25, 0.02 * u, np.where(u < 40, 0.5 + 0.4 * (u - 25), 6.5 - 1.7 * (u - 40)))
    climb = 0.15 * np.arange(frames)[:, None] * (rng.random(columns) < 0.5)  # a frame's neighbours only bracket it
    grid = z + climb + rng.normal(0, 0.012, (frames, columns)) + rng.normal(0, 0.05, (frames, 1))
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


def on_line(z: Float32, keep: Bool, j: int, end: int, way: int) -> bool:
    """Does return j lie on the line through column `end` and the farthest one within LINE_COLUMNS from there?"""
    near = [end + d * way for d in range(1, LINE_COLUMNS + 1) if 0 <= end + d * way < len(z)]
    far = [k for k in near if keep[k]]
    if not far or abs(far[-1] - end) < LINE_COLUMNS // 2:
        return False
    ahead = (j - end) / (end - far[-1])
    line = float(z[end]) + (float(z[end]) - float(z[far[-1]])) * ahead
    return abs(float(z[j]) - line) < TOLERANCE_MM * (1 + abs(ahead))


def drop_short_runs(z: Float32, keep: Bool) -> int:
    """Take runs of fewer than SHORT_RUN returns out of a profile, from its first column on; how many returns."""
    run: list[int] = []
    dropped = 0
    for j in [*map(int, np.flatnonzero(keep)), None]:
        if run and j is not None:
            gap = j - run[-1]
            goes_on = gap <= REACH_COLUMNS and abs(z[j] - z[run[-1]]) < JUMP_MM * gap
            if REACH_COLUMNS < gap <= GAP_COLUMNS:
                goes_on = on_line(z, keep, j, run[-1], -1) or on_line(z, keep, run[-1], j, 1)
            if goes_on:
                run.append(j)
                continue
        if len(run) < SHORT_RUN:
            keep[run] = False
            dropped += len(run)
        run = [] if j is None else [j]
    return dropped


@pytest.mark.parametrize("seed", range(6))
def test_the_same_as_point_by_point(seed: int) -> None:
    z, keep, number = scene(seed)
    expected, alone, streaks = keep.copy(), 0, 0
    for i, j in np.argwhere(keep):
        if isolated(z, keep, number, i, j):
            expected[i, j] = False
            alone += 1
    for i, row in enumerate(expected):
        streaks += drop_short_runs(z[i], row)
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


def test_the_last_returns_of_a_face_stay_beyond_columns_that_measure_nothing() -> None:
    rng = np.random.default_rng(3)
    face = 150 + 0.3 * np.arange(40)
    z = np.concatenate([face, np.full(20, 175.0)]) + rng.normal(0, 0.02, (30, 60))
    keep = np.ones(z.shape, bool)
    keep[:, 30:38] = False  # in every frame, before the face's last two columns
    left, *_ = reject_outliers(z.astype(np.float32), keep, np.zeros(30, int), TOLERANCE_MM, WINDOW, JUMP_MM)
    np.testing.assert_array_equal(left, keep)
    left, *_ = reject_outliers(
        z[:, ::-1].astype(np.float32), keep[:, ::-1], np.zeros(30, int), TOLERANCE_MM, WINDOW, 1.0
    )
    np.testing.assert_array_equal(left, keep[:, ::-1])
    z[:, 38:40] -= 2.0  # off the face's line: a streak, in every frame
    left, _, streaks = reject_outliers(z.astype(np.float32), keep, np.zeros(30, int), TOLERANCE_MM, WINDOW, JUMP_MM)
    assert streaks == 60
    assert not left[:, 38:40].any()
