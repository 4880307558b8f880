"""Conformity by ISO 14253-1: inside by the guard band, outside by it, or too near a limit to decide."""

from __future__ import annotations

import pytest

from workbench.artefacts import conformity

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
