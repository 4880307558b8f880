"""Noise taken off the ends of a face: what it explains goes, vibration and what neighbours share stays."""

from __future__ import annotations

import numpy as np

from workbench.geometry.silhouette import settled
from workbench.units import Float

STEP_MM, PITCH_MM, LENGTH_MM = 0.05, 0.2, 100.0
S = np.arange(0, LENGTH_MM, PITCH_MM)


def noisy_corner(rng: np.random.Generator, noise_mm: float) -> tuple[Float, Float, Float, Float]:
    """A constant end 1.52 seen in drifting columns: low with and without the corner's noise, its step, the column."""
    phase = 0.0031 * S + 0.3 * STEP_MM
    column = np.floor((1.52 - phase) / STEP_MM)
    exact = phase + STEP_MM * column
    return exact + rng.normal(0, noise_mm, S.size), exact, np.full(S.size, STEP_MM), column.astype(np.int64)


def test_noise_that_the_columns_do_not_share_is_taken_off() -> None:
    """What the noise explains is taken off each frame; `low` and `step` keep room for what neighbours share of it."""
    for noise in (0.004, 0.012):
        low, exact, step, column = noisy_corner(np.random.default_rng(8), noise)
        group = np.zeros(S.size, np.int64)
        freed = settled(S, low, step, np.full(S.size, noise), column, group)
        made, wide, sigma, weight = freed.low, freed.step, freed.sigma, freed.weight
        assert np.std(made + 0.5 * wide - exact - 0.5 * step) < 0.4 * noise
        assert (sigma < noise).all()
        assert np.std(made + 0.5 * wide - exact - 0.5 * step) < 2.0 * np.median(sigma)  # what is left is stated
        assert ((weight > 0) & (weight <= 1)).all()
        within = (made - 2 * sigma < 1.52) & (made + wide + 2 * sigma > 1.52)
        assert within.mean() > 0.97


def test_vibration_of_the_columns_is_left_alone() -> None:
    """It moves the columns against the face: other phases, which do tell where the end lies."""
    rng = np.random.default_rng(9)
    phase = 0.0031 * S + rng.normal(0, 0.05, S.size)
    column = np.floor((1.52 - phase) / STEP_MM)
    low = phase + STEP_MM * column
    freed = settled(
        S, low, np.full(S.size, STEP_MM), np.full(S.size, 0.002), column.astype(np.int64), np.zeros(S.size, np.int64)
    )
    made, wide, weight = freed.low, freed.step, freed.weight
    np.testing.assert_allclose(made, low, rtol=0, atol=0.002)
    np.testing.assert_allclose(wide, STEP_MM, rtol=0, atol=0.002)
    assert (weight > 0.9).all()


def test_corners_unseen_frames_and_short_passes_stay_as_they_are() -> None:
    rng = np.random.default_rng(10)
    low, _, step, column = noisy_corner(rng, 0.01)
    sigma, group = np.full(S.size, 0.01), np.zeros(S.size, np.int64)
    low[7] = np.nan
    step[100:110] = 0.0
    group[-20:] = 5
    freed = settled(S, low, step, sigma, column, group)
    made, wide, left, weight = freed.low, freed.step, freed.sigma, freed.weight
    same = np.r_[7, 100:110, S.size - 20 : S.size]
    np.testing.assert_array_equal(made[same], low[same])
    for value, before in ((wide, step), (left, sigma), (weight, np.ones(S.size))):
        np.testing.assert_array_equal(value[same], before[same])
    assert (made[20:90] != low[20:90]).all()
    np.testing.assert_array_equal(sigma, 0.01)
