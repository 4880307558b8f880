"""The chapter: its numbers are the calibration's, its pictures are whole, and text out of files is escaped."""

from __future__ import annotations

import base64
import dataclasses
import re
from xml.etree import ElementTree

import pytest

from bench.drawn.spheres import random_sphere_recipe
from workbench.artefacts import Part
from workbench.plugins.calibration import circles, hand_eye, plan, report, validate
from workbench.synthetic import simulate_sphere


@pytest.fixture(scope="module")
def parts():
    recording, _ = simulate_sphere(random_sphere_recipe("sphere_gross", 5))
    recording = dataclasses.replace(recording, part=Part(part_id="<b>ball</b>"))
    profiles = circles(recording)
    _, found, _ = hand_eye(profiles, recording)
    return found, profiles, recording, plan(found, profiles, recording)[0], validate(found, profiles, recording)[0]


@pytest.fixture(scope="module")
def chapter(parts):
    return report(*parts)


def test_chapter_tells_everything(parts, chapter):
    titles = re.findall(r"<h3>(.*?)</h3>", chapter.html)
    assert titles == [
        "Principal directions of the uncertainty",
        "Sphere centres in the base",
        "Residuals of the postures",
        "Rejected frames",
        "Profiles and fitted circles",
        "Errors on held-out postures",
        "Proposed further postures",
    ]
    found = parts[0]
    assert f"{found.volume_u_mm:.3f} mm" in chapter.html
    for words, u in found.directions:
        assert f"{words}" in chapter.html.replace("&#x27;", "'").replace("−", "-")
        assert f"{u:.3f}" in chapter.html
    assert chapter.html.count("gross pose") == 2
    assert chapter.warnings == found.warnings
    assert "13 of 15 postures" in chapter.summary
    assert "good enough" in chapter.summary


def test_a_sphere_without_a_name_is_called_by_its_size(parts, chapter):
    found, profiles, recording, *more = parts
    nameless = report(found, profiles, dataclasses.replace(recording, part=Part()), *more)
    assert chapter.part.part_id == "<b>ball</b>"
    assert nameless.part.part_id == f"Sphere of {recording.sphere_diameter_mm:g} mm"


def test_html_is_well_formed_and_names_nothing_outside(chapter):
    page = ElementTree.fromstring(f"<div>{chapter.html}</div>")
    pictures = [image.attrib["src"] for image in page.iter("img")]
    assert len(pictures) == 3
    for address in pictures:
        kind, data = address.split(",", 1)
        assert kind == "data:image/svg+xml;base64"
        assert ElementTree.fromstring(base64.b64decode(data)).tag.endswith("svg")
    assert "http" not in "".join(page.itertext())
