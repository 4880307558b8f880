"""Laws of information on the public surface, over recordings of two simulators: u follows what was told.

WORKBENCH_SCORED_ENGINE names another engine of `bench.score.measure` for the same laws.
"""

from typing import Any

import pytest

from bench.score.laws import ALIKE, GROWS, POORER, ROUNDING, change_of, growth

NAMES, PASSES = ("milled_edge", "worn 2"), ("milled_two_pass",)  # all nine: `python -m bench.score.laws`
FAILS = {  # greatest growth of u, or greatest change of a value, as measured (docs/score.md)
    ("in a mirror", "root_mm"): "0.0002 mm, 2 of 9 recordings",
    ("in a mirror", "bevel_deg"): "0.0030 deg, 2 of 9",
}


def laws(changes: Any) -> list[Any]:
    return [
        pytest.param(
            change,
            quantity,
            marks=[pytest.mark.xfail(strict=True, reason=FAILS[change, quantity])]
            if (change, quantity) in FAILS
            else [],
        )
        for change in changes
        for quantity in ROUNDING
    ]


@pytest.mark.parametrize(("change", "quantity"), laws(POORER))
def test_more_information_never_makes_less_sure(change: str, quantity: str) -> None:
    grown = {name: growth(name, change, quantity) for name in (PASSES if "pass" in change else NAMES)}
    assert {name: g for name, g in grown.items() if g > GROWS} == {}


@pytest.mark.parametrize(("change", "quantity"), laws(ALIKE))
def test_how_it_is_told_changes_nothing(change: str, quantity: str) -> None:
    moved = {name: change_of(name, change, quantity)[0] for name in NAMES}
    assert {name: value for name, value in moved.items() if value > ROUNDING[quantity]} == {}
