"""Planning in `make metrology` in small: a few parts, with bounds wide enough for so few."""

from __future__ import annotations

import numpy as np
import pytest

from bench.drawn.plates import RAW_CONDITIONS, random_recipe
from bench.metrology.planning import GOALS, SPACING_GOAL, measure
from bench.score.face import MOST_TURNED_DEG, rough_upper_side
from workbench.synthetic import Workpiece, milled_truth
from workbench.units import DEG

WIDE = 3.0  # times the goal


@pytest.mark.parametrize("condition", ["raw_straight", "raw_arc"])
def test_a_planned_part(condition):
    check_plan(condition, 20_000)


@pytest.mark.metrology
@pytest.mark.parametrize("condition", [name for name in RAW_CONDITIONS if name not in ("raw_clamps", "raw_robot")])
def test_two_planned_parts(condition):
    for seed in (20_010, 20_011):
        check_plan(condition, seed)


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


def test_the_upper_side_is_known_roughly():
    angles = []
    for seed in range(30):
        truth = milled_truth(Workpiece(random_recipe("raw_arc", seed)))
        cosine = float(np.dot(rough_upper_side(truth), truth.across[0]))
        angles.append(np.arccos(min(cosine, 1.0)) / DEG)
    assert 6 < max(angles) <= MOST_TURNED_DEG + 1e-6
    assert min(angles) < 3
