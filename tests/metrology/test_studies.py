"""The command that measures: what it would run, and where its tables go."""

from __future__ import annotations

import pytest

from bench.drawn.plates import RAW_CONDITIONS
from bench.metrology.__main__ import STUDIES, main, parse, tasks


def test_everything_is_measured_unless_said_otherwise():
    options = parse([])
    assert options.studies == list(STUDIES)
    assert len(tasks("planning", options)) == 100 * len(RAW_CONDITIONS)
    assert {seed for _, seed in tasks("measured_loop", options)} == set(range(1_000_000, 1_000_100))


@pytest.mark.parametrize("name", STUDIES)
def test_pages_have_a_place_for_the_tables(name):
    text = STUDIES[name].place.read_text(encoding="utf-8")
    assert text.count(f"<!-- {name}: begin -->") == text.count(f"<!-- {name}: end -->") == 1


def test_a_refused_part_runs_through_to_the_tables(capsys):
    """One part of whose edge clamps hide most: refused and told; status 1."""
    chosen = ["--studies", "planning", "--conditions", "raw_clamps", "--parts", "1", "--seed", "8300002"]
    assert main([*chosen, "--workers", "1"]) == 1
    printed = capsys.readouterr().out
    assert "raw_clamps: 1 refused, the first (seed 8300002): " in printed
    assert "seen on 36 % of its length only" in printed
