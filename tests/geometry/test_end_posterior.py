"""How well a face's end is known: over many simulated edges the truth lies within 2u as often as it should."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from workbench.geometry.end_posterior import WINDOW, end_at
from workbench.geometry.ends import Ends, fit_end
from workbench.geometry.settling import settled
from workbench.units import Float

STEP_MM, PITCH_MM, LENGTH_MM = 0.05, 0.2, 100.0
S = np.arange(0, LENGTH_MM, PITCH_MM)


def course(rng: np.random.Generator) -> Float:
    """A root size that drifts by up to 0.25 mm and waves by up to 0.15 mm."""
    drift, waves = rng.uniform(-0.25, 0.25), rng.uniform(0, 0.15)
    sine = np.sin(2 * np.pi * S / rng.uniform(80, 200) + rng.uniform(0, 6.3))
    return np.asarray(1.5 + drift * S / LENGTH_MM + waves * sine)


def ends_of(end: Float, phase: Float, noise_mm: float, rng: np.random.Generator) -> Ends:
    """The last column before `end`, of columns at `phase` plus multiples of the step; noise as in an edge's frames."""
    column = np.floor((end - phase) / STEP_MM)
    low = phase + STEP_MM * column + rng.normal(0, noise_mm, S.size)
    same, none = np.ones(S.size), np.zeros(S.size, np.int64)
    low, step, sigma, weight = settled(low, STEP_MM * same, noise_mm * same, column.astype(np.int64), none)
    return Ends(S, low, step, sigma, 0.02 * same, weight)


def corners_of(end: Float, noise_mm: float, rng: np.random.Generator) -> Ends:
    same = np.ones(S.size)
    return Ends(S, end + rng.normal(0, noise_mm, S.size), 0 * same, noise_mm * same, 0.02 * same, same)


@pytest.mark.parametrize("kind", ["every phase", "drifting phase", "corners"])
def test_coverage(kind: str) -> None:
    inside, errors, us = [], [], []
    for seed in range(70):
        rng = np.random.default_rng([seed, 17])
        end = course(rng)
        if kind == "corners":
            ends = corners_of(end, 0.008, rng)
        else:
            every = rng.uniform(0, STEP_MM, S.size)
            phase = every if kind == "every phase" else rng.uniform(0.001, 0.01) * rng.choice([-1, 1]) * S
            ends = ends_of(end, phase, 0.004, rng)
        at = rng.choice(S[10:-10], 3)
        value, u = end_at(ends, fit_end(ends), at)
        error = value - np.interp(at, S, end)
        inside += list(np.abs(error) <= 2 * u)
        errors += list(error)
        us += list(u)
    assert np.mean(inside) > 0.9
    rms = np.sqrt(np.mean(np.square(errors)))
    assert np.median(us) < 1.5 * rms  # not safe by being huge
    assert np.max(us) < 0.3 * STEP_MM
    if kind != "drifting phase":
        assert rms < 0.04 * STEP_MM
        assert np.mean(inside) < 0.995


@pytest.mark.parametrize("noise_mm", [0.001, 0.004, 0.012])
@pytest.mark.parametrize("inside", [0.05, 0.5, 0.95])
def test_one_phase_tells_no_more_than_one_frame(noise_mm: float, inside: float) -> None:
    """All frames cut the face between the same two columns: the end may lie anywhere in that step, however many."""
    rng = np.random.default_rng(2)
    ends = ends_of(1.5 + inside * STEP_MM + 0 * S, 0 * S, noise_mm, rng)
    value, u = end_at(ends, fit_end(ends), np.array([20.0, 50.0, 80.0]))
    flat = 0.9545 * STEP_MM / 4  # of a uniform distribution over the step
    assert (u > 0.9 * flat).all()
    assert (u < 1.6 * flat).all()
    assert (np.abs(value - 1.5 - inside * STEP_MM) < 2 * u).all()


def test_corners_as_least_squares_says() -> None:
    """In the middle of a window of n frames a quadratic knows its value to 3/2 sigma / sqrt(n)."""
    rng = np.random.default_rng(3)
    noise, end = 0.005, 1.5 + 0 * S
    ends = corners_of(end, noise, rng)
    fit = fit_end(ends)
    _, u = end_at(ends, fit, np.array([50.0]))
    n = 2 * WINDOW * fit.knots_mm / PITCH_MM
    assert u[0] == pytest.approx(1.5 * noise / np.sqrt(n), rel=0.15)
    _, doubled = end_at(replace(ends, weight=0.25 * ends.weight), fit, np.array([50.0]))
    assert doubled[0] / u[0] == pytest.approx(2, rel=0.1)


def test_less_is_known_at_the_ends_and_in_gaps_and_nothing_far_from_frames() -> None:
    rng = np.random.default_rng(4)
    whole = corners_of(1.5 + 0 * S, 0.005, rng)
    fit = fit_end(whole)
    seen = (S < 30) | (S > 90)
    part = Ends(*(getattr(whole, name)[seen] for name in ("s", "low", "step", "sigma", "missing", "weight")))
    _, full = end_at(whole, fit, np.array([0.0, 15.0, 28.0, 60.0]))
    value, u = end_at(part, fit, np.array([0.0, 15.0, 28.0, 60.0]))
    assert full[0] > 1.5 * full[1]
    assert u[2] > 1.3 * full[2]
    assert np.isnan(value[3])
    assert np.isnan(u[3])
    assert np.isfinite(full[3])


def test_the_course_only_starts_the_search() -> None:
    """A course that is off by a good part of a step gives the same end."""
    rng = np.random.default_rng(5)
    ends = ends_of(course(rng), rng.uniform(0, STEP_MM, S.size), 0.004, rng)
    fit, at = fit_end(ends), np.array([30.0, 60.0])
    off = replace(fit, spline=type(fit.spline)(fit.spline.t, fit.spline.c + 0.4 * STEP_MM, 3))
    value, u = end_at(ends, fit, at)
    again, u_again = end_at(ends, off, at)
    np.testing.assert_allclose(again, value, rtol=0, atol=5e-4)
    np.testing.assert_allclose(u_again, u, rtol=0.15)


@pytest.mark.parametrize("ramp_mm", [1.0, 10.0])
def test_a_stretch_that_leaves_the_course_is_seen_or_said_to_be_uncertain(ramp_mm: float) -> None:
    """120 frames in a row say 0.8 mm where their neighbours say 1.5 mm: no value may stand there with a small u."""
    rng = np.random.default_rng(6)
    end = 1.5 - 0.7 * np.clip((12 - np.abs(S - 50)) / ramp_mm, 0, 1)
    ends = ends_of(end, rng.uniform(0, STEP_MM, S.size), 0.004, rng)
    value, u = end_at(ends, fit_end(ends), np.array([50.0]))
    assert not np.isfinite(u[0]) or abs(value[0] - 0.8) < 3 * u[0]
