"""Planning in `make metrology` in small: a few parts, with bounds wide enough for so few."""

from __future__ import annotations

import pytest

from bench.metrology.planning import GOALS, SPACING_GOAL, measure

WIDE = 3.0  # times the goal


@pytest.mark.parametrize("condition", ["raw_straight", "raw_arc"])
def test_a_planned_part(condition):
    check_plan(condition, 20_000)


def check_plan(condition, seed):
    found = measure(condition, seed)
    assert found["rejected"] is None
    distance_goal, axis_goal = GOALS[condition]
    assert found["distance_mm"] < WIDE * distance_goal
    assert found["axis_deg"] < WIDE * axis_goal
    assert found["spacing"] < SPACING_GOAL
    assert found["reachable_lost"] < 0.03
    assert not found["wrong_side"]
    assert found["blind"] == found["invented"] == 0
