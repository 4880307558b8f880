"""Local regression against numpy's weighted least squares, and its variance against what noise really does."""

from __future__ import annotations

import numpy as np
import pytest

from workbench.geometry.smoothing import local_polynomial, robust_weights
from workbench.units import Float

HALF = 10.0


def data(seed: int, n: int = 120) -> tuple[Float, Float, Float]:
    rng = np.random.default_rng(seed)
    s = np.sort(rng.uniform(0, 60, n))
    weight = rng.uniform(0.2, 3, n)
    weight[rng.random(n) < 0.1] = 0.0
    return s, np.sin(s / 9) + rng.normal(0, 0.1, n), weight


def reference(s: Float, y: Float, weight: Float, at: float, degree: int) -> tuple[float, float]:
    """Value and slope at `at`, by numpy.polyfit."""
    u = (s - at) / HALF
    near = np.where(np.abs(u) < 1, (1 - np.abs(u) ** 3).clip(0) ** 3, 0)
    use = near * weight > 0
    fit = np.polyfit(s[use] - at, y[use], degree, w=np.sqrt(near * weight)[use])
    return float(fit[-1]), float(fit[-2]) if degree else 0.0


@pytest.mark.parametrize("seed", range(3))
def test_value_and_slope_as_by_numpy(seed: int) -> None:
    s, y, weight = data(seed)
    at = np.linspace(8, 52, 23)
    made = local_polynomial(s, y, weight, at, HALF)
    expected = np.array([reference(s, y, weight, float(a), 2) for a in at])
    np.testing.assert_allclose(made[:, :2], expected, rtol=0, atol=1e-6)
    count = [(weight[np.abs(s - a) < HALF] > 0).sum() for a in at]
    np.testing.assert_array_equal(made[:, 3], count)


def test_a_line_where_points_lie_on_one_side_only() -> None:
    s, y, weight = data(4)
    made = local_polynomial(s, y, weight, s[:1], HALF)[0]
    np.testing.assert_allclose(made[:2], reference(s, y, weight, float(s[0]), 1), rtol=0, atol=1e-6)


def test_a_mean_of_few_points_and_nothing_of_none() -> None:
    s, y = np.array([1.0, 2.0, 3.0]), np.array([5.0, 7.0, 6.0])
    made = local_polynomial(s, y, np.array([1.0, 1.0, 0.0]), np.array([1.5, 30.0]), HALF)
    assert made[0, 0] == pytest.approx(6.0, abs=1e-9)
    assert made[0, 1] == 0.0
    assert np.isnan(made[1]).all()


@pytest.mark.parametrize("at", [0.5, 20.0, 59.5])
def test_the_variance_factor_is_that_of_the_estimate(at: float) -> None:
    """The estimate is linear in y: its variance follows from its answer to each point alone, noise 1/sqrt(weight)."""
    s, _, weight = data(5)
    place = np.array([at])
    answers = np.array([local_polynomial(s, row, weight, place, HALF)[0, 0] for row in np.eye(s.size)])
    used = weight > 0
    variance = (answers[used] ** 2 / weight[used]).sum()
    assert local_polynomial(s, s, weight, place, HALF)[0, 2] == pytest.approx(variance, rel=1e-6)
    rng = np.random.default_rng(6)
    noise = rng.normal(0, 1, (1500, s.size)) / np.sqrt(np.where(used, weight, 1))
    drawn = [local_polynomial(s, row, weight, place, HALF)[0, 0] for row in noise]
    assert np.var(drawn) == pytest.approx(variance, rel=0.15)  # 4 sigma of a variance from 1500 draws


def test_outliers_lose_their_weight_and_good_points_keep_theirs() -> None:
    rng = np.random.default_rng(7)
    s = np.sort(rng.uniform(0, 60, 300))
    y = np.sin(s / 9) + rng.normal(0, 0.01, s.size)
    wild = rng.random(s.size) < 0.1
    y[wild] += rng.choice([-1, 1], wild.sum()) * rng.uniform(0.3, 3, wild.sum())
    weight = np.full(s.size, 1e4)
    kept = robust_weights(s, y, weight, HALF, np.linspace(s[0], s[-1], 61))
    assert (kept[wild] == 0).mean() > 0.97
    assert (kept[~wild] > 0).mean() > 0.99
    assert set(kept) <= {0.0, 1e4}
    np.testing.assert_array_equal(weight, 1e4)


def test_a_jump_wider_than_the_noise_is_not_taken_for_outliers_of_one_point() -> None:
    """With no outliers nothing is dropped, however the noise is scaled: it is judged by its own scatter."""
    rng = np.random.default_rng(8)
    s = np.sort(rng.uniform(0, 60, 300))
    for noise in (0.001, 1.0):
        y = 0.1 * s + rng.normal(0, noise, s.size)
        kept = robust_weights(s, y, np.full(s.size, 7.0), HALF, np.linspace(0, 60, 61))
        assert (kept == 7.0).mean() > 0.995
