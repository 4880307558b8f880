"""The chapter on the closed loop: what was planned stands beside what was measured, in the same axes."""

from __future__ import annotations

import dataclasses
import re

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.conftest import bevel_sizes
from tests.report.conftest import make_part, path_by_formula, text_of
from workbench.artefacts import Engagement, LayerEngagement, Rework, Stretch
from workbench.errors import InputError
from workbench.report import closed_loop

PATH = path_by_formula()


@pytest.fixture(scope="module")
def inspected():
    return make_part(frames=20, columns=20, clamp=(-2.0, -1.0), sections=9).inspection


def planned_in(chapter):
    """Root face and bevel angle that the path was to make in each section, None where it does not cut."""
    rows = re.findall(r"(?<= )(\d) [\d.]+ (\S+) (?:\S+ ± \S+|–) (?:[+−]?\S+|–) (\S+) ", text_of(chapter))
    assert [row[0] for row in rows] == [*"123456789"]
    return [(None, None) if row[1] == "–" else (float(row[1]), float(row[2])) for row in rows]


@pytest.mark.parametrize("radius_mm", [None, 300.0])
def test_planned_values_are_those_of_the_path_in_each_section(part, by_formula, radius_mm):
    inspection = part(radius_mm=radius_mm, frames=50, columns=50).inspection
    found = planned_in(closed_loop(inspection, by_formula(radius_mm=radius_mm)))
    assert found == [(None, None) if k in (4, 5) else (1.5, 40.0) for k in range(9)]  # 89 to 123 mm are not cut


def test_a_path_that_is_off_shows_in_its_sections(part, by_formula):
    inspection, path = part(frames=50, columns=50).inspection, by_formula(bevel_deg=42.0)
    assert planned_in(closed_loop(inspection, path))[0] == (1.5, 42.0)
    off = dataclasses.replace(path.layers[-1], position_mm=path.layers[-1].position_mm + np.array([0.0, 0.0, 0.3]))
    assert planned_in(closed_loop(inspection, dataclasses.replace(path, layers=(off,))))[0] == (1.8, 42.0)
    away = dataclasses.replace(off, position_mm=off.position_mm + np.array([0.0, 500.0, 0.0]))
    nowhere = planned_in(closed_loop(inspection, dataclasses.replace(path, layers=(away,))))
    assert nowhere == [(None, None)] * 9


@given(root=st.floats(0.0, 9.0) | st.floats(1.499, 1.501), expanded=st.floats(0.0011, 9.0))
@settings(max_examples=60)
def test_values_are_written_as_well_as_they_are_known(inspected, root, expanded):
    """U to 5 %, a value to the same place, a deviation with its sign unless it rounds to nothing."""
    sizes = bevel_sizes(root, expanded / 2, 40.0, 0.02)
    one = dataclasses.replace(inspected.sections[0], sizes=sizes)
    chapter = closed_loop(dataclasses.replace(inspected, sections=(one,)), PATH)
    ((value, told, apart),) = re.findall(r" 1 11\.1 \S+ (\S+) ± (\S+) (\S+) ", text_of(chapter))
    places = len(value.partition(".")[2])
    assert len(told.partition(".")[2]) == places
    assert float(told) == pytest.approx(expanded, rel=0.05)
    assert float(value) == pytest.approx(root, abs=0.51 * 10.0**-places)
    shown = float(apart.replace("−", "-"))
    assert shown == pytest.approx(root - 1.5, abs=0.51 * 10.0 ** -len(apart.partition(".")[2]))
    assert apart[0] == ("+" if shown > 0 else "−" if shown < 0 else "0")


def test_asked_planned_and_measured_stand_in_the_chapter(part, by_formula):
    inspection = part(frames=50, columns=50).inspection
    chapter = closed_loop(inspection, by_formula(), Rework(None, (), (), "nothing to rework"))
    text = text_of(chapter)
    root = [s.values["root_mm"] for s in inspection.sections if s.values["root_mm"] is not None]
    bevel = [s.values["bevel_deg"] for s in inspection.sections if s.values["bevel_deg"] is not None]
    assert (chapter.title, chapter.verdict, chapter.part.part_id) == ("Closed loop", "pass", "B-17")
    assert chapter.summary == (
        f"root face {min(root):.3f} to {max(root):.3f} mm (required 1.5 mm), "
        f"bevel angle {min(bevel):.2f} to {max(bevel):.2f}° (required 40°); nothing to rework"
    )
    assert f"1 11.1 1.500 {root[0]:.4f} ± 0.0062 {root[0] - 1.5:+.3f} 40.00" in text
    assert "5 100.0 – – – – – –" in text
    assert "Nothing to rework." in text
    assert "Milled in simulation" not in text


def test_rework_is_told_stretch_by_stretch(part, by_formula):
    path = by_formula()
    rework = Rework(
        dataclasses.replace(path, layers=path.layers[-1:], travels=()),
        (Stretch(20.0, 40.0, "root 2.31 mm, at most 2.0 mm"),),
        (Stretch(150.0, 160.5, "root 0.71 mm, at least 1.0 mm"),),
        "1 stretch to be milled again",
        ("the rest of the edge stays as it is",),
    )
    chapter = closed_loop(part(frames=50, columns=50, verdict="fail").inspection, path, rework)
    text = text_of(chapter)
    assert chapter.verdict == "fail"
    assert chapter.summary.endswith("; 1 stretch to be milled again")
    assert "to be milled again 20.0 to 40.0 mm root 2.31 mm, at most 2.0 mm" in text
    assert "cannot be mended 150.0 to 160.5 mm root 0.71 mm" in text
    assert "Rework path: 1 layer, 168 cutting points, 166.0 mm cut" in text
    assert chapter.warnings == ("the rest of the edge stays as it is",)


def test_engagement_and_missing_rework(part, by_formula):
    s = np.arange(4.0)
    layer = LayerEngagement(3, s, np.array([0, 0.5, 1.25, 0]), np.array([0, 4, 5, 0.0]), np.array([0, 2, 6.5, 0]))
    chapter = closed_loop(part(frames=50, columns=50).inspection, by_formula(), None, Engagement((layer,)))
    text = text_of(chapter)
    assert "3 1.250 5.00 6.500 50 %" in text
    assert "Rework was not considered in this run." in text


def test_another_requirement_than_was_inspected_is_a_warning(part, by_formula):
    inspection = part(frames=50, columns=50).inspection
    chapter = closed_loop(inspection, dataclasses.replace(by_formula(), root_mm=2.0))
    assert chapter.warnings == ("the path was planned for a root face of 2 mm, the part inspected against 1.5 mm",)


def test_the_chart_draws_measured_and_planned(part, by_formula, drawn):
    inspection, path = part(frames=50, columns=50).inspection, by_formula()
    closed_loop(inspection, path)
    root, bevel = drawn[0].axes
    profile = inspection.profile
    for axes, values in ((root, profile.root_mm - 1.5), (bevel, profile.bevel_deg - 40.0)):
        expected = np.c_[profile.arc_length_mm, values]
        assert any(np.array_equal(line.xy, expected, equal_nan=True) for line in axes.lines)
        crosses = [line.xy[:, 1][0] for line in axes.lines if line.marker == "x"]
        np.testing.assert_allclose(crosses, 0.0, atol=1e-6)
        assert len(crosses) == 7  # two of the nine sections are not cut


def test_nothing_to_compare_is_refused(part, by_formula):
    inspection = part(frames=50, columns=50).inspection
    with pytest.raises(InputError, match="at least one section"):
        closed_loop(dataclasses.replace(inspection, sections=()), by_formula())
    with pytest.raises(InputError, match="at least one layer"):
        closed_loop(inspection, dataclasses.replace(by_formula(), layers=()))
