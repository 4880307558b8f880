"""A groove's report: the certificate says what groove.json says, the section is drawn and dimensioned."""

from __future__ import annotations

import base64
import re
from pathlib import Path
from xml.etree import ElementTree

import pytest

from workbench.cloud import denoise
from workbench.edge import segment_groove
from workbench.inspect import groove as inspect_groove
from workbench.report import groove as report_groove
from workbench.report import html
from workbench.scan import fuse, read

RECORDING = Path(__file__).parents[2] / "data" / "synthetic" / "groove.h5"
WANTED = {
    "gap_mm": 2.4,
    "gap_tolerance_mm": [-0.5, 0.5],
    "misalignment_mm": 0,
    "misalignment_tolerance_mm": [-0.2, 0.2],
}
SVG = "{http://www.w3.org/2000/svg}"


@pytest.fixture(scope="module")
def found():
    cloud = denoise(fuse(read(recording=RECORDING)))
    return cloud, segment_groove(cloud)


@pytest.fixture(scope="module")
def judged(found):
    return inspect_groove(found[1], nominal=WANTED)


@pytest.fixture(scope="module")
def chapter(found, judged):
    return report_groove(*found, judged)


def drawings(text):
    return [
        ElementTree.fromstring(base64.b64decode(data))
        for data in re.findall(r"data:image/svg\+xml;base64,([A-Za-z0-9+/=]+)", text)
    ]


def place(text):
    return [float(one) for one in re.findall(r"[-\d.]+", text.get("transform"))[:2]]


def font(text):
    return float(text.get("font-size"))


def test_the_first_page_states_what_was_decided(chapter, judged, elements):
    text = elements(chapter.certificate).text
    assert judged.verdict == chapter.verdict == "fail"
    assert "Nonconformity with the specification is verified." in text
    assert "linear misalignment out of tolerance" in text
    assert "1.9 to 2.9 mm" in text
    assert "SIMULATED" in elements(html((chapter,)).content.decode()).text
    unseen = judged.uncertainty.not_included
    assert all(one.told in text for one in unseen[:3])
    assert f"{len(unseen) - 3} more" in text


def test_every_size_has_its_largest_u(chapter, judged, elements):
    text = elements(chapter.certificate).text
    for name, u in (("Root gap", "gap_u_mm"), ("Width", "width_u_mm")):
        largest = 2 * max(one.values[u] for one in judged.sections if one.values[u] is not None)
        row = text[text.index(name) :]
        shown = float(re.search(r"([\d.]+) mm\s+(?:[A-Z]|$)", row)[1])
        assert shown == pytest.approx(largest, rel=0.2)


def test_the_section_is_drawn_with_its_dimensions(chapter, judged):
    section, *charts = drawings(chapter.html)
    words = " ".join(section.itertext())
    letters = {"gap_mm": "b", "root_face_left_mm": "c₁", "depth_mm": "h", "included_deg": "α"}
    drawn = {name: float(re.search(rf"\b{one} = \(?([\d.]+) ±", words)[1]) for name, one in letters.items()}
    assert any({name: one.values[name] for name in drawn} == pytest.approx(drawn, abs=6e-3) for one in judged.sections)
    assert "c₂" not in words  # not seen, so not drawn
    sizes = [one.term.lower() for one in judged.characteristics if any(one.pairs)]
    assert all("arc length along the groove, mm" in " ".join(one.itertext()) for one in charts)
    assert all(any(term in " ".join(one.itertext()) for one in charts) for term in sizes)


def test_labels_stand_on_the_sheet_and_off_the_arrows(found, judged):
    """A size that varies by micrometres has long names of ticks, which pushed its label off the sheet."""
    section, *charts = drawings(report_groove(*found, inspect_groove(found[1])).html)
    at = {"".join(one.itertext()): one for one in section.iter(f"{SVG}text")}
    arrow = next(place(one)[1] for text, one in at.items() if text.startswith("Width"))  # its text stands beside it
    above = [one for text, one in at.items() if text.startswith(("α", "Linear misalignment"))]
    assert len(above) == 2
    assert all(0.5 * font(one) < place(one)[1] < arrow - 1.3 * font(one) for one in above)
    terms = [one.term.lower() for one in judged.characteristics if any(one.pairs)]
    for term, chart in zip(terms, charts, strict=True):
        label = next(one for one in chart.iter(f"{SVG}text") if term in "".join(one.itertext()))
        assert place(label)[0] > 0.76 * font(label)


def test_without_a_specification_nothing_is_stated(found, elements):
    made = report_groove(*found, inspect_groove(found[1]))
    assert made.verdict == ""
    text = elements(made.certificate).text
    assert "conformity was not assessed" in text
    assert "Conformity with" not in text
    assert "Decision rule" not in text
