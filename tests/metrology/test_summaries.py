"""Every study's summary: of results as they should be nothing falls short; what does is told by its goal."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

from bench.metrology.calibration.part import CalibrationResult
from bench.metrology.calibration.summary import CalibrationSummary
from bench.metrology.measured.part import MeasuredResult
from bench.metrology.measured.summary import MeasuredSummary
from bench.metrology.planning.part import PlanResult
from bench.metrology.planning.summary import PlanSummary
from bench.metrology.stiffness.part import StiffnessResult
from bench.metrology.stiffness.summary import StiffnessSummary
from bench.metrology.summary import Summary

Values = dict[str, Any]


def calibration(seed: int, **changed: Any) -> CalibrationResult:
    values = {"vol_mm": 0.1, "bound_mm": 0.1, "u_mm": 0.1, "nees": 20.0 if seed % 20 == 0 else 6.0}
    return CalibrationResult("sphere_nine", seed, **(values | changed))


def stiffness(seed: int, **changed: Any) -> StiffnessResult:
    error = [0.02 * (-1) ** seed] * 6
    values = {"error": error, "bound": [0.02] * 6, "stated": [0.02] * 6, "nees": 20.0 if seed % 20 == 0 else 6.0}
    return StiffnessResult("planned", seed, **(values | {"loads": [40, 6], "seconds": {"identify": 0.01}} | changed))


def planning(seed: int, **changed: Any) -> PlanResult:
    values = {"distance_mm": 0.01, "axis_deg": 0.02, "spacing_error": 0.01, "covered": 1.0, "reachable_covered": 1.0}
    return PlanResult("raw_rough", seed, **(values | changed))


def measured(seed: int, **changed: Any) -> MeasuredResult:
    places = {"root_mm": 1.51, "root_blind_mm": 1.9, "bevel_deg": 40.02, "bevel_blind_deg": 40.12}
    places |= {"correction_u_mm": 0.01, "correction_u_deg": 0.02}
    told = {name: changed.pop(name) for name in ("refused", "crashed") if name in changed}
    columns = {name: [value] * 20 for name, value in (places | changed).items()}
    return MeasuredResult("repeating", seed, places=columns, seconds={"milling": 2.0}, **told)


STUDIES: dict[type[Summary], tuple[Callable[..., Any], list[tuple[Values, str]]]] = {
    CalibrationSummary: (
        calibration,
        [({"vol_mm": 0.2}, "error over its bound"), ({"nees": 20.0}, "coverage of the ellipsoid")],
    ),
    StiffnessSummary: (
        stiffness,
        [({"error": [0.04] * 6}, "errors over their bound"), ({"nees": 24.0}, "coverage of the ellipsoid")],
    ),
    PlanSummary: (
        planning,
        [
            ({"distance_mm": 0.061}, "distance"),
            ({"axis_deg": 0.16}, "axis"),
            ({"spacing_error": 0.06}, "spacing"),
            ({"reachable_covered": 0.98}, "coverage of the edge"),
            ({"wrong_side": True}, "wrong side"),
            ({"blind_points": 1}, "invented edge"),
        ],
    ),
    MeasuredSummary: (
        measured,
        [
            ({"root_mm": 1.56}, "root"),
            ({"bevel_deg": 40.2}, "bevel"),
            ({"root_mm": 0.9, "root_blind_mm": 1.2}, "12 cut too deep"),
            ({"correction_u_mm": 0.001}, "finished root within 2u of the correction"),
            ({"bevel_deg": 40.06}, "finished bevel within 2u of the correction"),
        ],
    ),
}


def summary(study: type[Summary], *results: Any) -> tuple[list[str], str]:
    """What falls short, and the text."""
    found = study(results[0].condition, results)
    assert list(study.worst(list(results), 1))
    return found.shortcomings, study.text([found], "typed")


@pytest.mark.parametrize("study", STUDIES)
def test_results_as_they_should_be_fall_short_of_nothing(study: type[Summary]) -> None:
    short, text = summary(study, *map(STUDIES[study][0], range(4)))  # of many, a share of 1 would be too large
    assert short == []
    assert text.startswith("`typed`")
    assert text.endswith("Not met: nothing.")


@pytest.mark.parametrize(
    ("study", "changed", "words"), [(study, *case) for study, (_, cases) in STUDIES.items() for case in cases]
)
def test_what_falls_short_is_told_by_its_goal(study: type[Summary], changed: Values, words: str) -> None:
    made = STUDIES[study][0]
    short, text = summary(study, *(made(seed, **changed) for seed in range(12)))
    assert f"{made(0).condition}: {words}" in short
    assert "Not met: nothing." not in text


@pytest.mark.parametrize("study", STUDIES)
def test_refusals_and_crashes_are_told_with_the_first(study: type[Summary]) -> None:
    made = STUDIES[study][0]
    lost = made(41, refused="no edge in view"), made(42, crashed="KeyError")
    short, text = summary(study, *map(made, range(12)), *lost)
    assert "1 refused, the first (seed 41): no edge in view" in text
    assert "1 **crashed**, the first (seed 42): KeyError" in text
    assert f"{lost[0].condition}: 1 crashed" in short


def test_the_worst_part_decides_a_plan() -> None:
    assert summary(PlanSummary, *map(planning, range(12)), planning(12, axis_deg=0.16))[0] == ["raw_rough: axis"]


def test_what_lies_beyond_the_allowance_is_counted_apart() -> None:
    beyond = MeasuredResult("repeating", 9, beyond="too deep", places={"root_blind_mm": [0.6, 0.7]})
    found = MeasuredSummary("repeating", [*map(measured, range(4)), beyond])
    assert (len(found.good), len(found.beyond), found.blind_too_deep) == (4, 1, 1)
    assert found.corrected == pytest.approx([0.01] * 3)
    assert found.blind == pytest.approx([0.4] * 3)
