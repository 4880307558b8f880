"""Burrs, lost ends and waves along the edge: told from the face's own end, and nothing told of smooth courses."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from workbench.edge.steps import Readings, _told, readings, waves_u
from workbench.geometry.course import fit_course
from workbench.units import Float

S = np.arange(0.0, 120.0, 2.0)
U = np.full(S.size, 0.009)


def read(value: Float, s: Float = S) -> tuple[Float, Readings]:
    """The course that takes all for the face's at S, and what the readings say beside it."""
    course = fit_course(s, value, U**2)
    return course.value(S), readings(s, value, U, course, S)


def noise(seed: int) -> Float:
    return np.random.default_rng(seed).normal(0.0, 0.006, S.size)


@settings(max_examples=20)
@given(st.integers(0, 2**32 - 1), st.floats(0.0, 0.05), st.floats(24.0, 200.0))
def test_a_wave_and_noise_are_the_faces_own(seed: int, amplitude: float, length: float) -> None:
    _, found = read(amplitude * np.sin(2.0 * np.pi * S / length) + noise(seed))
    assert np.abs(found.shift_mm).max() < 0.01
    assert found.u_mm.max() < 0.02
    assert found.own.min() > 0.4


@settings(max_examples=20)
@given(st.integers(0, 2**32 - 1), st.floats(0.1, 1.0), st.sampled_from([-1.0, 1.0]), st.integers(10, 35))
def test_a_stretch_off_the_rest_is_read_as_the_rest(seed: int, height: float, sense: float, first: int) -> None:
    cells = np.arange(S.size)
    value, found = read(sense * height * ((cells >= first) & (cells < first + 12)) + noise(seed))
    off = np.abs(value + found.shift_mm)
    assert (off[[2, first + 6, -3]] < 0.02 + 3.0 * found.u_mm[[2, first + 6, -3]]).all()


@pytest.mark.parametrize("seed", range(4))
def test_a_ragged_burr_on_half_of_the_edge_moves_no_end(seed: int) -> None:
    rng = np.random.default_rng(seed)
    burr = 0.1 * np.clip(np.convolve(rng.normal(0.0, 1.0, S.size + 2), np.ones(3) / np.sqrt(3.0), "valid"), 0.0, 2.0)
    value, found = read(burr + noise(seed))
    assert np.abs(value + found.shift_mm).max() < 0.03
    assert found.own[burr > 0.08].max() < 0.2


def test_where_halves_of_an_edge_lie_apart_either_may_be_the_faces_own() -> None:
    value, found = read(-0.4 * (S > 59.0) + noise(2))
    for place in (5, 55):
        assert found.u_mm[place] > 0.1
        assert abs(value[place] + found.shift_mm[place]) < 2.5 * found.u_mm[place]
        assert abs(value[place] + found.shift_mm[place] + 0.4) < 2.5 * found.u_mm[place]


def test_a_few_lost_cells_turn_no_face() -> None:
    """A reading by which the face runs away, and most of the edge with it, is none."""
    cells = np.arange(S.size)
    value, found = read(np.where((cells > 10) & (cells < 14), -1.1, 0.0) + noise(3) / 6.0)
    assert np.abs(value + found.shift_mm).max() < 0.03


@pytest.mark.parametrize("cells", [0, 2, 7, 20, 30])
def test_a_chain_of_cells_is_the_same_from_either_end(cells: int) -> None:
    off = noise(cells) + np.where(np.arange(S.size) < cells, 0.3, 0.0) + 0.1 * (S > 90.0) * np.sin(S)
    forth, back = _told(off, U, 0.02), _told(off[::-1], U, 0.02)
    assert forth.evidence == pytest.approx(back.evidence)
    for one, other in zip(forth[1:], back[1:], strict=True):
        assert one == pytest.approx(other[::-1], abs=1e-9)


@pytest.mark.parametrize("length_frames", [4.0, 9.0])
def test_a_wave_that_frames_share_is_told_and_noise_is_not(length_frames: float) -> None:
    rng = np.random.default_rng(4)
    s, passes = np.arange(400.0) / 5.0, np.zeros(400, np.int64)
    noise = rng.normal(0.0, 0.01, 400)
    wave = 0.03 * np.sin(2.0 * np.pi * np.arange(400) / length_frames)
    assert waves_u(s, noise, passes, 0.0) == 0.0
    assert waves_u(s, noise + wave, passes, 0.0) == pytest.approx(0.03 / np.sqrt(2.0), rel=0.3)
