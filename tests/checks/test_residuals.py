"""What frames leave together: slips, alternating exposures and short waves, against noise and what edges do."""

from __future__ import annotations

import numpy as np
import pytest

from bench.faulty import KINDS, outcome
from workbench.checks.residuals import every_second, steps_mm, together_u
from workbench.units import Float

FRAMES = 400
S = np.linspace(0.0, 80.0, FRAMES)
ONE = np.zeros(FRAMES, np.int64)


def of(across: Float, noise_mm: float = 0.02) -> Float:
    """What steps make uncertain of places along y and along z, which hold noise alone."""
    noise = np.random.default_rng(3).normal(0.0, noise_mm, (2, FRAMES))
    place = np.stack([S, across + noise[0], noise[1]], axis=1)
    return steps_mm(S, [[(place, np.tile(axis, (FRAMES, 1)))] for axis in np.eye(3)[1:]], ONE)


@pytest.mark.parametrize("over", [1, 8])
def test_a_slip_is_in_the_uncertainty_on_both_sides(over: int) -> None:
    slipped = 0.2 * np.clip((np.arange(FRAMES) - 250) / over, 0.0, 1.0)
    found = of(slipped + 1e-4 * S**2)
    assert found[:, 0] == pytest.approx(np.full(FRAMES, 0.2 / np.sqrt(2.0)), rel=0.15)
    assert found[:, 1].max() < 0.03


@pytest.mark.parametrize("across", [0.0 * S, 1e-3 * S**2, 1.5 * np.sin(S / 9.0), np.hypot(300.0, S) - 300.0])
def test_edges_that_bend_do_not_step(across: Float) -> None:
    assert not of(across).any()


def test_what_covers_one_end_of_a_face_is_no_slip() -> None:
    noise = np.random.default_rng(6).normal(0.0, 0.02, (2, FRAMES))
    covered = np.where(np.abs(S - 40.0) < 8.0, 2.0, 0.0)
    ends = [np.stack([S, one, 0.0 * S], axis=1) for one in (covered + noise[0], 10.0 + noise[1])]
    y = np.tile([0.0, 1.0, 0.0], (FRAMES, 1))
    assert not steps_mm(S, [[(end, y) for end in ends]], ONE).any()
    gone = np.abs(S - 40.0) > 8.0  # what lies under a clamp is not there to tell
    bent = np.stack([S, 1e-4 * (S - 40.0) ** 3 + noise[0], 0.0 * S], axis=1)[gone]
    assert not steps_mm(S[gone], [[(bent, y[gone])]], ONE[gone]).any()


def test_every_second_frame() -> None:
    noise = np.random.default_rng(4).normal(0.0, 0.03, FRAMES)
    assert every_second(noise, ONE) == 0.0
    assert every_second(noise + np.where(np.arange(FRAMES) % 2, 0.06, 0.0), ONE) == pytest.approx(0.03, abs=0.005)
    assert every_second(noise[:30], ONE[:30]) == 0.0


@pytest.mark.parametrize("length_mm", [0.5, 1.0, 3.0])
def test_waves_that_no_course_follows_are_in_the_uncertainty(length_mm: float) -> None:
    noise = np.random.default_rng(5).normal(0.0, 0.02, FRAMES)
    at = np.linspace(5.0, 75.0, 20)
    wave = 0.05 * np.sin(2.0 * np.pi / length_mm * S)
    assert together_u(S, noise + wave, ONE, at) == pytest.approx(np.full(20, 0.05 / np.sqrt(2.0)), rel=0.4)
    assert not together_u(S, noise, ONE, at).any()
    late = together_u(S, noise + np.where(S > 60.0, 2.0 * wave, 0.0), ONE, at)
    assert late[-2] > max(0.03, 1.2 * late[0])  # most where it chatters


@pytest.mark.parametrize(
    ("kind", "seed", "is_raw"),
    [
        ("slips", 102, True),
        ("slips", 108, True),
        ("alternates", 104, True),
        ("ms late", 457, False),
        ("chatter", 106, False),
    ],
)
def test_what_was_confidently_wrong_is_within_its_uncertainty(kind: str, seed: int, is_raw: bool) -> None:
    """By 52, 25, 6, 41 and 4 u."""
    (name,) = [one for one in KINDS if kind in one]
    found = outcome(name, seed, is_raw)
    assert not found.refused
    assert 0.5 < found.worst < 3.0


def test_frames_that_alternate_are_no_smoothing_filter() -> None:
    assert "every second one" in outcome("exposure alternates", 104, False).refused
