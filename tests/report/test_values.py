"""How values are written: digits follow the uncertainty, nothing is invented."""

from __future__ import annotations

import math

import numpy as np
import pytest

from workbench import pieces
from workbench.artefacts import Check
from workbench.report.tables import check_rows
from workbench.report.text import alike, decimals, measured, plain, signed, span


@pytest.mark.parametrize(
    ("u", "places"),
    [
        ([0.05], 2),
        ([0.049], 3),
        ([0.0031], 4),
        ([0.0008], 4),
        ([0.4], 2),
        ([8.0], 1),
        ([0.5, None, 0.007], 3),
        ([None], 3),
    ],
)
def test_digits_follow_the_smallest_expanded_uncertainty(u, places):
    assert decimals(u) == places


@pytest.mark.parametrize("expanded", np.geomspace(0.0011, 90.0, 60))
def test_rounding_hardly_changes_an_uncertainty(expanded):
    shown = float(measured(1.0, expanded / 2, decimals([expanded / 2])).split()[-1])
    assert shown == pytest.approx(expanded, rel=0.05)


def test_a_value_stands_with_twice_its_standard_uncertainty():
    assert measured(1.50349, 0.0062, 3) == "1.503 ± 0.012"
    assert measured(None, None, 3) == "–"
    assert measured(math.nan, 0.1, 3) == "–"
    assert measured(1.5, None, 2) == "1.50"


def test_span_leaves_out_what_was_not_measured():
    assert span(np.array([math.nan, 2.0, 1.0]), 2, " mm") == "1.00 to 2.00 mm"
    assert span(np.array([math.nan]), 2, " mm") == "–"
    assert span(np.array([0.502, 0.498]), 2, " mm") == "0.50 mm"
    assert span(np.array([-0.011, 0.051]), 3, " mm") == "−0.011 to 0.051 mm"


def test_what_rounds_to_nothing_has_no_sign():
    assert [signed(value, 2) for value in (0.012, -0.012, -0.004, 0.004, 0.0)] == [
        "+0.01",
        "−0.01",
        "0.00",
        "0.00",
        "0.00",
    ]
    assert [plain(value, 1) for value in (1.26, -1.26, -0.01)] == ["1.3", "−1.3", "0.0"]


def test_limits_have_the_same_decimals():
    assert alike(1.5 - 0.5, 1.5, 1.5 + 0.5) == ("1.0", "1.5", "2.0")
    assert alike(39, 40, 41) == ("39", "40", "41")
    assert alike(0.1 + 0.2, 1.25) == ("0.30", "1.25")


def test_tables_of_any_chapter_write_minus_signs_and_no_signed_nothing():
    page = pieces.table_html(("Axis", "Value"), [("2026-03-31", "-1.50, (-0.3)"), ("a-1", "-0.000"), ("b", "+0.00")])
    assert "2026-03-31" in page
    assert ">a-1<" in page
    assert "−1.50, (−0.3)" in page
    assert ">0.000<" in page
    assert ">0.00<" in page


def test_what_is_told_only_is_told_by_its_finding() -> None:
    told = Check("blind_columns", 8.0, None, True, "why it matters", "8 columns never return")
    judged = Check("reach_mm", 900.0, 1000.0, True, "why the limit is there", "the flange is 900 mm away")
    assert [row[-1] for row in check_rows([told, judged], passed=True)] == [told.finding, judged.reason]
