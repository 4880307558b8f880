"""The end face's line in a profile, beside what stands on it."""

from __future__ import annotations

import math

import numpy as np
import pytest

from workbench.geometry.end_face import GATES_MM, LEAST_WIDTH_MM, _level, _settle
from workbench.units import Float

NOISE_MM = 0.005


def settled(across: Float, along: Float) -> tuple[float, int, float]:
    """Slope of the line found, how many points lie from its first to its last (0: no face), and the gate, mm."""
    level, _ = _level(along, across, along.size, 1.0)
    _, slope, first, last, gate, _ = _settle(along, across, along.size, level, True)
    return slope, last - first + 1, gate


@pytest.mark.parametrize("share", [0.1, 0.25, 0.4])
@pytest.mark.parametrize("height_mm", [0.3, 0.5, 0.7])
@pytest.mark.parametrize("place", ["lower", "middle", "upper"])
def test_a_streak_of_stray_returns_does_not_turn_the_face(share: float, height_mm: float, place: str) -> None:
    rng = np.random.default_rng(3)
    along = np.arange(120) * 0.05
    across = 0.02 * along + rng.normal(0.0, NOISE_MM, along.size)
    streak = round(share * along.size)
    begin = {"lower": 6, "middle": (along.size - streak) // 2, "upper": along.size - streak - 6}[place]
    across[begin : begin + streak] += height_mm
    slope, count, gate = settled(across, along)
    assert slope == pytest.approx(0.02, abs=0.004)
    assert gate < 0.2 * GATES_MM[0]
    left = (1.0 - share) * along.size / (2.0 if place == "middle" else 1.0)  # what it parts is no longer one run
    assert count >= 0.9 * left or (count == 0 and left * 0.05 < LEAST_WIDTH_MM)


def test_a_rough_face_keeps_its_points() -> None:
    """Waves of 0.25 mm: no part of them is a streak."""
    along = np.arange(200) * 0.05
    across = 0.02 * along + 0.25 * np.sin(2.0 * math.pi * along / 2.3)
    slope, count, gate = settled(across, along)
    assert slope == pytest.approx(0.02, abs=0.01)
    assert (count, gate) == (200, 0.6)
