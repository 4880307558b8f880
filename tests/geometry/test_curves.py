"""Curves through measured points: how sure they are, passes along them, and which places count as measured.

Where they run and how they bend is told by edges that lie where they were built (tests/laws/test_exact.py).
"""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from workbench.geometry.curves import (
    GAP_PITCHES,
    LEAST_GAP_MM,
    along_motion,
    covered,
    doubtful_slope,
    fit_curve,
)
from workbench.units import Float

RADIUS_MM = 400.0


def line(s: Float) -> Float:
    return np.outer(s, [0.6, 0.0, 0.8])


def circle(s: Float) -> Float:
    u = s / RADIUS_MM
    return RADIUS_MM * np.stack([np.sin(u), 1 - np.cos(u), 0 * u], axis=1)


def coverage(height_mm: float) -> tuple[float, float]:
    """Over noisy edges that wave by `height_mm`: share of tangents within 2u, and within how many u 68.3 % are."""
    ratios: list[float] = []
    rng = np.random.default_rng(3)
    along, across, square = np.array([0.6, 0.0, 0.8]), np.array([0.0, 1.0, 0.0]), np.array([-0.8, 0.0, 0.6])
    for seed in range(90):
        s = np.arange(0, rng.uniform(50, 160), 0.2)
        wave, slope = height_mm * np.sin(s / 25), height_mm / 25 * np.cos(s / 25)
        noise = np.random.default_rng([seed, 3]).normal(0, 0.03, (s.size, 3))
        points = np.outer(s, along) + np.outer(wave, across) + noise
        arc = np.concatenate([[0.0], np.cumsum(np.hypot(1, slope[1:]) * 0.2)])
        curve = fit_curve(points, arc)
        for i in rng.integers(5, s.size - 5, 2):
            t = curve.tangent(curve.project(points[i : i + 1], arc[i : i + 1]))[0]
            true = (along + slope[i] * across) / np.hypot(1, slope[i])
            sideways = (across - slope[i] * along) / np.hypot(1, slope[i])
            u = curve.tangent_u(curve.project(points[i : i + 1], arc[i : i + 1]))[0]
            ratios += [float((t - true) @ sideways / u), float(t @ square / u)]
    return float(np.mean(np.abs(ratios) <= 2)), float(np.quantile(np.abs(ratios), 0.683))


@pytest.mark.parametrize("height_mm", [0.0, 3.0])
def test_the_tangent_is_as_uncertain_as_it_says(height_mm: float) -> None:
    """Within 2u in about 95 of 100 cases, in both directions across, anywhere along straight and wavy edges."""
    inside, ratio = coverage(height_mm)
    assert 0.85 < inside < 0.99
    assert 0.6 < ratio < 1.4


@pytest.mark.parametrize("phase", [0.0, 1.0, 2.0])
@pytest.mark.parametrize("wave_mm", [40.0, 56.0, 75.0])
def test_a_short_edge_may_bend_both_ways(wave_mm: float, phase: float) -> None:
    """Its ends are no strays, and the stiffness found without them not its own: drawn straight, 2.2 deg off."""
    s = np.arange(0.0, 40.0, 0.4)
    points = line(s) + 0.45 * np.sin(2.0 * np.pi * s / wave_mm + phase)[:, None] * (0.0, 1.0, 0.0)
    curve = fit_curve(points + np.random.default_rng(1).normal(0.0, 0.003, points.shape), s)
    off = curve.position(curve.project(points, s)) - points
    assert np.sqrt((off**2).mean()) < 0.01


def test_small_waves_may_be_the_robots_and_large_ones_are_the_parts() -> None:
    """A wave of 0.1 mm makes the tangent as uncertain as its slope; one of 3 mm is the edge's own."""
    s = np.arange(0, 200, 0.2)
    for amplitude, least, most in ((0.1, 0.7, 1.4), (3.0, 0.0, 0.1)):
        wave = amplitude * np.sin(2 * np.pi * s / 60)
        noise = np.random.default_rng(4).normal(0, 0.01, (s.size, 3))
        curve = fit_curve(line(s) + wave[:, None] * (0.0, 1.0, 0.0) + noise, s)
        slope = amplitude * 2 * np.pi / 60 / np.sqrt(2)  # rms
        assert least * slope / np.sqrt(2) <= doubtful_slope(curve, 0.07) < most * slope / np.sqrt(2)


def test_passes_in_both_directions_are_arranged_along_one_course() -> None:
    """Where arc length begins is free; that it rises along the edge, and is one for all passes, is not."""
    rng = np.random.default_rng(5)
    there, back = np.arange(0, 120, 0.3), np.arange(90, 40, -0.3)
    true = np.concatenate([there, back])
    points = circle(true) + rng.normal(0, 0.05, (true.size, 3))
    group = np.repeat([7, 2], [there.size, back.size])
    forward = np.stack([np.cos(true / RADIUS_MM), np.sin(true / RADIUS_MM), 0 * true], axis=1)
    assert np.ptp(along_motion(points, forward, group) - true) < 1.0
    assert np.ptp(along_motion(points, -forward, group) + true) < 1.0


def test_a_pass_may_stop_reverse_and_go_round() -> None:
    """A ring that is overrun by 10 deg, with 25 mm gone back on the way: lengths are those along the edge."""
    way = np.concatenate([np.arange(0, 300, 0.3), np.arange(300, 275, -0.3), np.arange(275, 1760, 0.3)])
    radius = 280.0
    angle = way / radius
    points = radius * np.stack([np.sin(angle), 1 - np.cos(angle), 0 * angle], axis=1)
    points += np.random.default_rng(6).normal(0, 0.03, points.shape)
    forward = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    assert np.ptp(along_motion(points, forward, np.zeros(way.size, int)) - way) < 0.5


def test_points_on_no_curve_are_refused() -> None:
    """A curve that swings a metre every millimetre grows at each round, once to 136 km and all memory."""
    s = np.linspace(0.0, 200.0, 800)
    points = np.column_stack([s, 1000.0 * (np.arange(800) // 5 % 2), 0.0 * s])
    with pytest.raises(np.linalg.LinAlgError, match="a curve through 593 mm would be"):
        fit_curve(points, s)


@settings(max_examples=60)
@given(seed=st.integers(0, 10**6), pitch_mm=st.sampled_from([0.1, 0.3, 1.0]), passes=st.integers(1, 3))
def test_covered_is_what_lies_between_frames_of_one_pass_that_are_near_enough(
    seed: int, pitch_mm: float, passes: int
) -> None:
    """Up to the least gap of a dense scan, up to some pitches of a coarse one; frames in any order, some blind."""
    rng = np.random.default_rng(seed)
    number = rng.integers(0, passes, 120)
    s = pitch_mm * (rng.permutation(120) + rng.uniform(-0.2, 0.2, 120)) + 20.0 * number
    s[rng.random(120) < rng.choice([0.0, 0.3, 0.9, 0.999])] = np.nan
    at = np.append(rng.uniform(-5.0, 165.0, 200), [np.nanmin(s), np.nanmax(s)] if np.isfinite(s).any() else [])
    expected = np.zeros(at.size, bool)
    for one in range(passes):
        its = np.sort(s[(number == one) & np.isfinite(s)])
        widest = max(LEAST_GAP_MM, GAP_PITCHES * np.median(np.diff(its))) if its.size > 1 else 0.0
        for before, after in itertools.pairwise(its):
            expected |= (at >= before) & (at <= after) & (after - before <= widest)
    np.testing.assert_array_equal(covered(s, number, at), expected)
