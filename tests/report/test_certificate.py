"""The first page: what the part is, what was found, how well, and what that means; it stands under a signature."""

from __future__ import annotations

import dataclasses
import math

import pytest

from workbench.artefacts import Chapter, Part
from workbench.report import html
from workbench.report.html import Sheet, calibration_rows, dated, identity_html, identity_rows, page
from workbench.report.tables import MOST_ROWS, budget, certificate_html, least_favourable, small


def test_what_is_unknown_is_said(elements):
    text = elements(identity_html(Part(part_id="A-7", sensor="LPS 36", sensor_serial="12"))).text
    assert "LPS 36, serial number 12" in text
    assert "--input" not in text  # a sheet to sign under is no manual
    assert dict((name, value) for name, value, _ in identity_rows(Part()))["Operator"] == "unknown"
    known = Part(sensor_calibrated_at="2026-03-01", recorded_at="2026-03-31T10:00")
    told = dict((name, value) for name, value, _ in calibration_rows(known))
    assert told["Sensor calibrated"] == "2026-03-01, 30 days before; interval unknown"


def test_of_a_calibration_only_the_instruments_are_told(elements):
    text = elements(identity_html(Part(robot_serial="77"), "instruments")).text
    assert "serial number 77" in text
    assert "Drawing" not in text


def test_what_an_office_gives_is_shown_and_nothing_else(part, elements):
    """Escaped on the page and in the foot of each printed one, which counts its pages."""
    made = part(frames=60, columns=80).inspection
    chapter = Chapter("Inspection", "", "pass", part=made.part, certificate=certificate_html(made))
    sheet = Sheet(report_number='7</style>"', customer="<b>ACME & Sons", sensor_certificate="K-19", temperature_c=20.5)
    whole = html((chapter,), sheet=sheet).content.decode()
    text = elements(whole).text
    for told in ('7</style>"', "<b>ACME & Sons", "certificate K-19; date unknown", "20.5 °C"):
        assert told in text
    assert whole.count("</style>") == 1
    assert "@bottom-left" in whole
    for name in ("Order", "Issued"):
        assert name not in text
    assert "Report number" not in elements(html((chapter,)).content.decode()).text
    with pytest.raises(ValueError, match="issued_at: expected a date"):
        Sheet(issued_at="tomorrow")


@pytest.mark.parametrize(
    ("day", "of", "text"),
    [
        ("2026-03-01", "2026-03-31T10:00", "2026-03-01, 30 days before"),
        ("2024-03-31", "2026-03-31", "2024-03-31, 2.0 years before"),
        ("2026-04-01", "2026-03-31", "2026-04-01, after the recording"),
        ("2026-04-01", None, "2026-04-01"),
        (None, "2026-03-31", ""),
    ],
)
def test_a_calibration_has_its_age_at_the_recording(day, of, text):
    assert dated(day, of) == text


def test_the_budget_ends_in_the_largest_section(part):
    made = part(frames=60, columns=80).inspection
    u = max(s.root_u_mm for s in made.sections if s.root_u_mm is not None)
    by = {"root_mm": {"faces: tilt": 0.6 * u, "other ends": 0.8 * u}, "bevel_deg": {"other ends": 0.02}}
    told = tuple(dataclasses.replace(s, u_by_source=by) if s.root_mm is not None else s for s in made.sections)
    rows, totals = budget(dataclasses.replace(made, sections=told))
    assert [row[:2] for row in rows] == [("faces: tilt", "A"), ("other ends", "B")]
    assert rows[0][3] == "–"
    combined, expanded = (float(row[2]) for row in totals)
    assert combined == pytest.approx(u, rel=0.06)  # two significant digits
    assert expanded == pytest.approx(2 * u, rel=0.06)


def test_small_numbers_keep_the_decimals_of_the_whole():
    assert small(0.00051, 4) == "0.0005"
    assert small(0.000004, 4) == "< 0.0001"
    assert small(math.nan, 4) == small(0.0, 4) == "–"


def test_many_sections_are_cut_to_the_least_favourable(part, elements):
    made = part(frames=60, columns=80, sections=30, verdict="fail").inspection
    shown = least_favourable(made)
    assert len(shown) == MOST_ROWS
    assert {s.index for s in made.sections if s.verdict == "fail"} <= shown
    assert f"the {MOST_ROWS} least favourable of 30" in elements(certificate_html(made)).text


def test_a_simulated_part_says_so_across_the_page(part, elements):
    made = part(frames=60, columns=80).inspection
    chapter = Chapter("Inspection", "", "pass", part=Part(simulated=True), certificate=certificate_html(made))
    assert "SIMULATED" in elements(page((chapter,), None)).text
    real = dataclasses.replace(chapter, part=Part(simulated=False))
    assert "SIMULATED" not in elements(html((real,)).content.decode()).text
