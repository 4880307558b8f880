"""Steps and waves along the edge: found where they are, and nothing found in smooth courses."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from workbench.edge.steps import level_doubt, steps, waves_u

S = np.arange(0.0, 120.0, 2.0)
U = np.full(S.size, 0.004)


@given(st.integers(0, 2**32 - 1), st.floats(0.0, 0.1), st.floats(24.0, 200.0))
def test_a_wave_is_no_step(seed: int, amplitude: float, length: float) -> None:
    noise = np.random.default_rng(seed).normal(0.0, 0.004, S.size)
    assert steps(S, amplitude * np.sin(2.0 * np.pi * S / length) + noise, U) == []


@given(st.integers(0, 2**32 - 1), st.floats(0.06, 1.0), st.sampled_from([-1.0, 1.0]), st.integers(8, 50))
def test_a_step_is_found_where_it_is(seed: int, height: float, sense: float, at: int) -> None:
    noise = np.random.default_rng(seed).normal(0.0, 0.004, S.size)
    [(place, found)] = steps(S, sense * height * (at <= np.arange(S.size)) + noise, U)
    assert place == pytest.approx(S[at] - 1.0, abs=2.0)
    assert found == pytest.approx(sense * height, abs=0.02)


def test_what_lies_off_most_of_the_edge_is_half_way_to_it() -> None:
    at = np.linspace(0.0, 100.0, 101)
    shift, u = level_doubt([(30.0, -0.4), (50.0, 0.4)], at)
    inside = (at >= 30.0) & (at < 50.0)
    assert shift[inside] == pytest.approx(0.2)
    assert u[inside] == pytest.approx(0.2)
    assert shift[~inside] == pytest.approx(0.0)
    assert u[~inside].max() < 0.03


def test_no_step_leaves_no_doubt() -> None:
    assert not np.any(level_doubt([], np.arange(5.0)))


@pytest.mark.parametrize("length_frames", [4.0, 9.0])
def test_a_wave_that_frames_share_is_told_and_noise_is_not(length_frames: float) -> None:
    rng = np.random.default_rng(4)
    s, passes = np.arange(400.0) / 5.0, np.zeros(400, np.int64)
    noise = rng.normal(0.0, 0.01, 400)
    wave = 0.03 * np.sin(2.0 * np.pi * np.arange(400) / length_frames)
    assert waves_u(s, noise, passes, 0.0) == 0.0
    assert waves_u(s, noise + wave, passes, 0.0) == pytest.approx(0.03 / np.sqrt(2.0), rel=0.3)
