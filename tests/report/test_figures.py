"""Charts and drawings show what was measured, where it was measured."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from workbench.report import along
from workbench.report.section_drawing import deviations, laid_out, section_drawings
from workbench.report.tables import decision_rule, set_aside


def lines(figure):
    return [line.xy for axes in figure.axes for line in axes.lines]


def texts(figure):
    return [text.text for axes in figure.axes for text in axes.texts]


def chart(edge, inspection, which):
    profile, what = inspection.profile, inspection.characteristics[which]
    return along.size_chart(profile.arc_length_mm, profile.sizes[what.name], edge.seen, inspection, what)


def test_the_root_chart_draws_the_profile_and_its_band(part, drawn):
    p = part(frames=30, columns=30)
    chart(p.edge, p.inspection, 0)
    profile = p.inspection.profile
    measured = np.column_stack([profile.arc_length_mm, profile.root_mm])
    assert any(np.array_equal(xy, measured, equal_nan=True) for xy in lines(drawn[0]))
    guard = np.column_stack([profile.arc_length_mm, 2.0 - 1.645 * profile.root_u_mm])
    assert any(xy.shape == guard.shape and np.allclose(xy, guard, equal_nan=True) for xy in lines(drawn[0]))
    expected = {"upper limit 2.0 mm", "nominal 1.5 mm", "lower limit 1.0 mm", "hidden", *"123456789"}
    assert expected <= set(texts(drawn[0]))


def test_the_angle_chart_has_its_own_limits(part, drawn):
    p = part(frames=30, columns=30)
    chart(p.edge, p.inspection, 1)
    assert {"upper limit 41°", "lower limit 39°"} <= set(texts(drawn[0]))
    low, high = drawn[0].axes[0].get_ylim()
    assert low < 39 < 41 < high


def test_a_value_beyond_its_limits_is_in_the_picture(part, drawn):
    p = part(frames=30, columns=30)
    profile = dataclasses.replace(p.inspection.profile, root_mm=p.inspection.profile.root_mm + 2.0)
    made = dataclasses.replace(p.inspection, profile=profile)
    chart(p.edge, made, 0)
    assert drawn[0].axes[0].get_ylim()[1] > np.nanmax(profile.root_mm)


@pytest.mark.parametrize(
    ("seen", "expected"),
    [
        ([1, 1, 1, 1], []),
        ([1, 0, 0, 1], [(0.0, 3.0)]),
        ([0, 1, 1, 0], [(0.0, 1.0), (2.0, 3.0)]),
        ([0, 0, 0, 0], [(0.0, 3.0)]),
    ],
)
def test_hidden_stretches_reach_to_what_was_seen(part, seen, expected):
    edge = part(frames=10, columns=10).edge
    edge = dataclasses.replace(edge, arc_length_mm=np.arange(4.0), seen=np.array(seen, bool))
    assert along.hidden_stretches(edge) == expected


@pytest.mark.parametrize("radius_mm", [None, 300.0])
def test_points_lie_on_the_lines_of_the_true_values(part, radius_mm):
    p = part(radius_mm=radius_mm)
    for section in p.inspection.sections:
        found = deviations(laid_out(p.cloud, p.edge, section, 10_000))
        if section.root_mm is None:
            assert found is None
            continue
        along_mm, off_mm, _ = found
        assert len(off_mm) > 500
        assert np.sqrt(np.mean(off_mm**2)) < 0.02  # range noise is 0.012 mm; root and angle drift by 0.01 mm here
        assert abs(np.mean(off_mm)) < 0.005
        assert along_mm.min() > -0.2


def test_a_wrong_angle_shows_against_the_points(part):
    p = part()
    section = p.inspection.sections[1]
    wrong = dataclasses.replace(section, bevel_deg=section.bevel_deg + 1.0)
    _, off_mm, _ = deviations(laid_out(p.cloud, p.edge, wrong, 10_000))
    assert np.abs(off_mm).max() > 0.1


def test_sections_are_dimensioned_to_one_scale(part, drawn):
    p = part(frames=200, columns=200)
    section_drawings(p.cloud, p.edge, p.inspection)
    panels = drawn[0].axes
    assert len(panels) == 9
    assert len({(axes.get_xlim(), axes.get_ylim()) for axes in panels}) == 1
    assert all(axes.equal for axes in panels)
    first = p.inspection.sections[0]
    shown = [text.text for text in panels[0].texts]
    assert f"{first.root_mm:.4f} ± 0.0062 mm" in shown
    assert f"({first.bevel_deg:.3f} ± 0.042)°" in shown
    assert "the edge is hidden here" in [text.text for text in panels[4].texts]
    section_drawings(p.cloud, p.edge, dataclasses.replace(p.inspection, sections=p.inspection.sections[:4]))
    for figure in drawn:
        assert {"out of the root face, mm", "up, mm"} <= {
            name for axes in figure.axes if axes.visible for name in axes.labels.values()
        }


def test_the_plan_counts_what_it_does_not_show(part, drawn):
    p = part(frames=100, columns=100)
    made = along.plan_view(p.cloud, p.edge, p.inspection)
    shown = lines(drawn[0])[-2]  # before the burrs
    assert made.every_frame == 1
    assert len(shown) + made.outside == sum(p.cloud.rejected.values())
    np.testing.assert_array_equal(lines(drawn[0])[-1][:, 0], [31, 32, 170])


def test_what_was_set_aside_is_counted(part):
    p = part(frames=50, columns=50)
    rows = {what: (much, where) for what, much, where in set_aside(p.cloud, p.edge)}
    assert rows["Hidden stretches"] == ("34.0 mm", "89.0 to 123.0 mm")
    assert rows["Burrs"] == ("3 stations", "31 to 32 mm, 170 mm")
    assert rows["Rejected: mixed pixel"][0] == "3 points"


def test_the_decision_rule_states_its_risk():
    assert "5 %" in decision_rule(1.645)
    assert "2.3 %" in decision_rule(2.0)
    assert "50 %" in decision_rule(0.0)
