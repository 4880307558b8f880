"""Charts, sections and views show what was measured and planned, where it is: by the parts' own formulas."""

from __future__ import annotations

import dataclasses
import re

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tests.program.paths import in_work_object
from tests.report.conftest import text_of, with_text
from workbench.artefacts import ChainU, Engagement, LayerEngagement
from workbench.report import inspection, plan

BETA = np.radians(40.0)


def small(part, **changes):
    return part(**{"frames": 40, "columns": 40} | changes)


def chapter_of(p, **changes):
    return inspection(p.cloud, p.edge, dataclasses.replace(p.inspection, **changes))


# Inspections.


def test_sizes_are_drawn_with_their_limits_and_guard_bands(part, drawn, quick):
    p = small(part)
    chapter_of(p)
    profile, seen = p.inspection.profile, [*"123456789", "hidden"]
    for value, u, (low, high), unit in (
        (profile.root_mm, profile.root_u_mm, (1.0, 2.0), " mm"),
        (profile.bevel_deg, profile.bevel_u_deg, (39, 41), "°"),
    ):
        (axes,) = with_text(drawn, f"upper limit {high}{unit}", f"lower limit {low}{unit}", *seen).axes
        curves = [line.xy for line in axes.lines]
        for expected in (value, high - 1.645 * u, low + 1.645 * u):
            there = np.column_stack([profile.arc_length_mm, expected])
            assert any(xy.shape == there.shape and np.allclose(xy, there, equal_nan=True) for xy in curves)
        assert axes.get_ylim()[0] < low < high < axes.get_ylim()[1]


def test_a_value_beyond_its_limits_is_in_the_picture(part, drawn, quick):
    p = small(part)
    root = p.inspection.profile.root_mm + 2.0
    chapter_of(p, profile=dataclasses.replace(p.inspection.profile, root_mm=root))
    assert with_text(drawn, "upper limit 2.0 mm").axes[0].get_ylim()[1] > np.nanmax(root)


def panels(p, drawn, inspected):
    inspection(p.cloud, p.edge, inspected)
    return with_text(drawn, *(f"at {s.arc_length_mm:.1f} mm" for s in inspected.sections)).axes


@pytest.mark.parametrize("radius_mm", [None, 300.0])
def test_sections_show_the_points_on_their_lines(part, drawn, quick, radius_mm):
    """Range noise is 0.012 mm, root and angle drift by 0.01 mm here; all panels on one scale, dimensioned."""
    p = part(radius_mm=radius_mm, frames=200, columns=200)
    shown = panels(p, drawn, p.inspection)
    assert len({(axes.get_xlim(), axes.get_ylim()) for axes in shown}) == 1
    for axes, section in zip(shown, p.inspection.sections, strict=True):
        assert axes.equal
        texts = [text.text for text in axes.texts]
        if section.values["root_mm"] is None:
            assert "the edge is hidden here" in texts
            continue
        assert f"{section.values['root_mm']:.4f} ± 0.0062 mm" in texts
        assert f"({section.values['bevel_deg']:.3f} ± 0.042)°" in texts
        root, bevel = (line.xy for line in axes.lines[:2])
        beta = np.radians(section.values["bevel_deg"])
        off = np.cos(beta) * bevel[:, 0] + np.sin(beta) * (bevel[:, 1] - section.values["root_mm"])
        for distance in (root[:, 0], off):
            assert len(distance) > 20
            assert np.sqrt(np.mean(distance**2)) < 0.02
            assert abs(np.mean(distance)) < 0.005


def test_a_section_is_drawn_in_its_own_axes(part, drawn, quick):
    p = part(frames=100, columns=100)
    turn, section = 0.1, p.inspection.sections[1]
    turned = dataclasses.replace(
        section,
        normal=np.cos(turn) * section.normal + np.sin(turn) * section.across,
        across=np.cos(turn) * section.across - np.sin(turn) * section.normal,
        origin_mm=section.origin_mm + 0.3 * section.normal,
    )
    found = []
    for one in (section, turned):
        drawn.clear()
        axes = panels(p, drawn, dataclasses.replace(p.inspection, sections=(one,)))[0]
        found.append(np.vstack([line.xy for line in axes.lines[:3]]))
    rotation = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    np.testing.assert_allclose(found[1], (found[0] - [0.3, 0.0]) @ rotation, atol=1e-3)


def test_points_are_laid_out_at_their_foot_wherever_the_search_for_it_starts(part, drawn, quick):
    """An oblique laser plane crosses the lower edge elsewhere than its points lie: those set aside, in the plan."""
    p = part(radius_mm=300.0, frames=100, columns=100)
    for off_mm in (0.0, 2.7):
        edge = dataclasses.replace(p.edge, frame_arc_length_mm=p.edge.frame_arc_length_mm + off_mm)
        inspection(p.cloud, edge, p.inspection)
    seen = [axes for figure in drawn for axes in figure.axes if axes.labels["y"] == "v across the edge, mm"]
    one, other = (axes.lines[0].xy for axes in seen)
    np.testing.assert_allclose(one, other, atol=2e-3)


def test_what_was_set_aside_is_counted(part, drawn, quick):
    p = small(part, frames=50, columns=50)
    text = text_of(chapter_of(p))
    for told in ("34.0 mm 89.0 to 123.0 mm", "3 stations 31 to 32 mm, 170 mm", "mixed pixel 3 points"):
        assert told in text
    marked = [line.xy for figure in drawn for axes in figure.axes for line in axes.lines if line.marker == "^"]
    np.testing.assert_array_equal(marked[0][:, 0], [31, 32, 170])
    assert "21.0 mm 0.0 to 21.0 mm" in text_of(chapter_of(small(part, clamp=(-5.0, 20.0))))


@pytest.mark.parametrize(("guard_factor", "risk"), [(1.645, "5 %"), (2.0, "2.3 %"), (0.0, "50 %")])
def test_the_decision_rule_states_its_risk(part, drawn, quick, guard_factor, risk):
    assert f" {risk}" in text_of(chapter_of(small(part), guard_factor=guard_factor))


# Plans.


def planned_sizes(chapter):
    """Lowest and highest of root face and bevel angle, and their U, as the table has them."""
    text, value = text_of(chapter), r"([\d.]+)"
    (root,) = re.findall(rf"Root face {value} mm {value} mm {value} mm ± {value} mm", text)
    (bevel,) = re.findall(rf"Bevel angle {value}° {value}° {value}° ± {value}°", text)
    return np.array([root[1:], bevel[1:]], float)


@pytest.mark.parametrize("radius_mm", [None, 300.0])
def test_the_planned_bevel_is_what_the_path_makes_of_the_edge(planned, by_formula, quick, drawn, radius_mm):
    """0.1 mm outward (n is -y here) and 0.2 mm up: the plane meets the end face 0.2 + 0.1 / tan(40 deg) higher."""
    p = planned(radius_mm=radius_mm)
    assert planned_sizes(plan(p.cloud, p.edge, p.toolpath))[:, :2] == pytest.approx(
        np.array([[1.5, 1.5], [40.0, 40.0]]), abs=0.02
    )
    steeper = planned_sizes(plan(p.cloud, p.edge, by_formula(radius_mm=radius_mm, bevel_deg=41.0)))
    assert steeper[1, :2] == pytest.approx([41.0, 41.0], abs=0.02)
    if radius_mm is None:
        final = p.toolpath.layers[-1]
        moved = dataclasses.replace(final, position_mm=final.position_mm + np.array([0.0, -0.1, 0.2]))
        found = planned_sizes(plan(p.cloud, p.edge, dataclasses.replace(p.toolpath, layers=(moved,), travels=())))
        assert found[0, :2] == pytest.approx(1.7 + 0.1 / np.tan(BETA), abs=1e-3)


def test_u_of_edge_and_chain_moves_the_planned_bevel(planned, quick, drawn):
    """Across: 0.004 mm; along n: 0.006 mm; the edge's direction: 0.0005 rad; the chain: the place, and a turn."""
    p, slope = planned(), 1.0 / np.tan(BETA)
    for place, turn in ((0.0, 0.0), (0.1, 0.001)):
        chain = ChainU(place, turn, ("tool",)) if place else None
        root, bevel = planned_sizes(plan(p.cloud, p.edge, dataclasses.replace(p.toolpath, chain=chain)))[:, 2]
        assert root == pytest.approx(2 * np.hypot(np.hypot(0.004, 0.006 * slope), place * np.hypot(1, slope)), rel=0.05)
        assert bevel == pytest.approx(2 * np.degrees(np.hypot(0.0005, turn)), rel=0.05)


def test_the_work_objects_frame_does_not_matter(planned, quick, drawn):
    p = planned(radius_mm=300.0, clamp=(-2.0, -1.0))
    pose = np.eye(4)
    pose[:3, :3] = Rotation.from_rotvec([0.3, -0.8, 1.9]).as_matrix()
    pose[:3, 3] = [700.0, -80.0, 20.0]
    here, there = (plan(p.cloud, p.edge, path) for path in (p.toolpath, in_work_object(p.toolpath, pose)))
    assert text_of(here) == text_of(there)
    for one, other in zip(here.scene.strokes, there.scene.strokes, strict=True):
        np.testing.assert_allclose(np.vstack(one.lines_mm), np.vstack(other.lines_mm), atol=1e-9)


def test_the_end_faces_own_turn_is_told_beside_an_even_twist(planned, quick, drawn):
    """Directions that differ by 0.05 deg from place to place, on a face that turns by 20 deg along the edge."""
    p, rng = planned(), np.random.default_rng(3)
    count = len(p.edge.arc_length_mm)
    places = np.radians(0.05) * rng.normal(size=count) + np.radians(20.0) * np.linspace(0.0, 1.0, count)
    normal = np.cos(places)[:, None] * p.edge.normal + np.sin(places)[:, None] * p.edge.across
    edge = dataclasses.replace(p.edge, normal=normal, across=np.cross(normal, p.edge.tangent))
    (told,) = re.findall(r"itself varies by ([\d.]+)°", text_of(plan(p.cloud, edge, p.toolpath)))
    assert float(told) == pytest.approx(0.05, rel=0.3)
    assert "itself varies by 0°" in text_of(plan(p.cloud, p.edge, p.toolpath))


@pytest.mark.parametrize("radius_mm", [None, 300.0])
def test_layers_run_from_the_upper_surface_to_the_end_face(planned, quick, drawn, radius_mm):
    p = planned(radius_mm=radius_mm, clamp=(-2.0, -1.0))
    chapter = plan(p.cloud, p.edge, p.toolpath)
    assert "Section at 100.0 mm" in text_of(chapter)
    axes = with_text(drawn, "depth of cut 1 mm", "thickness\n10.00 mm", *"123456").axes[0]
    ends = [line.xy[[0, -1]] for line in axes.lines]
    for height in (5, 4, 3, 2, 1, 0):
        low = 1.5 + height / np.sin(BETA)
        cut = np.array([[0.0, low], [-(10.0 - low) * np.tan(BETA), 10.0]])
        assert any(np.allclose(end, cut, atol=2e-3) or np.allclose(end[::-1], cut, atol=2e-3) for end in ends), height


def test_it_is_dimensioned_from_the_path(planned, by_formula, quick, drawn):
    p = planned(clamp=(-2.0, -1.0))
    plan(p.cloud, p.edge, by_formula(clamp=(-2.0, -1.0), bevel_deg=41.0))
    assert with_text(drawn, "root face 1.500 ± 0.016 mm", "(41.000 ± 0.057)°", "depth of cut 1 mm", *"123456")


def test_no_text_lies_on_another_or_outside(planned, quick, drawn):
    p = planned(clamp=(-2.0, -1.0))
    thick = dataclasses.replace(p.toolpath, depth_of_cut_mm=3.0)
    layers = (
        LayerEngagement(x.index, x.arc_length_mm, 1.0 * x.cutting, x.width_mm, x.width_mm * x.cutting)
        for x in p.toolpath.layers
    )
    plan(p.cloud, p.edge, thick, None, None, Engagement(tuple(layers)))
    plan(p.cloud, p.edge, dataclasses.replace(p.toolpath, layers=p.toolpath.layers[-1:], travels=()))
    stepped = [figure for figure in drawn if any("depth of cut" in text.text for text in figure.axes[0].texts)]
    engaged = [figure for figure in drawn if any("chip area" in (axes.labels["y"] or "") for axes in figure.axes)]
    assert (len(stepped), len(engaged)) == (2, 1)
    for figure in (*stepped, *engaged):
        boxes = [text.place() for text in figure.axes[0].texts]
        for k, (left, top, right, bottom) in enumerate(boxes):
            assert 0.0 <= left < right <= figure.width
            assert 0.0 <= top < bottom <= figure.height
            for x0, y0, x1, y1 in boxes[k + 1 :]:
                assert x1 <= left or right <= x0 or y1 <= top or bottom <= y0


def test_feed_and_layers_have_their_keys(planned, quick, drawn):
    p = planned()
    text = text_of(plan(p.cloud, p.edge, p.toolpath))
    assert " ".join(f"{k + 1} ({5 - k} mm)" for k in range(6)) in text
    assert "The darker the slower: 1 mm/s 5.75 mm/s 10.5 mm/s 15.2 mm/s 20 mm/s" in text
    axes, final = with_text(drawn, "cutting feed 1 mm/s").axes[0], p.toolpath.layers[-1]
    np.testing.assert_array_equal(axes.lines[0].xy, np.c_[final.arc_length_mm, final.feed_mm_s])
    assert axes.bars == [(0.0, 89.0), (123.0, 200.0)]
    assert axes.get_ylim()[1] > 10.0


@pytest.mark.parametrize("radius_mm", [None, 300.0])
def test_edges_in_the_plane_show_how_far_the_end_face_is_from_flat(planned, quick, drawn, radius_mm):
    p = planned(radius_mm=radius_mm, clamp=(-2.0, -1.0))
    plan(p.cloud, p.edge, p.toolpath)
    in_plane, off = with_text(drawn, "lower edge", "upper edge").axes
    lower, upper = (line.xy[:, 1] for line in in_plane.lines[1::2])  # after each edge's vertices
    np.testing.assert_allclose(np.asarray(upper) - np.asarray(lower), 10.0, atol=1e-6)
    sagitta = 0.0 if radius_mm is None else radius_mm * (1 - np.cos(50.0 / radius_mm))
    for line in off.lines:
        assert np.ptp(line.xy[:, 1]) == pytest.approx(sagitta, abs=1e-6)
    assert np.ptp(off.get_ylim()) >= 0.1


def test_views_hold_the_whole_path_and_the_frames_of_its_key_points(planned, quick, drawn):
    """Here t = x, n = -y, m = z: x into the material, y along the feed, z down the bevel and outward."""
    p = planned(clamp=(-2.0, -1.0), frames=400)
    assert "The edge from 50 to 150 mm of arc length" in text_of(plan(p.cloud, p.edge, p.toolpath))
    named = [(view, {strokes.name: strokes.lines_mm for strokes in view.scene.strokes}) for view in quick]
    whole = next(lines["path"] for _, lines in named if "path" in lines)
    expected = [one.position_mm for pair in zip(p.toolpath.travels, p.toolpath.layers, strict=False) for one in pair]
    assert len(whole) == len(expected)  # the last travel is a single point
    for line, position in zip(whole, expected, strict=True):
        np.testing.assert_allclose(line, position, atol=1e-9)
    tools = "tool axes x, y, z of the final layer"
    ((view, lines),) = [(view, lines) for view, lines in named if tools in lines]
    keys = np.vstack(lines["dots"]) - view.origin_mm
    np.testing.assert_allclose(keys[:, 2], (1.5 + 10.0) / 2.0, atol=1e-6)
    np.testing.assert_allclose(np.diff(keys[:, 0]), 1.0, atol=1e-9)
    assert np.abs(keys[:, 0]).max() <= 50.0  # of 200 mm of edge those about its middle
    axes = np.array([line[1] - line[0] for line in lines[tools]]) / 4.0
    expected = [[0, np.cos(BETA), -np.sin(BETA)], [1, 0, 0], [0, -np.sin(BETA), -np.cos(BETA)]]
    np.testing.assert_allclose(axes, np.tile(expected, (len(axes) // 3, 1)), atol=1e-9)
    assert len(axes) == 3 * 12
