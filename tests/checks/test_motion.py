"""Positions that jump, against waits, turns, sway, noise and late poses; windows that move in steps."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from workbench.checks import Consistency
from workbench.checks.motion import SURE, TWISTED_MM, _twist, consistency, jump_mm
from workbench.units import DEG, Float

TIME = np.arange(300) / 100.0
COUNT = 11
STEADY = np.stack([20.0 * TIME, 3.0 * np.sin(2.0 * TIME), 500.0 + 0.0 * TIME], axis=1)


STRAIGHT = STEADY * [1.0, 0.0, 1.0] + np.random.default_rng(7).normal(0.0, 0.02, STEADY.shape)
DROPPED = np.abs(TIME - 1.5) < 0.5


def of(place: Float, time: Float = TIME) -> float:
    return jump_mm(time, place, np.zeros(len(time), np.int64))


def after(k: int, by: Float) -> Float:
    return np.where(np.arange(len(TIME))[:, None] >= k, by, 0.0)


@pytest.mark.parametrize("by", [[-2.0, 0.0, 0.0], [0.6, 0.0, 0.0], [0.0, 1.0, 0.0]])
def test_a_slip_is_told(by: list[float]) -> None:
    assert of(STEADY + after(120, np.array(by))) == pytest.approx(np.linalg.norm(by), abs=0.01)
    noisy = STRAIGHT + after(150, np.array(by))
    assert of(noisy[~DROPPED], TIME[~DROPPED]) == pytest.approx(np.linalg.norm(by), abs=0.2)


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
    for sway_mm in (0.0, 0.3):  # of a dense stream a second is missing
        assert of((STRAIGHT + sway_mm * np.sin(4.0 * TIME)[:, None])[~DROPPED], TIME[~DROPPED]) < 0.5
    assert of(STEADY[:2], TIME[:2]) == 0.0
    last = np.append(TIME, TIME[-1] + 1e-4)  # a pose right before the end: what it moved is noise
    steady = np.vstack([STEADY, STEADY[-1]]) + np.random.default_rng(6).normal(0.0, 0.02, (301, 3))
    assert all(of(np.roll(steady, k, axis=1) * [1, -1, 1], last) < 0.5 for k in range(3))


def twist(turn_deg: float, length_mm: float, u_deg: float = 0.0) -> tuple[float, float]:
    """Of a straight way along x over which a direction turns evenly about it, each place's turn uncertain by u."""
    turn = np.linspace(0.0, turn_deg * DEG, COUNT)
    across = np.column_stack([0.2 + 0.0 * turn, np.cos(turn), np.sin(turn)])
    way: Any = SimpleNamespace(tangent=np.tile([1.0, 0.0, 0.0], (COUNT, 1)), arc_mm=np.linspace(0.0, length_mm, COUNT))
    return _twist(across, way, np.zeros(COUNT, np.int64), np.full(COUNT, u_deg * DEG))


@pytest.mark.parametrize("turn_deg", [2.0, -2.0])
def test_a_turn_counts_over_the_length_that_a_twist_is_told_of(turn_deg: float) -> None:
    assert twist(turn_deg, 0.5 * TWISTED_MM)[0] == pytest.approx(2.0)
    assert twist(turn_deg, 2.0 * TWISTED_MM)[0] == pytest.approx(1.0)
    assert twist(turn_deg, 0.5 * TWISTED_MM)[1] == pytest.approx(0.0, abs=1e-9)  # a slow function of the place


def test_what_is_uncertain_of_the_steps_is_taken_off() -> None:
    u_deg = 0.05
    known = 2.0 - SURE * u_deg * np.sqrt(COUNT - 1.0)
    assert known > 0.5
    assert twist(2.0, 0.5 * TWISTED_MM, u_deg)[0] == pytest.approx(known)
    assert twist(2.0, 0.5 * TWISTED_MM, 20.0 * u_deg) == (0.0, 0.0)


def _carried(aside_mm: Float) -> Consistency:
    """Of an edge that lies `aside_mm` (k,) beside the straight way of a robot whose profiles are 1 mm apart."""
    count = len(aside_mm)
    pose = np.repeat(np.eye(4)[None], count, axis=0)
    pose[:, 1, 3] = np.arange(count)
    track = (np.column_stack([aside_mm, np.zeros(count)]), np.zeros(count), np.zeros(count, dtype=int))
    return consistency({0: SimpleNamespace(track=track, turn_u=np.zeros(count))}, {0: pose})


def test_ramps_are_no_turn_of_the_laser_plane() -> None:
    """An edge cut in parts goes 2 mm to the side and back on ramps of 22 deg: of the robot that says nothing."""
    along = np.arange(130.0)
    uncut = sum(np.clip(6.0 - np.abs(along - at), 0.0, 5.0) * 0.4 for at in (25.0, 60.0, 95.0))
    assert _carried(uncut).varies_deg < 8.0
    turning = 0.5 * along**2 / 130.0  # 0 to 45 deg, as of an orientation that was held along an arc
    assert _carried(turning).varies_deg > 15.0
