"""Conformity by ISO 14253-1: inside by the guard band, outside by it, or too near a limit to decide."""

from __future__ import annotations

import pytest

from workbench.artefacts import Quantity, conformity
from workbench.artefacts.edges import BEVEL_TERMS
from workbench.inspect.verdict import judged, worst

LIMITS = (-0.5, 0.25)  # about 1.5: from 1.0 to 1.75; all numbers here are exact in binary


@pytest.mark.parametrize(
    ("value", "expected"),
    [
        (1.5, "pass"),
        (1.125, "pass"),  # inside by just the guard band, 2 u
        (1.625, "pass"),
        (1.1249, "undecided"),
        (1.6251, "undecided"),
        (1.0, "undecided"),  # on a limit
        (1.75, "undecided"),
        (0.8751, "undecided"),
        (1.8749, "undecided"),
        (0.875, "fail"),  # outside by just the guard band
        (1.875, "fail"),
        (0.0, "fail"),
        (9.0, "fail"),
    ],
)
def test_guard_band_on_both_sides_of_both_limits(value: float, expected: str) -> None:
    assert conformity(value, 0.0625, 1.5, LIMITS, 2.0) == expected


@pytest.mark.parametrize(
    ("value", "expected"), [(1.0, "pass"), (1.75, "pass"), (0.9999, "fail"), (1.7501, "fail"), (1.5, "pass")]
)
@pytest.mark.parametrize(("u", "guard"), [(0.0, 1.645), (0.3, 0.0)])
def test_without_a_guard_band_the_limits_belong_to_the_tolerance(
    value: float, expected: str, u: float, guard: float
) -> None:
    assert conformity(value, u, 1.5, LIMITS, guard) == expected


def test_a_tolerance_narrower_than_the_guard_band_never_passes() -> None:
    found = {conformity(1.0 + 0.01 * k, 0.5, 1.5, LIMITS, 2.0) for k in range(100)}
    assert found == {"undecided"}
    assert conformity(9.0, 0.5, 1.5, LIMITS, 2.0) == "fail"


def test_a_limit_at_the_nominal_value() -> None:
    assert conformity(1.5, 0.1, 1.5, (0.0, 0.5), 1.0) == "undecided"
    assert conformity(1.75, 0.1, 1.5, (0.0, 0.5), 1.0) == "pass"
    assert conformity(1.25, 0.1, 1.5, (0.0, 0.5), 1.0) == "fail"


def test_the_worst_of_many() -> None:
    assert worst(["pass", "undecided", "fail", "pass"]) == "fail"
    assert worst(["pass", "undecided"]) == "undecided"
    assert worst(iter(["pass", "pass"])) == "pass"
    assert worst([]) == "undecided"


def bevel(root_mm: float, root_u_mm: float, bevel_deg: float, bevel_u_deg: float) -> tuple[str, str]:
    sizes = {
        "root_mm": Quantity.of("root_mm", root_mm, {"end": root_u_mm}),
        "bevel_deg": Quantity.of("bevel_deg", bevel_deg, {"faces": bevel_u_deg}),
    }
    required = {"root_mm": (1.5, (-0.5, 0.5)), "bevel_deg": (40.0, (-1.0, 1.0))}
    return judged(sizes, required, BEVEL_TERMS, 1.645)


@pytest.mark.parametrize(
    ("root_mm", "bevel_deg", "expected", "words"),
    [
        (1.5, 40.0, "pass", ("root face within tolerance", "bevel angle within tolerance")),
        (1.99, 40.0, "undecided", ("root face too near a limit to decide", "bevel angle within tolerance")),
        (1.5, 42.0, "fail", ("root face within tolerance", "bevel angle out of tolerance")),
        (1.99, 37.0, "fail", ("root face too near a limit to decide", "bevel angle out of tolerance")),
        (0.5, 40.99, "fail", ("root face out of tolerance", "bevel angle too near a limit to decide")),
    ],
)
def test_a_section_is_as_bad_as_its_worse_characteristic(
    root_mm: float, bevel_deg: float, expected: str, words: tuple[str, str]
) -> None:
    found, reason = bevel(root_mm, 0.01, bevel_deg, 0.05)
    assert found == expected
    for part in words:
        assert part in reason


@pytest.mark.parametrize("missing", range(4))
def test_a_section_that_was_not_measured_is_undecided(missing: int) -> None:
    values = [1.5, 0.01, 40.0, 0.05]
    values[missing] = float("nan")
    found, reason = bevel(*values)
    assert found == "undecided"
    assert "not seen" in reason
