"""What all studies share: runs that go on, tables between their marks."""

from __future__ import annotations

from pathlib import Path

import pytest

from bench.harness import resumed
from bench.tables import folded, markdown, put_into


def test_a_stopped_run_goes_on(tmp_path: Path) -> None:
    asked = []

    def measured(task):
        asked.append(task[1])
        return {"seed": task[1]}

    log, tasks = tmp_path / "out" / "study.jsonl", [("paper", seed) for seed in range(4)]
    resumed(log, measured, tasks[:2])
    with log.open("a") as file:
        file.write('\n[["paper", 2], {"se')
    found = resumed(log, measured, tasks)
    assert asked == [0, 1, 2, 3]
    assert found == [{"seed": seed} for seed in range(4)]
    assert resumed(log, measured, tasks[3:]) == [{"seed": 3}]
    assert asked == [0, 1, 2, 3]
    resumed(log, measured, tasks, goes_on=False)  # of other sources
    assert asked == [0, 1, 2, 3] * 2


def test_tables_go_between_their_marks(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text("before\n<!-- loop: begin -->\nold\n<!-- loop: end -->\nafter\n")
    put_into(page, "new", "loop")
    assert page.read_text() == "before\n<!-- loop: begin -->\nnew\n<!-- loop: end -->\nafter\n"
    with pytest.raises(ValueError, match="no place for 'tables'"):
        put_into(page, "new")


def test_a_large_table_goes_beside_the_page(tmp_path: Path) -> None:
    small, large = ("\n".join(markdown(["a", "b"], [[str(k), f"**{k}**"] for k in range(n)])) for n in (3, 33))
    text = folded(tmp_path / "page.md", f"### One\n\n{small}\n\n### The other, again\n\n{large}\n\nend")
    assert text == f"### One\n\n{small}\n\n### The other, again\n\n[All rows](tables/page_the_other.csv).\n\nend"
    rows = (tmp_path / "tables/page_the_other.csv").read_text().splitlines()
    assert rows == ["a,b", *(f"{k},{k}" for k in range(33))]
