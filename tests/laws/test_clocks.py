"""What two passes show alike at the same places is the plate, whatever the clocks do."""

from __future__ import annotations

import numpy as np
import pytest

from bench.score.measure import alone
from bench.score.outsider import raw
from tests.checks.test_late import FRAMES, TIME, late
from tests.seldom import seldom
from workbench.checks.residuals import late_check
from workbench.units import DEG

SWAY_S = 0.21  # in which the scanner sways about the edge by a radian of its wave


@pytest.mark.parametrize("lag_s", [-0.04, 0.02])
def test_a_plate_that_twists_as_the_scanner_sways_is_no_late_clock_where_a_second_pass_shows_it(lag_s: float) -> None:
    """Refused: a wave of 44 mm in the end face, as if poses came -0.58 to 0.59 s late."""
    twist = lag_s / SWAY_S * DEG * np.cos(TIME / SWAY_S)  # what so late poses would make of a plane in the first pass
    assert not late_check(late(np.zeros(FRAMES), twist)).passed
    assert late_check(late(np.zeros(FRAMES), twist, passes=2)).passed


@pytest.mark.parametrize("offset_s", [-0.04, 0.03])
def test_poses_that_come_late_are_refused_by_two_passes_too(offset_s: float) -> None:
    found = late(np.full(FRAMES, offset_s), passes=2)
    assert np.median(found.offset_s) == pytest.approx(offset_s, abs=0.01)
    assert not late_check(found).passed


def test_what_the_place_shows_of_a_lag_stays_where_two_passes_show_a_twist_alike() -> None:
    twist = 0.04 / SWAY_S * DEG * np.cos(TIME / SWAY_S)
    found = late(np.full(FRAMES, 0.02), twist, noise_mm=0.003, passes=2)
    assert late_check(found).passed
    assert np.median(found.offset_s) == pytest.approx(0.02, abs=0.002)


@pytest.mark.parametrize("seed", [12950004, *seldom(12960006)])
def test_a_turn_that_is_hardly_known_refuses_no_sound_raw_edge(seed: int) -> None:
    """Refused: 0.082 deg at a standard uncertainty of 0.073 deg, and 0.036 deg at 0.024 deg."""
    found = alone(raw(seed))
    assert not found.refused
    assert max(np.abs(one.error / one.u).max() for one in found.found.values()) < 2.5
