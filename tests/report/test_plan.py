"""The chapter on a plan: what was required, planned and refused; complete, and the same every time.

The section drawing of the plan shows the path's own layers on the stock, at their places.
"""

from __future__ import annotations

import dataclasses
import re
from html import unescape

import numpy as np
import pytest

from workbench.artefacts import Engagement, Gate, LayerEngagement, Moves, Part
from workbench.errors import InputError
from workbench.report import html, plan
from workbench.report.path_charts import engagement_chart
from workbench.report.plan import stepped_section, stepping_drawing
from workbench.report.planned import duration

PASSED = Gate(True, "frames, spacing and clearances hold")
BETA = np.radians(40.0)


def moves_of(path, targets):
    nothing = np.full((targets, 4), np.nan)
    return Moves(
        nothing[:, :3],
        nothing,
        np.arange(targets) < 5,
        nothing[:, :3],
        nothing,
        np.ones(targets),
        np.ones(targets, bool),
        np.ones(targets, int),
        path,
        1300,
        0.01,
        0.05,
    )


def engagement_of(path):
    return Engagement(
        tuple(
            LayerEngagement(x.index, x.arc_length_mm, 1.0 * x.cutting, x.width_mm, x.width_mm * x.cutting)
            for x in path.layers
        )
    )


def text_of(chapter):
    return re.sub(r"\s+", " ", unescape(re.sub(r"<[^>]+>", " ", chapter.html)))


@pytest.fixture(scope="module")
def chapter(planned):
    p = planned()
    path = dataclasses.replace(
        p.toolpath, refused=("arc length 89.0 to 123.0 mm: clamp",), warnings=("mind the clamp",)
    )
    return plan(p.cloud, p.edge, path, moves_of(path, 65), PASSED, engagement_of(path))


def test_the_chapter_says_what_was_decided(chapter):
    assert (chapter.title, chapter.verdict, chapter.part.part_id) == ("Plan", "pass", "B-17")
    assert chapter.warnings == ("mind the clamp",)
    assert chapter.summary.startswith("6 layers in ")
    assert "% less than at 1 mm/s throughout" in chapter.summary


def test_numbers_stand_in_the_chapter(chapter):
    text = text_of(chapter)
    for shown in (
        "Root face 1.5 mm 1.500 mm 1.500 mm ± 0.016 mm",  # 2 hypot(0.004, 0.006 / tan 40 deg)
        "Bevel angle 40° 40.000° 40.000° ± 0.057°",
        "Thickness 10.00 mm",
        "of which 996 mm cutting",  # six times 0 to 89 and 123 to 200 mm
        "65 (20.0 times fewer), 5 of them circular; within 0.01 mm and 0.05° of the points",
        "arc length 89.0 to 123.0 mm: clamp",
        "arc length 89.0 to 123.0 mm: nothing is cut where nothing was measured",
        "frames, spacing and clearances hold",
        "Section at 44.0 mm",  # in the longest stretch that is cut
    ):
        assert shown in text, shown


def test_time_and_saving_are_those_of_the_path(chapter, planned):
    path = planned().toolpath
    position, feed = [], []
    for travel, layer in zip(path.travels, (*path.layers, None), strict=True):
        for part in (travel, layer):
            if part is not None:
                position.append(part.position_mm)
                feed.append(part.feed_mm_s)
    step = np.linalg.norm(np.diff(np.vstack(position), axis=0), axis=1)
    time, at_slow = (step / np.concatenate(feed)[1:]).sum(), step.sum() / 1.0
    text = text_of(chapter)
    assert f"Time {duration(time)}" in text
    assert f"Time saved {duration(at_slow - time)} ({100 * (1 - time / at_slow):.0f} %)" in text


def test_all_pictures_are_there_and_the_page_needs_nothing_else(chapter, elements):
    pictures = [attributes for tag, attributes in elements(chapter.html).tags if tag == "img"]
    sorts = [attributes["src"].partition(";")[0] for attributes in pictures]
    assert sorts.count("data:image/png") == 8  # a, b, c, e, f; all layers twice; feed
    assert sorts.count("data:image/svg+xml") == 7  # d, section, feed, engagement, scales
    assert all(attributes["alt"] for attributes in pictures)
    assert chapter.html in html((chapter,)).content.decode()


def test_a_path_that_did_not_pass_is_not_released(planned, quick):
    p = planned()
    chapter = plan(p.cloud, p.edge, p.toolpath, None, Gate(False, "layer 3 at 12.0 mm lies below the finished bevel"))
    assert (chapter.verdict, chapter.summary) == (
        "fail",
        "not released: layer 3 at 12.0 mm lies below the finished bevel",
    )
    assert "The whole path layer 3 at 12.0 mm lies below" in text_of(chapter)


def test_what_was_not_done_is_said(planned, quick):
    p = planned(clamp=(-2.0, -1.0))
    chapter = plan(p.cloud, p.edge, p.toolpath)
    text = text_of(chapter)
    assert chapter.verdict == ""
    for shown in ("not simplified", "not checked in this run", "Nothing was refused"):
        assert shown in text
    assert "Engagement" not in text


def test_a_path_that_cuts_nothing_is_reported_too(planned, quick):
    p = planned()
    idle = tuple(dataclasses.replace(x, cutting=np.zeros_like(x.cutting)) for x in p.toolpath.layers)
    assert "–" in plan(p.cloud, p.edge, dataclasses.replace(p.toolpath, layers=idle)).html


@pytest.mark.parametrize("radius_mm", [300.0])
def test_one_layer_on_an_arc_without_travels(planned, quick, radius_mm):
    p = planned(radius_mm=radius_mm)
    path = dataclasses.replace(p.toolpath, layers=p.toolpath.layers[-1:], travels=())
    assert plan(p.cloud, p.edge, path, points=10_000).summary.startswith("1 layer in ")


def test_names_out_of_files_are_text(planned, quick, hostile, elements):
    p = planned()
    cloud = dataclasses.replace(p.cloud, source=hostile, part=Part(part_id=hostile))
    path = dataclasses.replace(p.toolpath, refused=(hostile,), part=Part(part_id=hostile))
    chapter = plan(cloud, p.edge, path, None, Gate(True, hostile))
    page = html((chapter,)).content.decode()
    assert elements(page).scripts_are_the_reports_own()
    assert elements(page).text.count('<script>alert("x")</script>') >= 4


def test_an_empty_path_is_refused(planned):
    p = planned()
    with pytest.raises(InputError, match="at least one layer"):
        plan(p.cloud, p.edge, dataclasses.replace(p.toolpath, layers=()))


@pytest.mark.parametrize(
    ("seconds", "shown"),
    [(0.04, "0.0 s"), (59.9, "59.9 s"), (59.97, "1 min 0 s"), (125.4, "2 min 5 s"), (3840, "1 h 4 min")],
)
def test_durations_are_written_to_be_read(seconds, shown):
    assert duration(seconds) == shown


@pytest.mark.parametrize("radius_mm", [None, 300.0])
def test_layers_run_from_the_upper_surface_to_the_end_face(planned, radius_mm):
    p = planned(radius_mm=radius_mm, clamp=(-2.0, -1.0))
    stepped = stepped_section(p.edge, p.toolpath)
    assert stepped.arc_length_mm == pytest.approx(100.0, abs=0.01)
    assert stepped.thickness_mm == pytest.approx(10.0)
    assert [cut.layer.height_mm for cut in stepped.cuts] == [5, 4, 3, 2, 1, 0]
    for cut in stepped.cuts:
        on_end_face = 1.5 + cut.layer.height_mm / np.sin(BETA)
        np.testing.assert_allclose(cut.lower, [0.0, on_end_face], atol=2e-3)
        np.testing.assert_allclose(cut.upper, [-(10.0 - on_end_face) * np.tan(BETA), 10.0], atol=2e-3)


def test_it_lies_in_the_longest_stretch_that_is_cut(planned):
    p = planned()  # cut from 0 to 89 and from 123 to 200 mm
    assert stepped_section(p.edge, p.toolpath).arc_length_mm == pytest.approx(44.5, abs=0.51)


def test_it_is_dimensioned_from_the_path(planned, by_formula, drawn):
    p = planned(clamp=(-2.0, -1.0))
    path = by_formula(clamp=(-2.0, -1.0), bevel_deg=41.0)
    stepping_drawing(p.cloud, p.edge, path, stepped_section(p.edge, path))
    texts = {text.text for text in drawn[0].axes[0].texts}
    assert {"root face 1.500 ± 0.016 mm", "(41.000 ± 0.057)°", "thickness\n10.00 mm", "depth of cut 1 mm"} <= texts
    assert {"1", "2", "3", "4", "5", "6"} <= texts


def test_no_text_lies_on_another_or_outside(planned, drawn):
    p = planned(clamp=(-2.0, -1.0))
    for layers in (p.toolpath.layers, p.toolpath.layers[-1:]):
        path = dataclasses.replace(p.toolpath, layers=layers)
        stepping_drawing(p.cloud, p.edge, path, stepped_section(p.edge, path))
    engagement_chart(p.edge, dataclasses.replace(p.toolpath, depth_of_cut_mm=3.0), engagement_of(p.toolpath))
    for figure in drawn:
        boxes = [text.place() for text in figure.axes[0].texts]
        for k, (left, top, right, bottom) in enumerate(boxes):
            assert 0.0 <= left < right <= figure.width
            assert 0.0 <= top < bottom <= figure.height
            for x0, y0, x1, y1 in boxes[k + 1 :]:
                assert x1 <= left or right <= x0 or y1 <= top or bottom <= y0


def test_no_drawing_where_nothing_is_cut(planned):
    p = planned()
    idle = tuple(dataclasses.replace(x, cutting=np.zeros_like(x.cutting)) for x in p.toolpath.layers)
    assert stepped_section(p.edge, dataclasses.replace(p.toolpath, layers=idle)) is None
