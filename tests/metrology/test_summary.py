"""Figures and tables from results whose figures are known."""

import numpy as np
import pytest

from bench.metrology.part_result import PartResult
from bench.metrology.quantity import coverage_interval
from bench.metrology.run import Measurement, measure_all
from bench.metrology.summary import summarise
from bench.metrology.table import not_met, put_into, tables


def part(seed, **changes):
    values = {
        "root_mm": [1.5, 1.5, 1.5],
        "root_true_mm": [1.5, 1.499, 1.51],
        "root_u_mm": [0.004] * 3,
        "root_bound_mm": [0.002] * 3,
        "bevel_deg": [40.0, 40.0, 40.0],
        "bevel_true_deg": [40.0, 40.02, 39.98],
        "bevel_u_deg": [0.02] * 3,
        "bevel_bound_deg": [0.02] * 3,
        "hidden": [False] * 3,
        "seen": [True] * 3,
        "verdicts": ["pass"] * 3,
        "margins": [50.0] * 3,
        "seconds": {"inspection": 1.0, "open3d": 9.0},
        "peers": {"open3d": {"root_mm": [0.1, -0.2, None], "bevel_deg": [None, None, None]}},
    }
    return PartResult("paper", seed, **(values | changes))


def test_figures_of_known_parts():
    found = summarise("paper", [part(0), part(1, root_mm=[1.5, 1.5, 1.51])])
    assert found.root.p95 == pytest.approx(0.001 + 0.95 * 0.009)
    assert found.root.coverage == pytest.approx(5 / 6)
    assert found.root.bias == pytest.approx((-0.009 + 0.001) / 6)
    assert found.root.u_over_bound == pytest.approx(2.0)
    assert found.bevel.coverage == 1.0
    assert found.bevel.u_over_bound == pytest.approx(1.0)
    assert found.seconds == 1.0
    assert found.peers["open3d"][1] == (pytest.approx(0.2), pytest.approx(0.2))
    assert found.peers["open3d"][2] == (np.inf, np.inf)


def test_every_shortcoming_is_named():
    assert "paper: root error" in summarise("paper", [part(0, root_mm=[1.6, 1.5, 1.5])]).shortcomings
    assert "paper: root u over bound" in summarise("paper", [part(0, root_bound_mm=[0.001] * 3)]).shortcomings
    assert "paper: bevel coverage" in summarise("paper", [part(0)]).shortcomings
    assert "paper: invented sections" in summarise("paper", [part(0, hidden=[True, False, False])]).shortcomings
    assert "paper: invented sections" in summarise("paper", [part(0, stations_invented=1)]).shortcomings
    assert "paper: 1 crashed" in summarise("paper", [part(0), PartResult("paper", 1, crashed="x")]).shortcomings
    wrong = part(0, verdicts=["pass", "fail", "pass"], margins=[-2.5, 0.5, 3.0])
    found = summarise("paper", [wrong])
    assert (found.wrong, found.at_risk, found.far_wrong) == (2, 1, 1)
    assert "paper: wrong verdicts" in found.shortcomings


def test_refused_parts_are_told_and_missing_sections_counted():
    gap = part(0, root_mm=[None, 1.5, 1.5], root_u_mm=[None, 0.004, 0.004], margins=[None, 5.0, 5.0])
    found = summarise("paper", [gap, PartResult("paper", 7, refused="no edge in view")])
    assert found.missing == pytest.approx(1 / 3)
    text = tables([found], "command")
    assert "seed 7: refused: no edge in view" in text


def test_interval_of_the_coverage_counts_parts_not_sections():
    """Parts that are wholly in or wholly out: nine sections a part are worth one."""
    rng = np.random.default_rng(0)
    inside = [np.full(9, value) for value in rng.random(200) < 0.95]
    low, high = coverage_interval(inside)
    share = np.mean(inside)
    assert high - low == pytest.approx(2 * 1.96 * np.sqrt(share * (1 - share) / 200), rel=0.15)


def test_tables_go_between_their_marks(tmp_path):
    page = tmp_path / "page.md"
    page.write_text("before\n<!-- loop: begin -->\nold\n<!-- loop: end -->\nafter\n")
    put_into(page, "new", "loop")
    assert page.read_text() == "before\n<!-- loop: begin -->\nnew\n<!-- loop: end -->\nafter\n"
    with pytest.raises(ValueError, match="no place for 'tables'"):
        put_into(page, "new")


def test_a_stopped_run_goes_on(tmp_path, monkeypatch):
    asked = []

    def measured(condition, seed, peers):
        asked.append(seed)
        return PartResult(condition, seed, peers={name: {} for name in peers})

    study = Measurement(measured, PartResult, ("bench/metrology",))
    tasks = [("paper", seed, ("per_profile",)) for seed in range(4)]
    list(measure_all(tasks[:2], tmp_path, 1, study))
    with (tmp_path / "paper.jsonl").open("a") as file:
        file.write('{"condition": "paper", "se')
    found = list(measure_all(tasks, tmp_path, 1, study))
    assert asked == [0, 1, 2, 3]
    assert sorted(r.seed for r in found) == [0, 1, 2, 3]
    list(measure_all(tasks, tmp_path, 1, Measurement(measured, PartResult, ("bench/metrology", "bench/peers"))))
    assert asked == [0, 1, 2, 3, 0, 1, 2, 3]


def test_goals_that_were_not_met_are_told_by_goal() -> None:
    assert not_met(["arc: axis", "wavy: axis", "arc: root"]) == "Not met: axis (arc, wavy); root (arc)."
    assert not_met([]) == "Not met: nothing."
