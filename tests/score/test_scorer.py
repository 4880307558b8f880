"""Laws of the score: which statements it rewards, and that it holds values against the truth at their place."""

import ast
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from workbench.geometry.poses import rotation_from_vector
from workbench.score import scorer
from workbench.score.judge import judged
from workbench.score.scorer import MISS, PIECES, Found, K, compare, interval_score, project

LENGTH = 90.0
MIDDLES = np.arange(9) * 20 + 10  # stations in the middles of the nine pieces
finite = st.floats(-5.0, 5.0)
positive = st.floats(1e-4, 5.0)


def edge(bend: float = 0.0, hidden: tuple[float, float] = (0.0, 0.0)) -> dict[str, Any]:
    along = np.linspace(0.0, LENGTH, 181)
    place = np.stack([along, bend * np.sin(along / 20.0), 0.0 * along], axis=1)
    seen = ~((along > hidden[0]) & (along < hidden[1]))
    return {
        "position_mm": place.tolist(),
        "seen": seen.tolist(),
        "root_mm": np.linspace(1.0, 2.0, 181).tolist(),
        "bevel_deg": [40.0] * 181,
    }


def told(truth: dict[str, Any], error: float, u: float, at: Any = MIDDLES) -> dict[str, Any]:
    rows = [
        {
            "origin_mm": truth["position_mm"][k],
            "root_mm": truth["root_mm"][k] + error,
            "root_u_mm": u,
            "bevel_deg": 40.0 + error,
            "bevel_u_deg": u,
        }
        for k in at
    ]
    return {"sections": rows}


def test_it_is_short_and_needs_numpy_alone() -> None:
    text = Path(scorer.__file__).read_text(encoding="utf-8")
    names = [n.module or "" for n in ast.walk(ast.parse(text)) if isinstance(n, ast.ImportFrom)]
    names += [a.name for n in ast.walk(ast.parse(text)) if isinstance(n, ast.Import) for a in n.names]
    assert {name.split(".")[0] for name in names} == {"__future__", "collections", "typing", "numpy"}
    assert len(text.splitlines()) <= 150


@pytest.mark.parametrize("sigma", [0.01, 1.0])
def test_stating_the_true_uncertainty_costs_least(sigma: float) -> None:
    error = np.random.default_rng(1).normal(0.0, sigma, 100_000)
    stated = np.array([0.1, 0.5, 0.8, 0.9, 1.0, 1.1, 1.25, 2.0, 10.0]) * sigma
    cost = [interval_score(error, u, 1.0).mean() for u in stated]
    assert stated[int(np.argmin(cost))] == sigma
    assert np.all(np.diff(cost[:5]) < 0)
    assert np.all(np.diff(cost[4:]) > 0)
    assert min(cost) == pytest.approx(4.68 * sigma, rel=0.01)  # closed form: 2 * 20 * 2 * the density at K, / sigma


def test_a_value_told_with_its_own_sigma_costs_less_than_one_sigma_for_all() -> None:
    rng = np.random.default_rng(2)
    sigma = np.exp(rng.normal(0.0, 1.0, 50_000))
    error = rng.normal(0.0, sigma)
    common = min(interval_score(error, u, 1e9).mean() for u in np.geomspace(0.3, 10.0, 30))
    assert interval_score(error, sigma, 1e9).mean() < 0.95 * common


@given(finite, finite, positive)
def test_a_larger_error_never_costs_less(one: float, other: float, u: float) -> None:
    less, more = sorted((abs(one), abs(other)))
    costs = interval_score([less, more], u, 9.0)
    assert costs[0] <= costs[1] <= costs[0] + MISS * (more - less) * (1 + 1e-9) + 1e-9
    assert costs[0] >= 2 * K * u * (1 - 1e-12)


@given(finite, positive, st.floats(1e-3, 1e3))
def test_sign_and_unit_change_nothing(error: float, u: float, unit: float) -> None:
    cost = interval_score(error, u, 1.0)
    assert interval_score(-error, u, 1.0) == cost
    assert interval_score(error * unit, u * unit, unit) == pytest.approx(cost * unit, rel=1e-9)


def test_what_is_missing_costs_its_price_and_nothing_is_had_for_no_uncertainty() -> None:
    assert interval_score([np.nan, 0.1, 0.0, 0.0], [0.1, np.nan, 0.0, -1.0], 2.0).tolist() == [2.0] * 4
    truth = edge()
    for nothing in ({}, {"sections": []}, {"refused": "no bevel"}, told(truth, 0.0, 0.0)):
        found = compare(truth, nothing)
        assert found["root_mm"].cost(1.0).tolist() == [1.0] * PIECES
        assert scorer.card([found["bevel_deg"]], "bevel_deg")["score"] == 2.0
        assert scorer.card([found["bevel_deg"]], "bevel_deg")["refused"] == 1


@given(st.permutations(range(9)), st.lists(st.integers(0, 8), max_size=20))
def test_order_and_repetition_of_sections_change_nothing(order: list[int], again: list[int]) -> None:
    truth = edge(bend=2.0)
    sections = told(truth, 0.01, 0.004)["sections"]
    more = {"sections": [sections[k] for k in [*order, *again]]}
    assert compare(truth, more)["root_mm"].cost(1.0) == pytest.approx(
        compare(truth, {"sections": sections})["root_mm"].cost(1.0)
    )


@given(st.lists(st.floats(-3.0, 3.0), min_size=3, max_size=3), st.lists(st.floats(-1e3, 1e3), min_size=3, max_size=3))
def test_where_base_and_part_stand_changes_nothing(turn: list[float], way: list[float]) -> None:
    truth = edge(bend=3.0)
    found = told(truth, 0.02, 0.01)
    rotation = rotation_from_vector(np.array(turn))
    moved = {**truth, "position_mm": (np.array(truth["position_mm"]) @ rotation.T + way).tolist()}
    told_so = [{**s, "origin_mm": (rotation @ s["origin_mm"] + way).tolist()} for s in found["sections"]]
    before, after = compare(truth, found)["root_mm"], compare(moved, {"sections": told_so})["root_mm"]
    assert after.error == pytest.approx(before.error, abs=1e-7)
    assert after.cost(1.0) == pytest.approx(before.cost(1.0), abs=1e-5)


@pytest.mark.parametrize(("hidden", "left_out", "lost"), [((0, 0), (), 0), ((0, 0), (0, 1), 2), ((12, 18), (1,), 0)])
def test_every_piece_that_is_seen_whole_must_have_a_value(hidden: Any, left_out: Any, lost: int) -> None:
    truth = edge(hidden=hidden)
    found = compare(truth, told(truth, 0.0, 0.01, np.delete(MIDDLES, left_out)))["root_mm"]
    assert np.setdiff1d(found.wanted, found.piece).size == lost
    assert (found.cost(1.0) == 1.0).sum() == lost


def test_a_value_far_from_the_edge_is_none_of_it() -> None:
    truth = edge()
    found = told(truth, 0.0, 0.01)
    found["sections"][4]["origin_mm"] = [45.0, 30.0, 0.0]
    assert compare(truth, found)["root_mm"].cost(1.0)[4] == 1.0


def test_projection_on_a_chain_agrees_with_a_circle() -> None:
    turn = np.linspace(0.0, 2.0, 800)
    circle = 100.0 * np.stack([np.cos(turn), np.sin(turn), 0 * turn], axis=1)
    at = np.array([0.3, 1.1, 1.9])
    place = 103.0 * np.stack([np.cos(at), np.sin(at), 0 * at], axis=1) + [0.0, 0.0, 2.0]
    arc, first, share, away = project(circle, place)
    assert arc == pytest.approx(100.0 * at, abs=5e-3)  # off by half a chord's turn at 3 mm away
    assert turn[first] + share * turn[1] == pytest.approx(at, abs=5e-5)
    assert away == pytest.approx(np.hypot(3.0, 2.0), abs=1e-3)


def test_a_raw_edge_is_judged_in_its_own_axes() -> None:
    place = np.stack([np.zeros(50), np.zeros(50), np.linspace(0.0, 49.0, 50)], axis=1)
    axes = {name: [list(v)] * 50 for name, v in zip(("normal", "across", "tangent"), np.eye(3), strict=True)}
    truth = {"position_mm": place.tolist(), "seen": [True] * 50, **axes}
    turn = rotation_from_vector(np.radians([0.0, 0.0, 0.5]))
    lean = rotation_from_vector(np.radians([0.3, 0.0, 0.0]))
    names = ("along_n_u_mm", "along_m_u_mm", "axis_u_deg", "heading_u_deg")
    row = {"origin_mm": [0.02, -0.03, 20.3], "normal": turn[:, 0].tolist(), "tangent": lean[:, 2].tolist()}
    found = compare(truth, {"sections": [row | dict.fromkeys(names, 0.1)]})
    errors = [found[name].error[0] for name in scorer.RAW]
    assert errors == pytest.approx([0.02, -0.03, 0.5, 0.3], abs=1e-6)


def test_a_hand_eye_pose_is_judged_by_its_six_errors() -> None:
    true = np.eye(4)
    true[:3, 3] = [100.0, 20.0, 30.0]
    pose = true.copy()
    w = np.radians([0.2, -0.1, 0.3])
    pose[:3, :3], pose[:3, 3] = rotation_from_vector(-w), true[:3, 3] - [0.1, 0.2, -0.3]
    answer = {"flange_from_profiler": pose.tolist(), "translation_u_mm": [0.1] * 3, "rotation_u_deg": [0.1] * 3}
    found = compare({"flange_from_profiler": true.tolist()}, answer)
    assert found["translation_mm"].error == pytest.approx([0.1, 0.2, -0.3])
    assert found["rotation_deg"].error == pytest.approx([0.2, -0.1, 0.3], rel=1e-4)
    assert compare({"flange_from_profiler": true.tolist()}, {})["rotation_deg"].cost(5.0).tolist() == [5.0] * 3


def test_a_card_names_what_it_counts() -> None:
    truth = edge()
    document = {"recordings": {"a": truth, "b": truth}, "track": "milled"}
    card = judged({"method": "mine", "recordings": {"a": told(truth, 0.01, 0.01), "z": {}}}, document)
    assert card["unknown_recordings"] == ["z"]
    root = card["quantities"]["root_mm"]
    assert (root["recordings"], root["refused"], root["values"]) == (2, 1, 9)
    assert root["score"] == pytest.approx(0.5 * (2 * K * 0.01) + 0.5 * 1.0)
    assert root["useful"] == 0.5
    assert json.loads(json.dumps(card, allow_nan=False)) == card
    assert judged({"method": "none", "recordings": {}}, document)["score"] == 1.0


def test_found_shares_a_piece_among_its_values() -> None:
    found = Found(np.zeros(3), np.array([0.1, 0.3, 0.2]), np.array([0, 0, 1]), np.arange(2))
    assert found.cost(1.0) == pytest.approx([2 * K * 0.2, 2 * K * 0.2])
