"""Errors that values along an edge share: a course against them, and steps."""

from __future__ import annotations

import numpy as np
import pytest

from workbench.geometry.course import Course, fit_course, likely_processes
from workbench.geometry.processes import Process, Shared
from workbench.units import Float

S = np.linspace(0.0, 90.0, 300)
SEEDS = range(6)


def drawn(seed: int, shared: Process, noise: float = 0.005) -> Float:
    """A slow wave, a draw of the process on its own grid, and noise."""
    rng = np.random.default_rng(seed)
    if shared.jerks:
        alike = np.exp(-(S[1] - S[0]) / shared.length_mm)
        process, steps = np.empty(S.size), rng.normal(size=S.size)
        process[0] = steps[0]
        for k in range(1, S.size):
            process[k] = alike * process[k - 1] + np.sqrt(1.0 - alike**2) * steps[k]
        return np.asarray(0.2 * np.sin(S / 25.0) + shared.strength * process + rng.normal(0.0, noise, S.size))
    grid = np.arange(-4.0 * shared.length_mm, 90.0 + 4.0 * shared.length_mm, 0.1 * min(shared.length_mm, 5.0))
    kernel = np.exp(-(((S[:, None] - grid) / shared.length_mm) ** 2))  # its square integrates to that correlation
    process = kernel @ rng.normal(size=grid.size) / np.sqrt((kernel[150] ** 2).sum())
    return np.asarray(0.2 * np.sin(S / 25.0) + shared.strength * process + rng.normal(0.0, noise, S.size))


def course(y: Float, *shared: Process) -> Course:
    return fit_course(S, y, orders=(2, 3), shared=Shared(processes=shared, may_step=True))


@pytest.mark.parametrize(("length_mm", "jerks"), [(1.0, False), (15.0, False), (50.0, True)])
def test_place_and_slope_are_as_uncertain_as_they_err(length_mm: float, jerks: bool) -> None:
    shared, at = Process(0.03, length_mm, jerks=jerks), np.linspace(2.0, 88.0, 15)
    off = []
    for seed in SEEDS:
        found = course(drawn(seed, shared), shared)
        place = (found.value(at) - 0.2 * np.sin(at / 25.0)) / found.u(at)
        slope = (found.slope(at) - 0.2 / 25.0 * np.cos(at / 25.0)) / found.slope_u(at)
        off.append([place, slope])
    place, slope = np.sqrt((np.array(off) ** 2).mean(axis=(0, 2)))
    assert 0.4 < place < 1.4
    assert 0.4 < slope < 2.1  # near the ends a sine bends more than the walks expect


def test_without_what_is_shared_the_course_would_be_too_sure() -> None:
    shared, at = Process(0.03, 15.0), np.linspace(2.0, 88.0, 15)
    off = [course(drawn(seed, shared)) for seed in SEEDS]
    rms = np.sqrt(np.mean([((c.value(at) - 0.2 * np.sin(at / 25.0)) / c.u(at)) ** 2 for c in off]))
    assert rms > 4.0


POSSIBLE = [Process(one, over) for one in (0.005, 0.012, 0.03, 0.07) for over in (1.5, 3.0, 6.0, 12.0, 24.0, 48.0)]
ONE_PASS = np.zeros(S.size, np.int64)


def costs(y: Float, *shared: Process) -> Float:
    """Mean interval scores of place and slope of the course under errors that values share."""
    at, found = np.linspace(2.0, 88.0, 15), course(y, *shared)
    assert (found.shared_u(at) < found.u(at)).all()
    off = [found.value(at) - 0.2 * np.sin(at / 25.0), found.slope(at) - 0.2 / 25.0 * np.cos(at / 25.0)]
    u = np.array([found.u(at), found.slope_u(at)])
    return np.asarray((4.0 * u + 40.0 * np.maximum(np.abs(off) - 2.0 * u, 0.0)).mean(axis=1))


@pytest.mark.parametrize(("length_mm", "jerks"), [(12.0, False), (50.0, True)])
def test_values_tell_whether_a_process_jerks(length_mm: float, jerks: bool) -> None:
    possible = [Process(0.03, length_mm, jerks=one) for one in (False, True)]
    told = [likely_processes(S, drawn(seed, possible[jerks]), ONE_PASS, possible) for seed in SEEDS]
    assert np.mean([sum(one.share for one in each if one.jerks == jerks) for each in told]) > 0.9


@pytest.mark.parametrize("length_mm", [1.5, 24.0])
def test_what_is_not_declared_costs_little_more(length_mm: float) -> None:
    declared, told = np.zeros((2, 2))
    for seed in SEEDS[:3]:
        y = drawn(seed, Process(0.03, length_mm))
        declared += costs(y, Process(0.03, length_mm))
        told += costs(y, *likely_processes(S, y, ONE_PASS, POSSIBLE))
    assert (told < 1.4 * declared).all()


@pytest.mark.parametrize(("height", "over_mm"), [(1.0, 4.0), (0.3, 4.0)])
def test_waves_of_the_edge_itself_are_not_the_robots(height: float, over_mm: float) -> None:
    """What is far more than a robot errs is the edge's, however short, whether errors are declared or told."""
    wave, errs = height * np.sin(S / over_mm), Process(0.012, 6.0)
    y = drawn(5, errs) + wave
    for shared in ((errs,), likely_processes(S, y, ONE_PASS, POSSIBLE)):
        found = course(y, *shared)
        off = found.value(S) - 0.2 * np.sin(S / 25.0) - wave
        assert np.abs(off / found.u(S)).max() < 3.0
        assert np.sqrt(np.mean(off**2)) < 0.03


def test_short_errors_that_values_do_not_have_are_not_told() -> None:
    told = likely_processes(S, drawn(6, Process(0.0, 5.0)), ONE_PASS, POSSIBLE)
    assert sum(one.share * one.strength**2 for one in told if one.length_mm < 10.0) < 0.002**2


def test_passes_beside_each_other_tell_the_strength() -> None:
    """What passes do not repeat is no course's."""
    y = np.concatenate([drawn(k, Process(0.03, 24.0)) for k in range(4)])
    told = likely_processes(np.tile(S, 4), y, np.repeat(np.arange(4), S.size), POSSIBLE)
    assert 0.02 < np.sqrt(sum(one.share * one.strength**2 for one in told)) < 0.045


@pytest.mark.parametrize("height", [0.1, 0.3])
def test_a_step_is_in_the_uncertainty(height: float) -> None:
    shared = Process(0.01, 5.0)
    assert 0.35 * height < course(drawn(2, shared) + height * (S > 40.0), shared).step_u < 0.8 * height


@pytest.mark.parametrize("bend", [0.0 * S, 1e-3 * S**2, 1.5 * np.sin(S / 9.0), np.hypot(300.0, S) - 300.0])
def test_edges_that_bend_do_not_step(bend: Float) -> None:
    shared = Process(0.02, 4.0)
    assert course(drawn(3, shared) + bend, shared).step_u < 0.01
