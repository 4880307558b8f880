"""Which points of a slice are seen, and what patches of a cloud without a grid show."""

from __future__ import annotations

import numpy as np
import pytest

from workbench.geometry.curves import fit_curve
from workbench.geometry.gridless import cut, lay_out, traces, two_sheets
from workbench.units import Float

NOISE_MM = 0.012


def test_a_cell_of_a_slice_keeps_what_lies_in_front():
    rng = np.random.default_rng(2)
    s, x, behind = rng.uniform(0, 40, 60_000), rng.uniform(-3, 3, 60_000), rng.random(60_000) < 0.3
    at = np.arange(-10.0, 50.0, 0.25)
    course = fit_curve(np.outer(at, [1.0, 0, 0]), at + 10)
    laid = lay_out(np.stack([s, x, np.where(behind, -4.0, 0.2 * x)], axis=1), course, s + 10)
    x, z, _ = cut(laid, np.array([0.0, 0.0, -1.0]), np.arange(12.0, 48.0, 0.4), 0.4, 0.1)
    kept = np.isfinite(x)
    front = z[kept] < 2.0
    assert front.mean() > 0.95, "what lies 4 mm behind shows through gaps only"
    np.testing.assert_allclose(np.abs(z[kept][front]), 0.2 * np.abs(x[kept][front]), atol=2e-3)


def lines(rng: np.random.Generator, tangent: float, start_mm: float, pitch_mm: float = 0.2) -> Float:
    """x and s (2, n) of points 0.05 mm apart on parallel lines over a patch of 1 by 2 mm; poses to a micrometre."""
    first = np.arange(-2, 4, pitch_mm) + start_mm
    x, s = np.meshgrid(np.arange(-0.5, 0.5, 0.05) + 0.01, first + 0.001 * rng.normal(size=first.size))
    s = s + tangent * x
    here = (s > 0) & (s < 2) & (rng.random(s.shape) > 0.02)
    return np.stack([x[here], s[here]])


@pytest.mark.parametrize("tangent", [-0.2, 0.0, 0.031])
@pytest.mark.parametrize("pitch_mm", [0.1, 0.2])
def test_lines_of_one_pass(tangent: float, pitch_mm: float):
    assert traces(*lines(np.random.default_rng(1), tangent, 0.03, pitch_mm)) == "one pass"


@pytest.mark.parametrize("other", [(0.1, 0.0, 0.2), (0.0, 0.06, 0.2), (-0.15, 0.05, 0.3)])
def test_lines_of_two_passes_aslant_or_side_by_side(other: tuple[float, float, float]):
    rng = np.random.default_rng(2)
    assert traces(*np.hstack([lines(rng, 0.0, 0.0), lines(rng, *other)])) == "several passes"


def test_points_on_no_lines_say_nothing():
    rng = np.random.default_rng(3)
    assert traces(rng.uniform(-0.5, 0.5, 250), rng.uniform(0, 2, 250)) == "none"


def patch(seed: int, points: int = 500) -> tuple[np.random.Generator, Float, Float, Float]:
    """A sloping plane of 2 by 3 mm, without noise."""
    rng = np.random.default_rng(seed)
    x, y = rng.uniform(0, 2, points), rng.uniform(0, 3, points)
    return rng, x, y, 0.02 * x - 0.01 * y + 7.0


@pytest.mark.parametrize("share", [0.5, 0.2])
@pytest.mark.parametrize("apart_mm", [0.05, 0.2])
def test_two_sheets_are_found_where_they_are(share: float, apart_mm: float):
    rng, x, y, z = patch(1)
    upper = rng.random(x.size) < share
    fit = two_sheets(x, y, z + apart_mm * upper + rng.normal(0, NOISE_MM, x.size))
    assert fit.gain > 40
    assert fit.distance_mm == pytest.approx(apart_mm, abs=0.006)
    assert 0.85 * NOISE_MM < fit.sigma_mm < 1.6 * NOISE_MM  # the plane leans a little where two halves pull at it
    assert fit.smaller_share == pytest.approx(share, abs=0.06)


def test_stray_returns_and_heavy_tails_are_no_second_sheet():
    for seed in range(10):
        rng, x, y, z = patch(seed)
        stray = np.where(rng.random(x.size) < 0.05, rng.uniform(-0.4, 0.4, x.size), 0.0)
        heavy = NOISE_MM * rng.standard_t(5, x.size)
        fit = two_sheets(x, y, z + stray + heavy)
        assert fit.gain < 8 or fit.distance_mm < 2 * fit.sigma_mm or fit.smaller_share < 0.08
