"""Every study's goals: of parts as they should be nothing falls short; what does is told by its goal."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from bench.metrology.__main__ import STUDIES
from bench.metrology.study import Condition, Row, cover

Values = dict[str, Any]


def calibration(seed: int) -> Row:
    return {"vol_mm": 0.1, "bound_mm": 0.1, "u_mm": 0.1, "nees": 20.0 if seed % 20 == 0 else 6.0, "seconds": {}}


def stiffness(seed: int) -> Row:
    sizes = {"error": [0.02 * (-1) ** seed] * 6, "bound": [0.02] * 6, "stated": [0.02] * 6}
    nees = 20.0 if seed % 20 == 0 else 6.0
    return sizes | {"nees": nees, "loads": [40, 6], "rejected_loads": 0, "seconds": {"identify": 0.01}}


def measured(seed: int) -> Row:
    places = {"root_mm": 1.51, "root_blind_mm": 1.9, "bevel_deg": 40.02, "bevel_blind_deg": 40.12}
    places |= {"correction_u_mm": 0.01, "correction_u_deg": 0.02}
    return {name: [value] * 20 for name, value in places.items()} | {"seconds": {"milling": 2.0}}


def joints(seed: int) -> Row:
    return {"z": [0.4, 1.8, 0.9], "right": 1}


CASES: dict[str, tuple[str, Callable[[int], Row], list[tuple[Values, str]]]] = {
    "calibration": (
        "sphere_nine",
        calibration,
        [({"vol_mm": 0.2}, "error over its bound"), ({"nees": 20.0}, "coverage of the ellipsoid")],
    ),
    "joints": (
        "prism_V",
        joints,
        [
            ({"far": "gap_mm 3.4 u"}, "12 beyond 3 u"),
            ({"taken": "taken for X"}, "12 taken for another type"),
        ],
    ),
    "stiffness": (
        "planned",
        stiffness,
        [({"error": [0.04] * 6}, "errors over their bound"), ({"nees": 24.0}, "coverage of the ellipsoid")],
    ),
    "measured_loop": (
        "repeating",
        measured,
        [
            ({"root_mm": [1.56] * 20}, "root"),
            ({"bevel_deg": [40.2] * 20}, "bevel"),
            ({"root_mm": [0.9] * 20, "root_blind_mm": [1.2] * 20}, "12 cut too deep"),
            ({"correction_u_mm": [0.001] * 20}, "finished root within 2u of the correction"),
            ({"bevel_deg": [40.06] * 20}, "finished bevel within 2u of the correction"),
        ],
    ),
}


def rows(name: str, count: int, **changed: Any) -> list[Row]:
    condition, made, _ = CASES[name]
    return [{"condition": condition, "seed": seed} | made(seed) | changed for seed in range(count)]


def judged(name: str, found: list[Row]) -> tuple[list[str], str]:
    """What falls short, and the text."""
    every = [Condition(CASES[name][0], found)]
    return STUDIES[name].short(every), STUDIES[name].text(every, "typed")


@pytest.mark.parametrize("name", CASES)
def test_parts_as_they_should_be_fall_short_of_nothing(name: str) -> None:
    short, text = judged(name, rows(name, 4))  # of many, a share of 1 would be too large
    assert short == []
    assert text.startswith("typed")
    assert text.endswith("Not met: nothing.")


@pytest.mark.parametrize(
    ("name", "changed", "words"), [(name, *case) for name, (_, _, cases) in CASES.items() for case in cases]
)
def test_what_falls_short_is_told_by_its_goal(name: str, changed: Values, words: str) -> None:
    short, text = judged(name, rows(name, 12, **changed))
    assert f"{CASES[name][0]}: {words}" in short
    assert "Not met: nothing." not in text


@pytest.mark.parametrize("name", CASES)
def test_refusals_and_crashes_are_told_with_the_first(name: str) -> None:
    lost = [{"condition": CASES[name][0], "seed": 41, "refused": "no edge in view"}]
    lost += [{"condition": CASES[name][0], "seed": 42, "crashed": "KeyError"}]
    short, text = judged(name, [*rows(name, 12), *lost])
    assert f"| {CASES[name][0]} | refused | 1 | 41 | no edge in view |" in text
    assert f"| {CASES[name][0]} | crashed | 1 | 42 | KeyError |" in text
    assert f"{CASES[name][0]}: 1 crashed" in short
    assert judged(name, lost)[0]  # nothing was measured, and that is told


def test_interval_of_the_coverage_counts_parts_not_places() -> None:
    """Parts that are wholly in or wholly out: nine places a part are worth one."""
    rng = np.random.default_rng(0)
    inside = rng.random(200) < 0.95
    found = cover(([0.0 if one else 5.0] * 9, 1.0) for one in inside)
    share = np.mean(inside)
    assert found.high - found.low == pytest.approx(2 * 1.96 * np.sqrt(share * (1 - share) / 200), rel=0.15)
