"""The first page: what the part is, what was found, how well, and what that means; it stands under a signature."""

from __future__ import annotations

import dataclasses
import re

import pytest

from tests.report.conftest import text_of
from workbench.artefacts import Chapter, Check, Part, Quantity
from workbench.errors import PipelineError
from workbench.report import html, inspection


@pytest.fixture
def certified(part, quick, drawn):
    """`certified(checks=..., ...)`: the chapter on an inspection, changed as asked for."""

    def make(**changes):
        p = part(frames=60, columns=80)
        return inspection(p.cloud, p.edge, dataclasses.replace(p.inspection, **changes))

    return make


def page_of(part, elements):
    chapter = Chapter("Inspection", "", "pass", part=part, certificate="<p>x</p>")
    return elements(html((chapter,)).content.decode())


def test_what_is_unknown_is_said(elements):
    text = page_of(Part(part_id="A-7", sensor="LPS 36", sensor_serial="12"), elements).text
    assert "LPS 36, serial number 12" in text
    assert "--input" not in text  # a sheet to sign under is no manual
    assert re.search(r"Operator\s*unknown", text)


def test_what_an_office_gives_is_shown_and_nothing_else(certified, elements):
    """Escaped on the page and in the foot of each printed one, which counts its pages."""
    chapter = certified()
    office = {"report_number": '7</style>"', "customer": "<b>ACME & Sons", "sensor_certificate": "K-19"}
    whole = html((chapter,), sheet={**office, "temperature_c": 20.5}).content.decode()
    text = elements(whole).text
    for told in ('7</style>"', "<b>ACME & Sons", "certificate K-19; date unknown", "20.5 °C"):
        assert told in text
    assert whole.count("</style>") == 1
    assert "@bottom-left" in whole
    for name in ("Order", "Issued"):
        assert name not in text
    assert "Report number" not in elements(html((chapter,)).content.decode()).text
    with pytest.raises(PipelineError, match="issued_at: expected a date"):
        html((chapter,), sheet={"issued_at": "tomorrow"})


@pytest.mark.parametrize(
    ("day", "of", "text"),
    [
        ("2026-03-01", "2026-03-31T10:00", "2026-03-01, 30 days before"),
        ("2024-03-31", "2026-03-31", "2024-03-31, 2.0 years before"),
        ("2026-04-01", "2026-03-31", "2026-04-01, after the recording"),
        ("2026-04-01", None, "2026-04-01"),
    ],
)
def test_a_calibration_has_its_age_at_the_recording(day, of, text, elements):
    assert text in page_of(Part(sensor_calibrated_at=day, recorded_at=of), elements).text


def test_the_budget_ends_in_the_largest_section(part, quick, drawn):
    p = part(frames=60, columns=80)
    u = max(s.values["root_u_mm"] for s in p.inspection.sections if s.values["root_u_mm"] is not None)
    by = {"root_mm": {"faces: tilt": 0.6 * u, "other ends": 0.8 * u}, "bevel_deg": {"other ends": 0.02}}
    told = tuple(
        dataclasses.replace(s, sizes={name: Quantity.of(name, q.value, by[name]) for name, q in s.sizes.items()})
        for s in p.inspection.sections
    )
    text = text_of(inspection(p.cloud, p.edge, dataclasses.replace(p.inspection, sections=told)))
    number = r"([\d.]+)"
    tilt, ends = re.search(rf"faces: tilt A {number} – other ends B {number}", text).groups()
    assert (float(tilt), float(ends)) == pytest.approx((0.6 * u, 0.8 * u), rel=0.06)  # two significant digits
    (combined,) = re.search(rf"Combined[^\d]*{number}", text).groups()
    (expanded,) = re.search(rf"Expanded[^\d]*[\d.]*[^\d]*{number}", text[text.index("Combined") :]).groups()
    assert float(combined) == pytest.approx(u, rel=0.06)
    assert float(expanded) in (pytest.approx(2 * u, rel=0.06), 2.0)


def test_many_sections_are_cut_to_the_least_favourable(part, quick, drawn):
    p = part(frames=60, columns=80, sections=30)
    found = tuple(dataclasses.replace(s, verdict="fail") if s.index > 27 else s for s in p.inspection.sections)
    chapter = inspection(p.cloud, p.edge, dataclasses.replace(p.inspection, sections=found))
    (most,) = re.findall(r"the (\d+) least favourable of 30", text_of(chapter))
    shown = re.findall(r'data-mark="(\d+)"', chapter.certificate)
    assert len(shown) == int(most)
    assert {"28", "29", "30"} <= set(shown)


def test_what_is_told_only_is_told_by_its_finding(certified):
    told = Check("blind_columns", 8.0, None, True, "why it matters", "8 columns never return")
    judged = Check("reach_mm", 900.0, 1000.0, True, "why the limit is there", "the flange is 900 mm away")
    text = certified(checks=(told, judged)).html
    assert told.finding in text
    assert judged.reason in text
    assert judged.finding not in text


def test_a_simulated_part_says_so_across_the_page(elements):
    assert "SIMULATED" in page_of(Part(simulated=True), elements).text
    assert "SIMULATED" not in page_of(Part(simulated=False), elements).text
