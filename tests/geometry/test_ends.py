"""Where a face ends, from last returns in columns: against ends, phases, noise and strays that are known."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import norm

from workbench.geometry.ends import KNOTS_MM, Ends, cdf, contradicted, fit_end, local_end
from workbench.units import Float

STEP_MM, PITCH_MM, LENGTH_MM = 0.05, 0.2, 100.0
S = np.arange(0, LENGTH_MM, PITCH_MM)
INNER = slice(10, -10)


def wave(s: Float) -> Float:
    return 1.5 + 0.2 * s / LENGTH_MM + 0.1 * np.sin(2 * np.pi * s / 120)


def silhouettes(rng: np.random.Generator, course: Callable[[Float], Float], phase: Float, noise_mm: float = 0.002,
                missing: float = 0.0) -> Ends:  # fmt: skip
    """The last of the columns, which lie at `phase` (n,) plus multiples of STEP_MM, that returned before the end."""
    column = np.floor((course(S) - phase) / STEP_MM)
    column -= rng.geometric(1 - missing, S.size) - 1
    low = phase + STEP_MM * column + rng.normal(0, noise_mm, S.size)
    return every(low, noise_mm, missing)


def every(low: Float, noise_mm: float, missing: float = 0.0, step_mm: float = STEP_MM) -> Ends:
    same = np.ones(low.size)
    return Ends(S[: low.size], low, step_mm * same, noise_mm * same, max(missing, 0.02) * same, same)


def uniform(rng: np.random.Generator) -> Float:
    return rng.uniform(0, STEP_MM, S.size)


@pytest.mark.parametrize("missing", [0.0, 0.2])
@pytest.mark.parametrize("seed", range(3))
def test_many_phases_tell_the_end_far_better_than_the_step(seed: int, missing: float) -> None:
    rng = np.random.default_rng(seed)
    ends = silhouettes(rng, wave, uniform(rng), missing=missing)
    off = fit_end(ends).spline(S) - wave(S)
    assert np.abs(off[INNER]).max() < 0.1 * STEP_MM
    assert abs(off.mean()) < 0.04 * STEP_MM


@pytest.mark.parametrize("inside", [0.1, 0.5, 0.9])
def test_one_phase_leaves_the_end_within_the_step(inside: float) -> None:
    rng = np.random.default_rng(1)
    ends = silhouettes(rng, lambda s: 1.5 + inside * STEP_MM + 0 * s, np.zeros(S.size))
    made = fit_end(ends).spline(S)
    assert (made > 1.5 - 0.005).all()
    assert (made < 1.5 + STEP_MM + 0.005).all()
    assert np.ptp(made) < 0.2 * STEP_MM


@pytest.mark.parametrize("rate", [0.002, 0.004])
def test_no_saw_tooth_where_a_straight_end_passes_the_columns_slowly(rate: float) -> None:
    """Within each step any end will do; the straight one through all limits is the least bent."""
    rng = np.random.default_rng(2)
    ends = silhouettes(rng, lambda s: 1.5 + rate * s, np.zeros(S.size), noise_mm=0.001)
    off = fit_end(ends).spline(S) - 1.5 - rate * S
    assert np.abs(off[INNER]).max() < 0.2 * STEP_MM


def test_corners_are_averaged() -> None:
    """Step 0: `low` is a measured corner. About LENGTH / 32 + 3 parameters share the noise of all frames."""
    rng = np.random.default_rng(3)
    noise, off = 0.01, []
    for _ in range(10):
        ends = every(wave(S) + rng.normal(0, noise, S.size), noise, step_mm=0.0)
        off.append(fit_end(ends).spline(S) - wave(S))
    assert np.sqrt(np.mean(np.square(off))) < 1.5 * noise * np.sqrt(7 / S.size)


@pytest.mark.parametrize("step_mm", [0.0, STEP_MM])
def test_stray_frames_do_not_move_it(step_mm: float) -> None:
    rng = np.random.default_rng(4)
    ends = silhouettes(rng, wave, uniform(rng))
    if step_mm == 0:
        ends = every(wave(S) + rng.normal(0, 0.002, S.size), 0.002, step_mm=0.0)
    stray = rng.random(S.size) < 0.05
    ends.low[stray] += rng.choice([-1, 1], stray.sum()) * rng.uniform(0.2, 1, stray.sum())
    off = fit_end(ends).spline(S) - wave(S)
    assert np.abs(off[INNER]).max() < 0.15 * STEP_MM


def test_a_hidden_stretch_does_not_reach_into_what_was_seen() -> None:
    rng = np.random.default_rng(5)
    ends = silhouettes(rng, wave, uniform(rng))
    seen = (S < 35) | (S > 60)
    part = Ends(*(getattr(ends, name)[seen] for name in ("s", "low", "step", "sigma", "missing", "weight")))
    made = fit_end(part).spline(S)
    assert np.isfinite(made).all()
    assert np.abs((made - wave(S))[seen][INNER]).max() < 0.15 * STEP_MM


def test_knots_follow_the_waves_of_the_end() -> None:
    rng = np.random.default_rng(6)
    straight = silhouettes(rng, lambda s: 1.5 + 0.001 * s, uniform(rng))
    assert fit_end(straight).knots_mm == max(KNOTS_MM)

    def short(s: Float) -> Float:
        return np.asarray(1.5 + 0.15 * np.sin(2 * np.pi * s / 35))

    waves = fit_end(silhouettes(rng, short, uniform(rng)))
    assert waves.knots_mm == min(KNOTS_MM)
    assert np.abs(waves.spline(S) - short(S))[INNER].max() < 0.2 * STEP_MM


def test_frames_of_less_weight_count_less() -> None:
    """Two groups of frames that contradict each other: the heavier one is believed."""
    rng = np.random.default_rng(7)
    low = 1.5 + rng.normal(0, 0.002, S.size)
    low[::2] += 0.006
    even = np.arange(S.size) % 2 == 0
    for heavy in (even, ~even):
        ends = replace(every(low, 0.002, step_mm=0.0), weight=np.where(heavy, 1.0, 0.01))
        assert fit_end(ends).spline(S).mean() == pytest.approx(1.506 if heavy[0] else 1.5, abs=0.001)


@pytest.mark.parametrize("change_mm", [-0.7, 0.3])
@pytest.mark.parametrize("missing", [0.0, 0.2])
def test_a_stretch_against_the_course_speaks_for_itself(change_mm: float, missing: float) -> None:
    """A gouge of 6 mm, or material left standing; strays between good frames contradict nothing."""
    rng = np.random.default_rng(11)
    gouge = np.abs(S - 50) < 3
    ends = silhouettes(rng, lambda s: 1.5 + np.where(gouge, change_mm, 0.0), uniform(rng), missing=missing)
    stray = rng.random(S.size) < 0.1
    ends.low[stray & ~gouge] += rng.choice([-1, 1], (stray & ~gouge).sum()) * 0.5
    at = np.array([20.0, 45.0, 49.0, 50.0, 51.0, 55.0, 80.0])
    found = contradicted(ends, np.full(S.size, 1.5), at)
    np.testing.assert_array_equal(found, [False, False, True, True, True, False, False])
    value, u = local_end(ends, at[found])
    assert (np.abs(value - 1.5 - change_mm) < np.maximum(2 * u, STEP_MM)).all()
    assert (u > 0.9 * STEP_MM / np.sqrt(12)).all()
    assert (u < 2 * STEP_MM).all()


def test_normal_distribution() -> None:
    z = np.linspace(-6, 6, 25)
    np.testing.assert_allclose([cdf(value) for value in z], norm.cdf(z), rtol=1e-9)
