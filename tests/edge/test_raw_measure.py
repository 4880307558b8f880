"""A rough end face as its local least-squares plane; single frames beside the others."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from workbench.artefacts import ROOT_FACE
from workbench.edge.directions import LOCAL_MM, go_together
from workbench.edge.raw_local import local_mean
from workbench.edge.raw_measure import _in_patches, running_median, unevenness
from workbench.geometry.chains import FaceLines

RNG = np.random.default_rng(8)
S = np.sort(RNG.uniform(0.0, 120.0, 400))
ONE_PASS = np.zeros(S.size, np.int64)


@pytest.mark.parametrize("wavelength_mm", [25.0, 43.0, 80.0])
def test_a_rough_face_is_the_mean_over_its_window(wavelength_mm: float) -> None:
    """A wave comes through as a mean over 20 mm leaves it, whatever its length."""
    k = 2.0 * np.pi / wavelength_mm
    course = local_mean(S, 0.02 * np.sin(k * S) + RNG.normal(0.0, 0.004, S.size), ONE_PASS)
    at = np.linspace(15.0, 105.0, 60)
    left = np.sin(k * LOCAL_MM / 2.0) / (k * LOCAL_MM / 2.0)
    off = course.value(at) - 0.02 * left * np.sin(k * at)
    assert np.sqrt(np.mean((off / course.u(at)) ** 2)) < 1.5
    assert np.abs(off).max() < 0.004


def test_a_rough_face_that_turns_keeps_its_direction_at_its_ends() -> None:
    course = local_mean(S, 0.003 * S + RNG.normal(0.0, 0.004, S.size), ONE_PASS)
    ends = np.array([0.5, 119.5])
    assert np.abs(course.value(ends) - 0.003 * ends).max() < 3.0 * course.u(ends).max()
    assert np.abs(course.value(ends) - 0.003 * ends).max() < 0.005


def test_more_is_uncertain_where_less_of_the_window_is_seen() -> None:
    value = np.cumsum(RNG.normal(0.0, 0.01, S.size)) * 0.1
    gone = (S > 50.0) & (S < 62.0)
    course = local_mean(S, np.where(gone, np.nan, value), ONE_PASS)
    assert course.u(np.array([0.0])) > 1.5 * course.u(np.array([25.0]))
    assert course.u(np.array([49.0])) > 1.5 * course.u(np.array([25.0]))


@pytest.mark.parametrize(("length_mm", "expected"), [(0.2, False), (8.0, True), (12.0, True)])
def test_texture_does_not_reach_from_frame_to_frame_and_what_a_flame_cut_leaves_does(
    length_mm: float, expected: bool
) -> None:
    rng = np.random.default_rng(31)
    s = np.sort(rng.uniform(0.0, 120.0, 400))
    s[::9] = np.nan
    phases = rng.uniform(0.0, 2.0 * np.pi, 40)
    waves = np.nan_to_num(s)[:, None] * 2.0 * np.pi / (length_mm * rng.uniform(0.7, 1.4, 40)) + phases
    face = 0.002 * np.sin(waves).sum(axis=1) / np.sqrt(20.0)
    turning = 0.003 * np.nan_to_num(s)  # a plate that turns along its edge is not rough
    noise = rng.normal(0.0, 0.002, s.size)
    passes = (np.arange(s.size) > 200).astype(np.int64)
    variance = np.full(s.size, 0.002**2)
    assert go_together(s, face + turning + noise, variance, passes) == expected
    assert not go_together(s, turning + noise, variance, passes)


def test_a_running_median_leaves_strays_out_and_bridges_gaps() -> None:
    s = np.arange(0.0, 30.0, 0.5)
    value = np.where(s < 15.0, 1.0, 2.0)
    value[::7] = 9.0
    value[(s > 20.0) & (s < 25.0)] = np.nan
    assert running_median(s, value, np.array([5.0, 10.0, 18.0, 22.5, 27.0]), 1.5) == pytest.approx([1, 1, 2, 2, 2])


def test_frames_too_far_apart_for_a_median_stand_for_themselves() -> None:
    s, value = np.array([0.0, 10.0, 20.0, 30.0]), np.array([1.0, 2.0, 3.0, 4.0])
    assert running_median(s, value, np.array([5.0, 15.0, 25.0]), 1.0) == pytest.approx([1.5, 2.5, 3.5])


@pytest.mark.parametrize("drops", [True, False])
def test_drops_here_and_there_are_no_roughness(drops: bool) -> None:
    rng, frames, columns = np.random.default_rng(4), 300, 200
    waves = np.exp(-((np.arange(-15.0, 16.0) / 6.0) ** 2))
    height = np.apply_along_axis(np.convolve, 1, rng.normal(0.0, 0.01, (frames, columns)), waves, "same")
    if drops:  # two in five stretches are clear of them
        height[np.arange(frames) // 20 % 5 < 2] = 0.0
    z = height + rng.normal(0.0, 0.01, height.shape)
    x = np.linspace(0.0, 10.0, columns) - 5.0
    one = np.ones(frames)
    szz, sxz = ((z - z.mean(axis=1, keepdims=True)) ** 2).sum(axis=1), (z * x).sum(axis=1)
    count, span = columns * one.astype(np.int64), np.zeros((frames, 2), np.int64)
    face = FaceLines(count, 0.0 * one, z.mean(axis=1), (x**2).sum() * one, sxz, szz, span)
    assert _in_patches(SimpleNamespace(faces={ROOT_FACE: face}), 0.01) == drops


def test_a_part_that_begins_to_vibrate_is_known_less_there() -> None:
    off, at = np.random.default_rng(2).normal(0.0, 0.01, S.size), np.array([10.0, 60.0, 110.0])
    even, later = (
        SimpleNamespace(s_face=S, stands_out_mm=one, out=SimpleNamespace(value=np.zeros_like), rough=False)
        for one in (off, np.where(S > 100.0, 5.0 * off, off))
    )
    assert (unevenness(even, at) == 1.0).all()
    assert (unevenness(later, at)[:2] == 1.0).all()
    assert unevenness(later, at)[2] == pytest.approx(5.0, rel=0.3)
