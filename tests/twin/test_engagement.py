"""Engagement against the closed forms of a straight edge with a square end face."""

from __future__ import annotations

import numpy as np
import pytest

from tests.twin.conftest import perfect_path, raw_recipe
from workbench.synthetic import Workpiece
from workbench.twin import mill
from workbench.units import DEG

THICKNESS, ROOT, BEVEL = 8.0, 1.5, 40 * DEG


def stock_area(height):
    """Area of the stock's section above the plane at a height over the finished bevel: a right triangle."""
    leg = max(THICKNESS - ROOT - height / np.sin(BEVEL), 0.0)
    return leg * leg * np.tan(BEVEL) / 2


def face_width(height):
    return max(THICKNESS - ROOT - height / np.sin(BEVEL), 0.0) / np.cos(BEVEL)


def test_every_layer_of_a_straight_edge():
    recipe = raw_recipe()
    _, engagement = mill(Workpiece(recipe), perfect_path(recipe, depth_of_cut_mm=1.0))
    assert [layer.index for layer in engagement.layers] == [1, 2, 3, 4, 5]
    apex = (THICKNESS - ROOT) * np.sin(BEVEL)  # 4.178 mm
    above = np.inf
    for layer, height in zip(engagement.layers, (4.0, 3.0, 2.0, 1.0, 0.0), strict=True):
        inside = (layer.arc_length_mm > 6) & (layer.arc_length_mm < 34)
        assert layer.axial_depth_mm[inside] == pytest.approx(np.full(27, face_width(height)), abs=0.01)
        area = stock_area(height) - stock_area(above)
        assert layer.chip_area_mm2[inside] == pytest.approx(np.full(27, area), abs=0.01)
        depth = min(apex, above) - height
        assert layer.radial_depth_mm[inside] == pytest.approx(np.full(27, depth), abs=0.05)
        above = height
    assert engagement.layers[0].chip_area_mm2[0] == 0.0  # in the lead-in, before the part


def test_a_second_run_over_the_same_layer_meets_nothing():
    recipe = raw_recipe()
    _, engagement = mill(Workpiece(recipe), perfect_path(recipe, heights=(2.0, 2.0)), deflection_mm=(-0.01, 0, 0))
    assert engagement.layers[0].chip_area_mm2.max() > 3
    assert engagement.layers[1].chip_area_mm2.max() < 1e-3
