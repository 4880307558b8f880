"""Mutants of the sources: which are drawn, and whether tests tell them."""

from __future__ import annotations

import ast
from pathlib import Path

import numpy as np
import pytest

from bench.mutation.__main__ import LAST, ROOMS, drawn, naming
from bench.mutation.changes import changes
from bench.mutation.mutant import ROOT, fails


@pytest.mark.slow
def test_a_mutant_is_killed_by_a_test_that_holds_it_and_survives_others() -> None:
    tests = ["tests/metrology/test_mutation.py::test_the_format_of_a_truth"]
    path = Path("workbench/synthetic/prism_scan.py")
    source = (ROOT / path).read_text(encoding="utf-8")
    killed, survived = (
        source.replace("STATION_MM = 0.25", "STATION_MM = 0.5"),
        source.replace("BLOCK_FRAMES = 32", "BLOCK_FRAMES = 64"),
    )
    assert source not in (killed, survived)
    assert fails(path, killed, tests)
    assert not fails(path, survived, tests)


def test_the_format_of_a_truth() -> None:
    from workbench.synthetic import prism_scan

    assert prism_scan.STATION_MM == 0.25


def test_what_is_drawn_is_another_program() -> None:
    rng = np.random.default_rng(5)
    for room in ROOMS[::4]:
        one = drawn(room, rng)
        before = (ROOT / one.path).read_text(encoding="utf-8")
        assert ast.dump(ast.parse(one.source)) != ast.dump(ast.parse(before))
        assert before.splitlines()[one.number - 1] == one.was != one.line
        assert one.tests[-2:] == LAST
        assert all(any(Path(own).is_relative_to(test) for test in one.tests) for own in naming(room))
    for room in ROOMS:
        assert all((ROOT / test).exists() for test in (room.replace("workbench", "tests"), *naming(room)))


def test_changes_are_those_of_what_runs() -> None:
    source = 'def f(a: int | None = 3) -> int | str:\n    """1 + 1 µm"""\n    return -a < 2.0 and (a) + (1)\n'
    made = sorted(change.made(source).splitlines()[-1].strip() for change in changes(source))
    assert made == sorted(
        [
            "return -a < 2.0 and (a) + (1)",  # of the default, twice
            "return -a < 2.0 and (a) + (1)",
            "return -a < 2.0 or (a) + (1)",
            "return -a <= 2.0 and (a) + (1)",
            "return -a > 2.0 and (a) + (1)",
            "return  a < 2.0 and (a) + (1)",
            "return -a < (1.0) and (a) + (1)",
            "return -a < (4.0) and (a) + (1)",
            "return -a < 2.0 and (a) - (1)",
            "return -a < 2.0 and (a) + ((2))",
            "return -a < 2.0 and (a) + ((0))",
        ]
    )
