"""Positions that jump, against waits, turns, sway, noise and late poses; windows that move in steps."""

from __future__ import annotations

import numpy as np
import pytest

from workbench.checks.motion import jump_mm
from workbench.checks.window import end_step_check
from workbench.units import Float

TIME = np.arange(300) / 100.0
STEADY = np.stack([20.0 * TIME, 3.0 * np.sin(2.0 * TIME), 500.0 + 0.0 * TIME], axis=1)


def of(place: Float, time: Float = TIME) -> float:
    return jump_mm(time, place, np.zeros(len(time), np.int64))


def after(k: int, by: Float) -> Float:
    return np.where(np.arange(len(TIME))[:, None] >= k, by, 0.0)


@pytest.mark.parametrize("by", [[-2.0, 0.0, 0.0], [0.6, 0.0, 0.0], [0.0, 1.0, 0.0]])
def test_a_slip_is_told(by: list[float]) -> None:
    assert of(STEADY + after(120, np.array(by))) == pytest.approx(np.linalg.norm(by), abs=0.01)


def test_what_robots_do_is_no_jump() -> None:
    noise = np.random.default_rng(3).normal(0.0, 0.3, STEADY.shape)
    back = np.stack([20.0 * np.abs(TIME - 1.5), 0.0 * TIME, 0.0 * TIME], axis=1)
    held = STEADY.copy()
    held[150] = held[149]  # one pose late
    hung = STEADY.copy()
    hung[100:160] = hung[99]
    slows = STEADY.copy()  # at the end, as one that is about to stop
    slows[-1] = slows[-2] + 0.5 * (slows[-2] - slows[-3])
    waits = np.sort(np.random.default_rng(4).choice(3000, 300, replace=False)) / 100.0
    for place in (STEADY, STEADY + noise, back, held, hung, 10.0 * slows):
        assert of(place) < 0.5
    assert of(STEADY, waits) < 0.5  # stop and go
    assert of(STEADY[:2], TIME[:2]) == 0.0
    last = np.append(TIME, TIME[-1] + 1e-4)  # a pose right before the end: what it moved is noise
    steady = np.vstack([STEADY, STEADY[-1]]) + np.random.default_rng(6).normal(0.0, 0.02, (301, 3))
    assert all(of(np.roll(steady, k, axis=1) * [1, -1, 1], last) < 0.5 for k in range(3))


def test_a_window_that_follows_the_part_in_steps_is_told() -> None:
    rng = np.random.default_rng(5)
    moves = 300.0 + 40.0 * np.sin(TIME) + rng.normal(0.0, 0.3, TIME.size)
    steps = (moves // 16 * 16).astype(np.int64)
    steps[::9] += 3  # returns lost there
    assert end_step_check(steps).value == 16
    assert not end_step_check(steps).passed
    for good in (
        moves.astype(np.int64),
        np.full(300, 320),
        np.full(5, 8),
        300 + rng.integers(0, 2, 300),
        304 + 8 * rng.integers(0, 2, 300),
    ):
        assert end_step_check(good).passed
