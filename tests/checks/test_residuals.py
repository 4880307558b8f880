"""What frames leave together, against noise and what edges do."""

from __future__ import annotations

import numpy as np
import pytest

from bench.faulty import KINDS
from bench.score.measure import Result, alone
from bench.score.outsider import plain
from tests.seldom import seldom
from workbench.checks.residuals import every_second

FLOOR = {"mm": 0.02, "deg": 0.1}  # below these no error matters
FRAMES = 400
ONE = np.zeros(FRAMES, np.int64)


def measured(kind: str, seed: int, is_raw: bool) -> Result:
    rng = np.random.default_rng([782, seed, list(KINDS).index(kind)])
    return alone(plain(KINDS[kind](seed, is_raw, rng), is_raw))


def worst(found: Result, *besides: str) -> float:
    """Greatest error over u, of errors that matter, of all but some sizes."""
    over = (
        np.abs(one.error / one.u)[np.abs(one.error) > FLOOR[name.rpartition("_")[2]]]
        for name, one in found.found.items()
        if name not in besides
    )
    return max(float(one.max(initial=0.0)) for one in over)


def test_every_second_frame() -> None:
    noise = np.random.default_rng(4).normal(0.0, 0.03, FRAMES)
    assert every_second(noise, ONE) == 0.0
    assert every_second(noise + np.where(np.arange(FRAMES) % 2, 0.06, 0.0), ONE) == pytest.approx(0.03, abs=0.005)
    assert every_second(noise[:30], ONE[:30]) == 0.0


@pytest.mark.parametrize(
    ("kind", "seed", "is_raw"),
    [
        ("slips", 102, True),
        ("ms late", 457, False),
        ("chatter", 106, False),
        *seldom(("alternates", 104, True), ("slips", 108, True)),
    ],
)
def test_what_was_confidently_wrong_is_within_its_uncertainty(kind: str, seed: int, is_raw: bool) -> None:
    """By 52, 41, 4, 6 and 25 u."""
    (name,) = [one for one in KINDS if kind in one]
    found = measured(name, seed, is_raw)
    assert not found.refused
    # Where an encoder slips, the heading of a raw edge is off by up to 6.7 u: its course follows the step.
    assert 0.5 < worst(found, *(["heading_deg"] if kind == "slips" else [])) < 3.0


def test_frames_that_alternate_are_no_smoothing_filter() -> None:
    found = measured("exposure alternates", 104, False)
    assert "smoothing" not in found.refused
    assert worst(found) < 3.0
