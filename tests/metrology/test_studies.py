"""The command that measures: what it would run, and where its tables go."""

from __future__ import annotations

import pytest

from bench.drawn.plates import RAW_CONDITIONS
from bench.metrology.__main__ import STUDIES, command, main, parse, tasks


def test_everything_is_measured_unless_said_otherwise():
    options = parse([])
    assert options.studies == list(STUDIES)
    assert len(tasks("planning", options)) == 100 * len(RAW_CONDITIONS)
    assert {seed for _, seed in tasks("measured_loop", options)} == set(range(1_000_000, 1_000_100))


def test_the_command_can_be_typed_again():
    typed = "--studies planning --parts 3 --seed 5 --conditions raw_arc raw_wavy"
    options = parse(typed.split())
    assert command("planning", options) == "python -m bench.metrology --studies planning --parts 3 --seed 5" + (
        " --conditions raw_arc raw_wavy"
    )
    assert tasks("planning", options) == [(c, s) for s in (5, 6, 7) for c in ("raw_arc", "raw_wavy")]


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
