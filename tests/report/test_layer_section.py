"""The section drawing of the plan shows the path's own layers on the stock, at their places."""

from __future__ import annotations

import dataclasses
import importlib

import numpy as np
import pytest

from workbench.report.plan import stepped_section, stepping_drawing
from workbench.report.plot import Figure

MODULE = importlib.import_module("workbench.report.plan")  # its own name is the stage's
BETA = np.radians(40.0)


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


def test_it_is_dimensioned_from_the_path(planned, by_formula, monkeypatch):
    p, figures = planned(clamp=(-2.0, -1.0)), []
    monkeypatch.setattr(MODULE, "svg", lambda figure: figures.append(figure) or b"")
    path = by_formula(clamp=(-2.0, -1.0), bevel_deg=41.0)
    stepping_drawing(p.cloud, p.edge, path, stepped_section(p.edge, path))
    figure: Figure = figures[0]
    texts = {text.text for text in figure.axes[0].texts}
    assert {"root face 1.500 ± 0.016 mm", "(41.000 ± 0.057)°", "thickness\n10.00 mm", "depth of cut 1 mm"} <= texts
    assert {"1", "2", "3", "4", "5", "6"} <= texts


def test_no_text_lies_on_another_or_outside(planned, monkeypatch):
    p, figures = planned(clamp=(-2.0, -1.0)), []
    monkeypatch.setattr(MODULE, "svg", lambda figure: figures.append(figure) or b"")
    for layers in (p.toolpath.layers, p.toolpath.layers[-1:]):
        path = dataclasses.replace(p.toolpath, layers=layers)
        stepping_drawing(p.cloud, p.edge, path, stepped_section(p.edge, path))
        figure = figures.pop()
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
