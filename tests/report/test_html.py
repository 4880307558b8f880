"""The page that binds the chapters: complete in one file, safe, and saying first what matters."""

from __future__ import annotations

import json
from dataclasses import replace

import pytest

from workbench import pieces
from workbench.artefacts import Chapter, Part
from workbench.errors import InputError
from workbench.report import html

PASSED = Chapter(
    "Inspection", "<h3>Sections</h3><p>nine</p>", "pass", "all 9 sections within tolerance", Part(part_id="B-17")
)
PLANNED = Chapter(
    "Plan", "<p>ten layers</p>", "", "10 layers in 12 min", Part(part_id="B-17"), ("edge hidden from 3 to 9 mm",)
)
FAILED = Chapter(
    "Closed loop", "<p>too large</p>", "fail", "root 2.6 mm", Part(part_id="C-18"), ("edge hidden from 3 to 9 mm",)
)


def page_of(*chapters, provenance=None):
    return html(chapters, provenance).content.decode()


def test_every_chapter_has_its_line_at_the_top_and_its_place(elements):
    page = page_of(PLANNED, PASSED)
    top, _, rest = page.partition('<section class="chapter"')
    for k, chapter in enumerate((PLANNED, PASSED), 1):
        assert f'<a href="#chapter-{k}">{k} {chapter.title}</a>' in top
        assert chapter.summary in top
        assert chapter.html in rest
    ids = [attributes["id"] for _, attributes in elements(page).tags if "id" in attributes]
    assert ids == ["chapter-1", "chapter-2"]


@pytest.mark.parametrize(
    ("chapters", "verdict"), [((PASSED, PLANNED), "pass"), ((PASSED, FAILED, PLANNED), "fail"), ((PLANNED,), "")]
)
def test_the_overall_verdict_is_the_worst(chapters, verdict):
    page = page_of(*chapters)
    assert ('<div class="verdict' in page) == bool(verdict)
    assert f'<div class="verdict {verdict}">' in page or not verdict


def test_parts_are_named_once_and_warnings_with_their_chapter(elements):
    text = elements(page_of(PLANNED, PASSED, FAILED)).text
    assert "B-17, C-18" in text
    assert "Plan: edge hidden from 3 to 9 mm" in text
    assert "Closed loop: edge hidden from 3 to 9 mm" in text
    assert "Plan: edge hidden" not in elements(page_of(PLANNED)).text


def test_pictures_within_and_links_inside_the_page_are_welcome():
    inside = '<img src="data:image/png;base64,AA==" alt=""><a href="#chapter-1">x</a><svg><use href="#a"/></svg>'
    assert inside in page_of(PASSED, Chapter("Stranger", inside))


def test_no_chapter_is_refused():
    with pytest.raises(InputError, match="at least one chapter"):
        html(())


def test_provenance_stands_in_the_page(elements, provenance):
    text = elements(page_of(PASSED, provenance=provenance)).text
    assert "ab" * 32 in text
    assert "Seed 7" in text
    assert "numpy" not in text  # no version that the run did not state
    assert "not recorded" in elements(page_of(PASSED)).text
    assert "Part without identification" in elements(page_of(Chapter("Plan", "", part=Part()))).text
    assert "unknown" in elements(page_of(Chapter("Plan", "", part=Part()))).text
    assert "--input part_id=" not in elements(page_of(Chapter("Plan", "", part=Part()))).text


def test_the_pipeline_is_shown_whole(elements, provenance):
    pipeline = {"version": 1, "inputs": {"a": None}, "stages": [{"stage": "x.y", "k": [1, 2]}, {"stage": "é"}]}
    text = elements(page_of(PASSED, provenance=replace(provenance, pipeline=pipeline))).text
    shown = text[text.index('{\n  "version"') :]
    assert json.JSONDecoder().raw_decode(shown)[0] == pipeline
    assert '    {"stage": "é"}' in shown.splitlines()


def test_every_piece_of_a_chapter_escapes_its_text() -> None:
    text = '<script>alert("x")</script>'
    for made in (
        pieces.figure_html(b"<svg/>", text, text, [("red", text)]),
        pieces.table_html([text], [[text]], text),
        pieces.facts_html([(text, text)]),
        pieces.list_html([text]),
        pieces.heading(text),
        pieces.note(text),
        pieces.paragraph(text),
    ):
        assert "&lt;script&gt;" in made
        assert "<script" not in made
