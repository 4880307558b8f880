"""Where a face ends, from columns that only bracket it: against ends that are known (and see tests/laws)."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from workbench.edge.steps import readings
from workbench.geometry.course import fit_course
from workbench.geometry.silhouette import EndCourse, Ends, find_end, settled
from workbench.units import Float

Truth = Callable[[Float], Float]
LENGTH_MM, PITCH_MM, STEP_MM, SIGMA_MM = 120.0, 0.3, 0.05, 0.005
INSIDE = np.linspace(5.0, 115.0, 111)
RISK = 1e-3  # that a sound estimator fails one of these tests

COLUMN_MM, FRAME_MM, EDGE_MM = 0.05, 0.2, 100.0
S = np.arange(0, EDGE_MM, FRAME_MM)


def constant(s: Float) -> Float:
    return np.full(np.shape(s), 1.5)


def drift(s: Float) -> Float:
    return 1.4 + 0.0015 * s


def wave(s: Float) -> Float:
    return 1.5 + 0.05 * np.sin(2 * np.pi * s / 50.0)


def frames(
    truth: Truth, seed: int, skew_columns: float, sigma: float = SIGMA_MM, missing: float = 0.0, step: float = STEP_MM
) -> Ends:
    """Frames whose columns creep by `skew_columns` steps along the edge: how many phases they show.

    Noise of each frame's own is taken off as it is in use, by `settled`: frames at one phase scatter about one place.
    """
    rng = np.random.default_rng([seed, 9201])
    s = np.arange(0.0, LENGTH_MM, PITCH_MM)
    phase = rng.uniform(0.0, 1.0) + skew_columns * s / LENGTH_MM
    column = np.floor(truth(s) / step - phase) - (rng.geometric(1.0 - missing, s.size) - 1.0)
    low = (column + phase) * step + rng.normal(0.0, sigma, s.size)
    freed = settled(
        s,
        low,
        np.full(s.size, step),
        np.full(s.size, max(sigma, 1e-3)),
        column.astype(np.int64),
        np.zeros(s.size, np.int64),
    )
    return Ends(
        s,
        freed.low,
        freed.step,
        np.maximum(freed.sigma, 1e-3),
        np.full(s.size, max(missing, 0.02)),
        0.0 * s,
        freed.weight,
        freed.doubt,
    )


def found(ends: Ends) -> EndCourse:
    spread = ends.sigma**2 + ends.step**2 / 12.0
    return find_end(ends, fit_course(ends.s, ends.low + 0.5 * ends.step, spread))


@pytest.mark.parametrize("sigma", [0.0, 0.002, 0.005])
def test_one_phase_knows_no_more_than_the_column(sigma: float) -> None:
    """However many frames say it: the truth may lie anywhere within the step."""
    for seed in range(10):
        end = found(frames(constant, seed, 0.0, sigma)).course
        assert end.u(INSIDE).min() > 0.95 * STEP_MM / np.sqrt(12.0)
        assert (np.abs(end.value(INSIDE) - 1.5) < 0.5 * STEP_MM + 3.0 * sigma + 1e-3).all()


def test_corners_are_values() -> None:
    """Where a frame shows the corner itself, its step is 0, and the end is a weighted mean."""
    rng = np.random.default_rng(9203)
    ends = frames(drift, 3, 9.3)
    corners = ends._replace(
        low=drift(ends.s) + rng.normal(0.0, 0.01, ends.s.size),
        step=np.zeros(ends.s.size),
        sigma=np.full(ends.s.size, 0.01),
    )
    end = found(corners).course
    plain = fit_course(corners.s, corners.low, corners.sigma**2)
    np.testing.assert_allclose(end.value(INSIDE), plain.value(INSIDE), rtol=0, atol=2.0 * plain.u(INSIDE).max())
    assert (np.abs(end.value(INSIDE) - drift(INSIDE)) < 5.0 * end.u(INSIDE)).all()


@pytest.mark.parametrize("half_mm", [3.0, 6.0, 12.0])
@pytest.mark.parametrize("depth_mm", [0.3, 0.8])
def test_a_gouge_is_in_the_uncertainty_and_nothing_else(half_mm: float, depth_mm: float) -> None:
    """Returns that are lost look the same as an edge that is broken off; beside either it is known as before."""
    for seed in (5, 6):
        ends = frames(constant, seed, 9.3)
        end = found(ends._replace(low=ends.low - np.where(np.abs(ends.s - 60.0) < half_mm, depth_mm, 0.0)))
        near = 60.0 + half_mm * np.array([-1.1, -0.9, -0.7, -0.2, 0.0, 0.2, 0.7, 0.9, 1.1])
        away = INSIDE[np.abs(INSIDE - 60.0) > half_mm + 5.0]
        for at, u_mm in ((near, np.inf), (away, 0.03)):
            said = readings(end.s, end.middle, end.middle_u, at, end.course)
            true = constant(at) - np.where(np.abs(at - 60.0) < half_mm, depth_mm, 0.0)
            off, u = end.course.value(at) + said.shift_mm - true, np.hypot(end.course.u(at), said.u_mm)
            assert (np.abs(off) < 3.5 * u).all()
            assert u.max() < u_mm


def test_a_long_edge_that_waves_in_step_with_the_columns_is_followed() -> None:
    """The rounds swung by a whole column between a straight end and one that waves, and ended with either."""
    rng = np.random.default_rng(9205)
    s = np.arange(0.0, 1500.0, PITCH_MM)
    truth = 1.46 + 8e-5 * s + 0.04 * np.sin(2.0 * np.pi * s / 45.0)
    low = truth - 0.9 * STEP_MM + rng.normal(0.0, 0.001, s.size)
    step, sigma = np.full(s.size, STEP_MM), np.full(s.size, 1e-3)
    still = np.zeros(s.size, np.int64)
    freed = settled(s, low, step, sigma, still, still)
    ends = Ends(s, freed.low, freed.step, freed.sigma, np.full(s.size, 0.02), 0.0 * s, freed.weight, 0.0 * s)
    course = found(ends).course
    off = course.value(s) - truth
    assert off.std() < 0.15 * STEP_MM  # its shape; where in the step it lies nothing shows
    assert np.abs(off / course.u(s)).max() < 2.5
    assert course.u(s).max() < 0.5 * STEP_MM


def noisy_corner(rng: np.random.Generator, noise_mm: float) -> tuple[Float, Float, Float, Float]:
    """A constant end 1.52 seen in drifting columns: low with and without the corner's noise, its step, the column."""
    phase = 0.0031 * S + 0.3 * COLUMN_MM
    column = np.floor((1.52 - phase) / COLUMN_MM)
    exact = phase + COLUMN_MM * column
    return exact + rng.normal(0, noise_mm, S.size), exact, np.full(S.size, COLUMN_MM), column.astype(np.int64)


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
