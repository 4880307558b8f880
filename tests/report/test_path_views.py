"""All layers on the part, and the feed on the path: every stretch in its place and in its colour."""

from __future__ import annotations

import io

import numpy as np
import pytest
from PIL import Image

from workbench.artefacts import Scene, Shading, Strokes
from workbench.report import path_charts
from workbench.report.planned import feed_scale, layer_scale, whole_run
from workbench.report.scene import View, picture
from workbench.report.views import path_views

RED = np.array([[255, 0, 0]])


@pytest.fixture(scope="module")
def run(planned):
    return whole_run(planned().toolpath)


@pytest.fixture(scope="module")
def views(planned, run):
    p = planned()
    return path_views(p.cloud, p.edge, p.toolpath, run, 20_000)


def test_the_whole_path_is_drawn_layer_by_layer(planned, run, views):
    p = planned()
    (drawn,) = views["layers"].scene.strokes
    lines = drawn.lines_mm
    expected = [part.position_mm for k in range(6) for part in (p.toolpath.travels[k], p.toolpath.layers[k])]
    assert len(lines) == len(expected)  # the last travel is a single point
    for line, position in zip(lines, expected, strict=True):
        np.testing.assert_allclose(line, position, atol=1e-9)


def test_the_scales_name_layers_and_feeds(planned, run, drawn):
    layer_scale(planned().toolpath)
    feed_scale(run)
    layers, feeds = (figure.axes[0] for figure in drawn)
    assert layers.ticks["x"][1] == [f"{k + 1} ({5 - k} mm)" for k in range(6)]
    assert (layers.labels["x"], feeds.labels["x"]) == ("layer (its height above the finished bevel)", "feed, mm/s")
    assert feeds.get_xlim() == (1.0, 20.0)


def test_the_feed_chart_shows_feed_and_where_it_cuts(planned, drawn):
    p = planned()
    path_charts.feed_chart(p.edge, p.toolpath)
    axes = drawn[0].axes[0]
    final = p.toolpath.layers[-1]
    np.testing.assert_array_equal(axes.lines[0].xy, np.c_[final.arc_length_mm, final.feed_mm_s])
    assert axes.bars == [(0.0, 89.0), (123.0, 200.0)]
    assert axes.get_ylim()[1] > 10.0


def inside(axes_length_mm=0.0):
    """A plate of grey points, and a red line 2 mm behind it, as seen by the viewer."""
    x, y = (each.ravel() for each in np.meshgrid(np.linspace(0, 40, 300), np.linspace(0, 16, 150)))
    points = np.column_stack([x, y, 0 * x])
    line = np.array([[2.0, 8.0, -2.0], [38.0, 8.0, -2.0]])
    grey = Shading("grey", np.zeros(len(points), np.uint8), np.full((1, 3), 200, np.uint8), ())
    lines = Strokes("line", (line,), (np.repeat(RED, 2, axis=0),))
    return View(Scene(points, (grey,), (lines,), (), np.eye(3)), (0.0, -0.3, 1.0))


def red(png):
    pixels = np.asarray(Image.open(io.BytesIO(png)).convert("RGB")).astype(int)
    return np.count_nonzero((pixels[..., 0] > 200) & (pixels[..., 1] < 60) & (pixels[..., 2] < 60)) / pixels.shape[1]


def test_a_line_inside_the_stock_is_seen():
    assert red(picture(inside())) > 1.5  # pixels a column of the picture: a line of 2 and more
