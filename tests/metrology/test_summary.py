"""Intervals of shares, tables between their marks, runs that go on."""

from dataclasses import dataclass

import numpy as np
import pytest

from bench.metrology.quantity import coverage_interval
from bench.metrology.run import Measurement, measure_all
from bench.tables import folded, markdown, not_met, put_into


@dataclass
class PartResult:
    """A study's result."""

    condition: str
    seed: int
    refused: str | None = None
    crashed: str | None = None


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


def test_a_large_table_goes_beside_the_page(tmp_path):
    small, large = ("\n".join(markdown(["a", "b"], [[str(k), f"**{k}**"] for k in range(n)])) for n in (3, 33))
    text = folded(tmp_path / "page.md", f"### One\n\n{small}\n\n### The other, again\n\n{large}\n\nend")
    assert text == f"### One\n\n{small}\n\n### The other, again\n\n[All rows](tables/page_the_other.csv).\n\nend"
    rows = (tmp_path / "tables/page_the_other.csv").read_text().splitlines()
    assert rows == ["a,b", *(f"{k},{k}" for k in range(33))]


def test_a_stopped_run_goes_on(tmp_path, monkeypatch):
    asked = []

    def measured(condition, seed):
        asked.append(seed)
        return PartResult(condition, seed)

    study = Measurement(measured, PartResult, ("bench/metrology",))
    tasks = [("paper", seed) for seed in range(4)]
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
