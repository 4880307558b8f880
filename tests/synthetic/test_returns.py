"""Noise, outliers, dropouts and mixed pixels have the statistics that the recipe asks for."""

from __future__ import annotations

import numpy as np
import pytest

from workbench.synthetic import parse_recipe
from workbench.synthetic.scan import disturb

SHAPE = (200, 500)
STEEP = np.full(SHAPE, 0.25)
FLAT = np.ones(SHAPE)


def disturbed(cosines=FLAT, ranges=None, noise=None, scanner=None, seed=1, **disturbances):
    recipe = parse_recipe(
        {
            "scanner": {"noise": {"sd_mm": 0.0} | (noise or {})} | (scanner or {}),
            "disturbances": disturbances,
            "passes": [{"from_mm": 0, "to_mm": 1}],
        }
    )
    return disturb(recipe, np.full(SHAPE, 150.0) if ranges is None else ranges, cosines, np.random.default_rng(seed))


@pytest.mark.parametrize(
    ("power", "cap", "cosines", "factor"), [(0.5, 9, FLAT, 1), (0.5, 9, STEEP, 2), (1, 9, STEEP, 4), (1, 3, STEEP, 3)]
)
def test_noise_grows_with_incidence_up_to_its_cap(power, cap, cosines, factor):
    error = disturbed(cosines, noise={"sd_mm": 0.012, "grazing_power": power, "grazing_cap": cap}) - 150
    assert np.std(error) == pytest.approx(0.012 * factor, rel=0.02)


def test_correlated_noise_keeps_its_size_and_has_its_length():
    error = disturbed(noise={"sd_mm": 0.036, "correlation_columns": 5.0}) - 150
    assert np.std(error) == pytest.approx(0.036, rel=0.03)
    for lag in (1, 5):
        correlation = np.mean(error[:, lag:] * error[:, :-lag]) / np.var(error)
        assert correlation == pytest.approx(np.exp(-lag / 5), abs=0.03)
    assert abs(np.mean(error[1:] * error[:-1])) < 0.03 * np.var(error)


def test_outliers_are_isolated_or_in_streaks():
    isolated = disturbed(outlier_share=0.05, outlier_reach_mm=4) != 150
    assert isolated.mean() == pytest.approx(0.05, rel=0.1)
    streaks = disturbed(streak_outlier_share=0.05) != 150
    assert streaks.mean() == pytest.approx(0.05, rel=0.3)
    neighbours = [np.mean(hit[:, 1:][hit[:, :-1]]) for hit in (isolated, streaks)]
    assert neighbours[0] < 0.1 < 0.8 < neighbours[1]


def test_dropouts_take_their_share():
    assert np.isnan(disturbed(dropout_share=0.12, streak_dropout_share=0.08)).mean() == pytest.approx(0.2, rel=0.15)
    assert np.isnan(disturbed(grazing_dropout=0.5)).mean() == 0
    assert np.isnan(disturbed(STEEP, grazing_dropout=0.5)).mean() == pytest.approx(0.5 * 0.75**3, rel=0.05)


def test_mixed_pixels_lie_between_the_two_sides_of_a_jump():
    ranges = np.full(SHAPE, 150.0)
    ranges[:, 250:] = 160.0
    mixed = disturbed(ranges=ranges, mixed_pixel_probability=0.5)
    changed = mixed != ranges
    assert set(np.nonzero(changed)[1]) == {249, 250}
    assert changed.any(axis=1).mean() == pytest.approx(0.5, abs=0.1)
    assert np.all((mixed[changed] > 150) & (mixed[changed] < 160))
