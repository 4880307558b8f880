"""Planning and the closed loop in `make metrology` in small: a few parts, with bounds wide enough for so few."""

from __future__ import annotations

import numpy as np
import pytest

from bench.drawn.plates import RAW_CONDITIONS, random_recipe
from bench.metrology.loop.part import (
    HAND_EYE_ERROR_MM,
    LoopResult,
    close_loop,
    compare,
    injected_offset_mm,
    measure_loop,
)
from bench.metrology.loop.summary import BEVEL_GOAL_DEG, LOOP_CONDITIONS, ROOT_GOAL_MM
from bench.metrology.part import inspect_as_a_user
from bench.metrology.planning.part import MOST_TURNED_DEG, measure_plan, rough_upper_side
from bench.metrology.planning.summary import GOALS
from workbench.synthetic import parse_recipe, simulate_recording
from workbench.synthetic.workpiece import build_truth
from workbench.units import DEG

WIDE = 3.0  # times the goal


@pytest.mark.parametrize("condition", ["raw_straight", "raw_arc"])
def test_a_planned_part(condition):
    check_plan(measure_plan(condition, 20_000))


@pytest.mark.metrology
@pytest.mark.parametrize("condition", [name for name in RAW_CONDITIONS if name not in ("raw_clamps", "raw_robot")])
def test_two_planned_parts(condition):
    for seed in (20_010, 20_011):
        check_plan(measure_plan(condition, seed))


def check_plan(result):
    assert (result.refused, result.crashed, result.rejected) == (None, None, None)
    distance_goal, axis_goal = GOALS[result.condition]
    assert result.distance_mm < WIDE * distance_goal
    assert result.axis_deg < WIDE * axis_goal
    assert result.spacing_error < 0.05
    assert result.reachable_covered > 0.97
    assert not result.wrong_side
    assert result.blind_points == result.stations_invented == 0


def test_a_short_loop_closes_and_shows_what_was_injected():
    part = {"kind": "raw", "length_mm": 36, "thickness_mm": 6, "curve": {"shape": "arc", "radius_mm": 300}}
    scan = {"from_mm": 1, "to_mm": 35, "elevation_deg": 42, "aim_mm": [-2, 3], "skew_mm": [-0.5, 0.5]}
    scan |= {"motion": "stream", "follow": "edge"}
    document = {"seed": 4, "part": part, "scanner": {"columns": 400}, "passes": [scan]}
    check_loop(close_loop(LoopResult("short", 4), parse_recipe(document)))


@pytest.mark.metrology
@pytest.mark.parametrize("condition", [name for name in LOOP_CONDITIONS if name != "raw_clamps"])
def test_two_loops_close(condition):
    for seed in (20_010, 20_011):
        check_loop(measure_loop(condition, seed), rough=condition == "raw_rough")


def check_loop(result, rough=False):
    assert (result.refused, result.crashed) == (None, None)
    assert result.warnings["perfect"] == []
    perfect, errors = (
        {key: np.array(v, dtype=float) for key, v in result.cases[name].items()} for name in ("perfect", "errors")
    )
    limit = 10 if rough else WIDE
    assert np.nanmax(np.abs(perfect["root_mm"] - 1.5)) < limit * ROOT_GOAL_MM
    assert np.nanmax(np.abs(perfect["bevel_deg"] - 40)) < limit * BEVEL_GOAL_DEG
    for case in (perfect, errors):
        assert np.nanmax(np.abs(case["root_mm"] - case["root_milled_mm"])) < limit * ROOT_GOAL_MM
    injected, mean = errors["root_injected_mm"].mean() - 1.5, np.nanmean(errors["root_mm"]) - 1.5
    assert abs(mean - injected) < 0.4  # robot noise of 0.1 mm, smooth over the part, along a bevel at 40 deg


def test_offsets_move_the_root_as_the_bevel_moves():
    """Out of the material along the bevel's normal: a root larger by d / sin 40; along edge or axis: nothing."""
    recording, truth = simulate_recording(random_recipe("paper", 3))  # judged by 1.5 mm and 40 deg
    inspection = inspect_as_a_user(recording, truth)
    n, m, t = truth.normal[0], truth.across[0], truth.tangent[0]
    b, z = n * np.cos(40 * DEG) + m * np.sin(40 * DEG), n * np.sin(40 * DEG) - m * np.cos(40 * DEG)
    for offset, moved in ((0.2 * b, 0.2 / np.sin(40 * DEG)), (0.3 * t, 0.0), (0.3 * z, 0.0)):
        found = compare(inspection, truth, truth, offset)
        assert found["root_injected_mm"] == pytest.approx([1.5 + moved] * 9, abs=1e-3)


def test_the_upper_side_is_known_roughly_and_the_hand_eye_error_has_its_size():
    angles = []
    for seed in range(30):
        truth = build_truth(random_recipe("raw_arc", seed))
        cosine = float(np.dot(rough_upper_side(truth), truth.across[0]))
        angles.append(np.arccos(min(cosine, 1.0)) / DEG)
        assert np.linalg.norm(injected_offset_mm(seed)) == pytest.approx(HAND_EYE_ERROR_MM)
    assert 6 < max(angles) <= MOST_TURNED_DEG + 1e-6
    assert min(angles) < 3
