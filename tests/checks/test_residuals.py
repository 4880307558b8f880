"""What frames leave together, against noise and what edges do."""

from __future__ import annotations

import numpy as np
import pytest

from bench.faulty import KINDS, outcome
from tests.seldom import seldom
from workbench.checks.residuals import every_second

FRAMES = 400
ONE = np.zeros(FRAMES, np.int64)


def test_every_second_frame() -> None:
    noise = np.random.default_rng(4).normal(0.0, 0.03, FRAMES)
    assert every_second(noise, ONE) == 0.0
    assert every_second(noise + np.where(np.arange(FRAMES) % 2, 0.06, 0.0), ONE) == pytest.approx(0.03, abs=0.005)
    assert every_second(noise[:30], ONE[:30]) == 0.0


@pytest.mark.parametrize(
    ("kind", "seed", "is_raw"),
    [
        ("slips", 102, True),
        ("alternates", 104, True),
        ("ms late", 457, False),
        ("chatter", 106, False),
        *seldom(("slips", 108, True)),
    ],
)
def test_what_was_confidently_wrong_is_within_its_uncertainty(kind: str, seed: int, is_raw: bool) -> None:
    """By 52, 6, 41, 4 and 25 u."""
    (name,) = [one for one in KINDS if kind in one]
    found = outcome(name, seed, is_raw)
    assert not found.refused
    assert 0.5 < found.worst < 3.0


def test_frames_that_alternate_are_no_smoothing_filter() -> None:
    found = outcome("exposure alternates", 104, False)
    assert "smoothing" not in found.refused
    assert found.worst < 3.0
