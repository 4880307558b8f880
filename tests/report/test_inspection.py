"""The chapter on an inspection: complete, safe, the same every time, and alive where VTK is not."""

from __future__ import annotations

import base64
import dataclasses
import hashlib
import io
import json
import re

import numpy as np
import pytest
from PIL import Image

from tests.conftest import bevel_sizes
from workbench.errors import InputError
from workbench.report import html, inspection


@pytest.fixture(scope="module")
def small(part, hostile):
    return part(frames=120, columns=120, verdict="fail", part_id=hostile)


@pytest.fixture(scope="module")
def chapter(small):
    return inspection(small.cloud, small.edge, small.inspection)


@pytest.fixture(scope="module")
def document(chapter, provenance):
    return html((chapter,), provenance)


@pytest.fixture(scope="module")
def page(document, elements):
    return elements(document.content.decode())


def test_every_picture_opens_and_shows_something(page):
    for tag, attributes in page.tags:
        if tag != "img":
            continue
        sort, _, data = attributes["src"].partition(";base64,")
        content = base64.b64decode(data, validate=True)
        assert attributes["alt"]
        if sort == "data:image/png":
            assert np.std(np.asarray(Image.open(io.BytesIO(content)).convert("L"))) > 5
        else:
            assert content.rstrip().endswith(b"</svg>")
            assert b"<dc:date>" not in content


def test_values_and_verdicts_stand_in_the_page(small, page):
    text = re.sub(r"\s+", " ", page.text)
    for section in small.inspection.sections:
        if section.values["root_mm"] is not None:
            assert f"{section.values['root_mm']:.4f} ± 0.0062" in text
            assert f"{section.values['bevel_deg']:.3f} ± 0.042" in text
    assert "Nonconformity with the specification is verified." in text
    assert "1.0 to 2.0 mm" in text
    assert "39 to 41°" in text
    assert "5 %" in text  # the risk that a guard band of 1.645 u leaves
    for warning in (*small.inspection.warnings, *small.edge.warnings):
        assert warning in text


def test_the_chapter_says_what_was_decided(small, chapter):
    assert (chapter.title, chapter.verdict, chapter.summary) == ("Inspection", "fail", small.inspection.reason)
    assert set(chapter.warnings) == {*small.inspection.warnings, *small.edge.warnings}


@pytest.mark.parametrize("variant", ["one section", "no gap", "two passes", "one station", "frames without edge"])
def test_unusual_parts_are_reported_too(part, variant, quick):
    p = part(frames=80, columns=80, clamp=(-2.0, -1.0), sections=1 if variant == "one section" else 9)
    cloud, edge = p.cloud, p.edge
    if variant == "two passes":
        cloud = dataclasses.replace(cloud, pass_index=np.repeat([0, 1], 40))
        edge = dataclasses.replace(edge, frame_arc_length_mm=np.r_[edge.frame_arc_length_mm[:40], np.full(40, np.nan)])
    if variant == "one station":
        position = np.full_like(edge.position_mm, np.nan)
        position[50] = edge.position_mm[50]
        edge = dataclasses.replace(edge, position_mm=position, seen=np.arange(len(position)) == 50)
    if variant == "frames without edge":
        nothing = np.full(80, np.nan)
        edge = dataclasses.replace(edge, frame_arc_length_mm=nothing, labels=np.zeros_like(edge.labels))
    assert inspection(cloud, edge, p.inspection).html.count("<img") == 6


def test_a_part_that_is_hidden_in_all_sections_is_drawn(part):
    p = part(frames=60, columns=60)
    nothing = {"sizes": bevel_sizes(*[None] * 4)}
    hidden = tuple(dataclasses.replace(s, **nothing, frames=np.arange(0)) for s in p.inspection.sections)
    measured = dataclasses.replace(p.inspection, sections=hidden, verdict="undecided")
    assert inspection(p.cloud, p.edge, measured).verdict == "undecided"


def test_u_along_the_edge_is_drawn_against_the_plan(small, chapter, tmp_path):
    """What the plan wanted and predicted, and what was achieved: three courses of each size, on one scale."""
    told = {
        "arc_length_mm": [0.0, 50.0],
        "root_U_mm": [0.02, None],
        "bevel_U_deg": [0.1, 0.1],
        "reached": [True, False],
        "root_u_by_source_mm": {},
        "bevel_u_by_source_deg": {},
    }
    plan = {"format": "scan-plan", "version": 1, "frame": "base", "edge": "taught", "thickness_mm": 8, "root_mm": 1.5}
    plan |= {"bevel_deg": 40, "edge_condition": "unknown", "wanted_root_U_mm": 7.0, "wanted_bevel_U_deg": 90.0}
    plan |= {"reached": False, "duration_s": 20, "passes": [], "predicted": told}
    file = tmp_path / "scan-plan.json"
    file.write_text(json.dumps(plan | {"binds": [], "would_help": [], "not_checked": []}))
    of_plan = dataclasses.replace(small.cloud.part, scan_plan=hashlib.sha256(file.read_bytes()).hexdigest()[:16])
    cloud = dataclasses.replace(small.cloud, part=of_plan)
    made = inspection(cloud, small.edge, small.inspection, scan_plan=file)
    source = re.search(r'src="data:image/svg\+xml;base64,([^"]+)" alt="U along the edge', made.html)
    drawing = base64.b64decode(source[1]).decode()
    for shown in ("U root face, mm", "U bevel angle", ">6<", ">80<"):  # the scales hold what is wanted
        assert shown in drawing
    another = inspection(small.cloud, small.edge, small.inspection, scan_plan=file)
    assert "U along the edge" not in chapter.html + another.html


def test_no_sections_is_refused(small):
    with pytest.raises(InputError, match="at least one section"):
        inspection(small.cloud, small.edge, dataclasses.replace(small.inspection, sections=()))


def test_an_edge_of_which_nothing_was_measured_is_refused(small):
    edge = dataclasses.replace(small.edge, position_mm=np.full_like(small.edge.position_mm, np.nan))
    with pytest.raises(InputError, match="something was measured"):
        inspection(small.cloud, edge, small.inspection)
