"""The command that measures: what it would run, and where its tables go."""

from __future__ import annotations

import pytest

from bench.metrology import measured_loop
from bench.metrology.__main__ import STUDIES, main, parse, tasks


def test_everything_is_measured_unless_said_otherwise():
    options = parse([])
    assert options.studies == list(STUDIES)
    assert len(tasks("measured_loop", options)) == 100 * len(measured_loop.CELLS)
    assert {seed for _, seed in tasks("measured_loop", options)} == set(range(1_000_000, 1_000_100))


@pytest.mark.parametrize("name", STUDIES)
def test_pages_have_a_place_for_the_tables(name):
    text = STUDIES[name].place.read_text(encoding="utf-8")
    assert text.count(f"<!-- {name}: begin -->") == text.count(f"<!-- {name}: end -->") == 1


def test_a_refused_part_runs_through_to_the_tables(capsys):
    """A set whose postures leave a direction of the translation open: refused and told; no goal is missed by it."""
    chosen = ["--studies", "calibration", "--conditions", "sphere_grid", "--parts", "1", "--seed", "7200018"]
    assert main([*chosen, "--workers", "1"]) == 0
    assert "| sphere_grid | refused | 1 | 7200018 | " in capsys.readouterr().out
