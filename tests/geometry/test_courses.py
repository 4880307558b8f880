"""Smooth courses: what they follow, what they leave, and how sure they are."""

from __future__ import annotations

import numpy as np
import pytest

from workbench.geometry.courses import fit_course, fit_course_curve
from workbench.units import Float

S = np.arange(0.0, 140.0, 0.25)


def waves(rng: np.random.Generator, sd: float) -> Float:
    """Scatter that hangs together: random waves of 1 to 20 mm that run in all directions, as met along a line."""
    length, angle = np.exp(rng.uniform(0, np.log(20), 30)), rng.uniform(0, np.pi, 30)
    phase = rng.uniform(0, 2 * np.pi, 30)
    rough = (np.sqrt(length) * np.sin(2 * np.pi * S[:, None] / length * np.cos(angle) + phase)).sum(axis=1)
    return np.asarray(sd * rough / rough.std())


@pytest.mark.parametrize("wavelength", [120.0, 300.0])
def test_waves_of_the_edge_are_followed(wavelength: float) -> None:
    wave = 3.0 * np.sin(2 * np.pi * S / wavelength)
    course = fit_course(S, (wave + np.random.default_rng(1).normal(0, 0.01, S.size))[:, None])
    assert np.abs(course.spline(S)[:, 0] - wave).max() < 0.015


def test_roughness_is_not_followed_and_its_uncertainty_is_honest() -> None:
    """A straight edge under 0.1 mm of rough waves, 60 times: errors far below the waves, and as large as stated."""
    rng = np.random.default_rng(2)
    error, stated = [], []
    for _ in range(60):
        rough = waves(rng, 0.1)
        course = fit_course(S, rough[:, None])
        error.append(course.spline(S)[:, 0])
        stated.append(course.u(S, S, rough - course.spline(S)[:, 0]))
    rms = np.sqrt(np.mean(np.square(error)))
    assert rms < 0.06
    assert 0.6 < np.sqrt(np.mean(np.square(np.array(error) / np.array(stated)))) < 1.6


def test_outliers_are_left_out() -> None:
    rng = np.random.default_rng(3)
    values = 0.02 * S + rng.normal(0, 0.01, S.size)
    wrong = rng.random(S.size) < 0.1
    values[wrong] += rng.uniform(0.5, 2.0, int(wrong.sum()))
    course = fit_course(S, values[:, None])
    assert not course.kept[wrong].any()
    assert np.abs(course.spline(S)[:, 0] - 0.02 * S).max() < 0.005


def test_a_curve_is_parametrised_by_its_arc_length() -> None:
    """An arc of radius 300 mm: unit speed, and curvature 1/300 towards its centre."""
    angle = S / 300.0
    points = 300.0 * np.stack([np.sin(angle), 1 - np.cos(angle), 0 * angle], axis=1)
    curve = fit_course_curve(points + np.random.default_rng(4).normal(0, 0.005, points.shape), 1.02 * S,
                             np.array([0.0, 0.0, 1.0]))  # fmt: skip
    s = curve.project(points, S)
    assert np.abs(np.diff(s) / 0.25 - 1).max() < 2e-3
    assert np.linalg.norm(curve.position(s) - points, axis=1).max() < 0.01
    np.testing.assert_allclose(np.linalg.norm(curve.curvature(s[40:-40]), axis=1), 1 / 300, rtol=0.1)


def test_the_beat_of_columns_does_not_bend_a_flat_plates_edge() -> None:
    """Heights known but for a saw tooth of 0.1 mm over 50 mm: the curve stays flat."""
    height = 0.1 * (S / 50.0 % 1.0 - 0.5)
    curve = fit_course_curve(np.stack([S, 0.0 * S, height], axis=1), S, np.array([0.0, 0.0, 1.0]))
    assert np.abs(curve.tangent(S)[:, 2]).max() < 0.002


def test_ten_thousand_millimetres_take_no_time_to_speak_of() -> None:
    s = np.arange(0.0, 10_000.0, 0.5)
    course = fit_course(s, (3.0 * np.sin(2 * np.pi * s / 150.0))[:, None])
    assert np.abs(course.spline(s)[:, 0] - 3.0 * np.sin(2 * np.pi * s / 150.0)).max() < 0.01
