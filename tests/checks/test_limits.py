"""Limits: what is allowed, what a user may set, and what is told where only the user's limit allows a value."""

import dataclasses
import math
from typing import Any

import pytest

from workbench.checks.limits import GONE, LIMITS, Limits, check
from workbench.errors import PipelineError
from workbench.parameters import check_parameters, parameter_model


@pytest.mark.parametrize(
    ("value", "given", "default", "passed", "loosened"),
    [
        (9.0, None, None, True, False),
        (10.0, None, None, True, False),  # a limit itself is allowed
        (11.0, None, None, False, False),
        (-1e9, None, None, True, False),
        (11.0, 12.0, None, True, True),  # the user's limit alone allows it
        (9.0, 12.0, None, True, False),
        (9.0, 8.0, None, False, False),  # and a stricter one refuses
        (11.0, None, 12.0, True, False),  # a default of the recording's own is no loosening
        (11.5, 12.0, 11.0, True, True),
        (None, 12.0, None, True, False),
        (math.nan, None, None, True, False),
        *((value, None, (1.0, 2.0), 1.0 <= value <= 2.0, False) for value in (0.9, 1.0, 2.0, 2.1)),
        (0.5, (0.4, 2.0), (1.0, 2.0), True, True),
        (None, None, (1.0, 2.0), True, False),
    ],
)
def test_a_check_says_whether_it_passed_and_by_whose_limit(
    monkeypatch: pytest.MonkeyPatch, value: Any, given: Any, default: Any, passed: bool, loosened: bool
) -> None:
    monkeypatch.setitem(LIMITS, "range_mm", dataclasses.replace(LIMITS["range_mm"], bound=10.0))
    found = check("range_mm", value, "seen", given=None if given is None else {"range_mm": given}, default=default)
    assert (found.passed, found.loosened) == (passed, loosened)
    assert found.value == (None if value is None or math.isnan(value) else value)
    assert found.limit == (given or default or 10.0)
    assert (found.name, found.finding, found.reason) == ("range_mm", "seen", LIMITS["range_mm"].reason)


def given(limits: dict[str, Any]) -> Any:
    """Limits as a stage takes them."""
    stage = parameter_model("scan.fuse", {"limits": (Limits, {})})
    return check_parameters(stage, {"limits": limits}, "scan.fuse")["limits"]


@pytest.mark.parametrize(
    ("name", "value", "words"),
    [
        ("range_mm", "far", "expected a valid number"),
        ("range_mm", True, "expected a valid number"),
        ("range_mm", [1.0, 2.0], "expected a number"),
        ("view_width_mm", 3.0, "expected two numbers"),
        ("view_width_mm", [3.0], "expected a valid number"),
        ("view_width_mm", [3.0, 4.0, 5.0], "expected a valid number"),
        ("view_width_mm", [3.0, None], "expected a valid number"),
        ("rang_mm", 3.0, "did you mean 'range_mm'"),
        *((gone, 0.5, told) for gone, told in GONE.items()),
        ("root_step_share", 0.5, "step_share judges that now"),
        ("size_scatter", 0.5, "no check judges that now"),
    ],
)
def test_limits_that_are_none_are_refused_before_anything_runs(name: str, value: Any, words: str) -> None:
    with pytest.raises(PipelineError) as refused:
        given({name: value})
    assert str(refused.value).startswith("scan.fuse.limits")
    assert name in str(refused.value)
    assert words in str(refused.value)
    assert GONE.get(name, "no check").split(" judges")[0] in {"no check", *LIMITS}


def test_limits_are_taken_as_they_are_given() -> None:
    limits = {"range_mm": 3, "view_width_mm": (1, 2.5)}
    assert given(limits) == limits
