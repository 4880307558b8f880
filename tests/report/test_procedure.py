"""The views of the paper's Fig. 8: vertices, edges and tool frames where truth has them."""

from __future__ import annotations

import numpy as np
import pytest

from workbench.report import path_charts
from workbench.report.marks import TOOL_AXES, rgb
from workbench.report.scene import everything_mm
from workbench.report.scenes import TOOL_AXIS_MM
from workbench.report.views import procedure_views, shown_stretch

BETA = np.radians(40.0)


@pytest.fixture(scope="module")
def views(planned):
    p = planned(clamp=(-2.0, -1.0), frames=400)
    return procedure_views(p.cloud, p.edge, p.toolpath, 50_000)


def test_a_long_edge_is_shown_in_part(planned, views):
    stretch = shown_stretch(planned(clamp=(-2.0, -1.0), frames=400).edge)
    assert (stretch.from_mm, stretch.to_mm) == (50.0, 150.0)
    assert len(stretch.frames) == 200
    for view in views.values():  # the origin lies at arc length 100 mm, x runs along the edge
        off = everything_mm(view.scene) - view.origin_mm
        assert np.abs(off[:, 0]).max() < 50.0 + TOOL_AXIS_MM


def test_key_points_carry_frames_along_the_feed_and_down_the_bevel(views):
    frames, dots = views["f"].scene.strokes
    keys = np.vstack(dots.lines_mm) - views["f"].origin_mm
    centre = (1.5 + 10.0) / 2.0
    np.testing.assert_allclose(keys[:, 2], centre, atol=1e-6)
    np.testing.assert_allclose(np.diff(keys[:, 0]), 1.0, atol=1e-9)
    # here t = x, n = -y, m = z: x into the material, y along the feed, z down the bevel and outward
    expected = {0: [0, np.cos(BETA), -np.sin(BETA)], 1: [1, 0, 0], 2: [0, -np.sin(BETA), -np.cos(BETA)]}
    seen = 0
    for line, colour in zip(frames.lines_mm, frames.colours, strict=True):
        axis = next(k for k, each in enumerate(TOOL_AXES) if rgb(each) == tuple(colour[0]))
        np.testing.assert_allclose((line[1] - line[0]) / TOOL_AXIS_MM, expected[axis], atol=1e-9)
        seen += 1
    assert seen == 3 * 12


@pytest.mark.parametrize("radius_mm", [None, 300.0])
def test_edges_in_the_plane_show_how_far_the_end_face_is_from_flat(planned, radius_mm, drawn):
    p = planned(radius_mm=radius_mm, clamp=(-2.0, -1.0))
    path_charts.edges_in_plane(p.cloud, p.edge)
    in_plane, off = drawn[0].axes
    lower, upper = (line.xy[:, 1] for line in in_plane.lines[1::2])  # after each edge's vertices
    np.testing.assert_allclose(np.asarray(upper) - np.asarray(lower), 10.0, atol=1e-6)
    sagitta = 0.0 if radius_mm is None else radius_mm * (1 - np.cos(50.0 / radius_mm))
    for line in off.lines:
        assert np.ptp(line.xy[:, 1]) == pytest.approx(sagitta, abs=1e-6)
    assert np.ptp(off.get_ylim()) >= 0.1
