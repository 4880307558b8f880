"""Scaling a constant in a source."""

from __future__ import annotations

from pathlib import Path

import pytest

from bench.mutants import ROOT, fails, scaled


def test_one_number_is_scaled_and_nothing_else() -> None:
    source = 'A, SHARE = 3, 0.25  # µm\nB: float = 2.0\nC = "0.25"\n'
    assert scaled(source, "SHARE", 2) == 'A, SHARE = 3, 0.5  # µm\nB: float = 2.0\nC = "0.25"\n'
    assert scaled(source, "A", 2).startswith("A, SHARE = 6, 0.25")
    assert "B: float = 1.0" in scaled(source, "B", 0.5)
    for name in ("C", "D"):
        with pytest.raises(ValueError, match=f"no number {name}"):
            scaled(source, name, 2)


def test_a_mutant_is_killed_by_a_test_that_holds_it_and_survives_others() -> None:
    tests = ["tests/metrology/test_mutants.py::test_the_format_of_a_truth"]
    path = Path("workbench/synthetic/swept/truth.py")
    assert (ROOT / path).exists()
    assert fails(path, "STATION_MM", 2, tests)
    assert not fails(path, "LOCAL_MM", 2, tests)


def test_the_format_of_a_truth() -> None:
    from workbench.synthetic.swept import truth

    assert truth.STATION_MM == 0.25
