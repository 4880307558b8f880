"""The chapter on a plan: what was required, planned and refused; complete, and the same every time."""

from __future__ import annotations

import dataclasses
import re

import numpy as np
import pytest

from tests.report.conftest import text_of
from workbench.artefacts import Engagement, Gate, LayerEngagement, Moves
from workbench.errors import InputError
from workbench.report import plan

PASSED = Gate(True, "frames, spacing and clearances hold")


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


def seconds(told):
    """What a person reads, to the last unit that stands there."""
    units = {"h": 3600, "min": 60, "s": 1}
    parts = [(float(number), units[unit]) for number, unit in re.findall(r"([\d.]+) (\w+)", told)]
    return pytest.approx(sum(number * unit for number, unit in parts), abs=0.1 if "." in told else parts[-1][1])


@pytest.mark.parametrize("slower", [0.05, 1.0, 4.0])
def test_time_and_saving_are_those_of_the_path(planned, quick, drawn, slower):
    p = planned()
    paced = [dataclasses.replace(one, feed_mm_s=one.feed_mm_s / slower) for one in p.toolpath.layers]
    back = [dataclasses.replace(one, feed_mm_s=one.feed_mm_s / slower) for one in p.toolpath.travels]
    path = dataclasses.replace(p.toolpath, layers=tuple(paced), travels=tuple(back), v_slow_mm_s=1.0 / slower)
    moves = [one for pair in zip(back, [*paced, None], strict=True) for one in pair if one is not None]
    step = np.linalg.norm(np.diff(np.vstack([one.position_mm for one in moves]), axis=0), axis=1)
    time, at_slow = (step / np.concatenate([one.feed_mm_s for one in moves])[1:]).sum(), step.sum() * slower
    text = text_of(plan(p.cloud, p.edge, path))
    (told,) = re.findall(r" Time ([^T]*) Cutting", text)
    ((saved, share),) = re.findall(r" Time saved (.*?) \((\d+) %\)", text)
    assert time == seconds(told)
    assert at_slow - time == seconds(saved)
    assert 100 * (1 - time / at_slow) == pytest.approx(float(share), abs=0.51)


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


def test_an_empty_path_is_refused(planned):
    p = planned()
    with pytest.raises(InputError, match="at least one layer"):
        plan(p.cloud, p.edge, dataclasses.replace(p.toolpath, layers=()))
