"""Directions of the faces: smoothed pass by pass, averaged robustly, and judged by their scatter."""

from __future__ import annotations

from dataclasses import fields

import numpy as np
import pytest

from workbench.edge.directions import pass_tilt, smooth_along, smooth_slope, with_true_noise, wrapped
from workbench.geometry.faces import FaceLines
from workbench.geometry.sections import SectionLines
from workbench.units import Float

N = 400
S = np.concatenate([np.arange(0, 40, 0.2), np.arange(40, 0, -0.2)])  # there and back
PASS = np.repeat([4, 1], N // 2)


def lines(angle: Float, sigma: float) -> SectionLines:
    none, nowhere = np.zeros(N), np.zeros((N, 2))
    return SectionLines(S, nowhere, angle, np.full(N, sigma**2), np.full(N, 1e-6), none, none, nowhere)


def test_each_pass_is_smoothed_by_itself() -> None:
    rng = np.random.default_rng(1)
    true = np.where(PASS == 4, 0.5 + 0.002 * S, 0.4 + 1e-4 * (S - 20) ** 2)
    value = true + rng.normal(0, 0.002, N)
    value[rng.random(N) < 0.05] += 0.3
    value[7] = np.nan
    smooth, slope = smooth_along(S, value, np.full(N, 1 / 0.002**2), PASS)
    assert np.isnan(smooth[7])
    good = np.isfinite(smooth)
    assert good.sum() == N - 1
    assert np.abs(smooth - true)[good].max() < 0.003
    inner = good & (S > 5) & (S < 35)
    expected = np.where(PASS == 4, 0.002, 2e-4 * (S - 20))
    assert np.abs(slope - expected)[inner].max() < 5e-4


def test_a_pass_of_one_frame_has_no_course() -> None:
    number = np.zeros(N, int)
    number[5] = 9
    smooth, _ = smooth_along(S, np.ones(N), np.ones(N), number)
    np.testing.assert_array_equal(np.flatnonzero(np.isnan(smooth)), [5])


def test_slope_of_a_face_from_the_frames_around_it() -> None:
    """Weighted by what each frame knows of it: sxx."""
    rng = np.random.default_rng(2)
    sxx = rng.uniform(0.1, 10, N)
    slope = 0.8 + 0.001 * S
    sxz = slope * sxx + 0.02 * np.sqrt(sxx) * rng.normal(size=N)
    face = FaceLines(np.full(N, 9), *(np.zeros(N),) * 2, sxx, sxz, np.zeros(N), np.zeros((N, 2), int))
    assert np.abs(smooth_slope(face, S, PASS) - slope).max() < 0.005


@pytest.mark.parametrize("about", [0.3, np.pi - 0.001, -np.pi / 2])
def test_the_tilt_is_the_weighted_mean_of_each_pass(about: float) -> None:
    """Outliers and the seam of the circle do not matter."""
    rng = np.random.default_rng(3)
    off = rng.normal(0, 0.02, N) + np.where(PASS == 4, 0.0, 0.01)
    stray = rng.random(N) < 0.05
    off[stray] += 1.0
    angle = wrapped(about + off)
    tilt = pass_tilt(lines(angle, 0.02), PASS)
    for p in (4, 1):
        mine = p == PASS
        expected = about + np.mean(off[mine & ~stray])
        np.testing.assert_allclose(np.sin(tilt[mine] - expected), 0, atol=5e-4)
        assert np.unique(tilt[mine]).size == 1


def test_a_pass_that_saw_nothing_has_no_tilt() -> None:
    angle = np.where(PASS == 4, 0.1, np.nan)
    tilt = pass_tilt(lines(angle, 0.02), PASS)
    np.testing.assert_array_equal(np.isfinite(tilt), PASS == 4)


def test_variances_rise_to_what_the_scatter_shows_and_never_fall() -> None:
    rng = np.random.default_rng(4)
    off = rng.normal(0, 1, N) * np.where(PASS == 4, 0.06, 0.005)
    given = lines(off, 0.02)
    made = with_true_noise(given, off, PASS)
    for name in ("angle_variance", "offset_variance"):
        factor = getattr(made, name) / getattr(given, name)
        np.testing.assert_allclose(factor[PASS == 4], 9, rtol=0.4)
        np.testing.assert_array_equal(factor[PASS == 1], 1.0)
    for field in fields(SectionLines):
        if "variance" not in field.name:
            assert getattr(made, field.name) is getattr(given, field.name)


def test_wrapped() -> None:
    angle = np.array([0.0, np.pi, -np.pi, 3 * np.pi, 2 * np.pi + 0.1, -7.0])
    np.testing.assert_allclose(wrapped(angle), [0, np.pi, np.pi, np.pi, 0.1, 2 * np.pi - 7], atol=1e-12)
