"""What a pixel sees of an end of a face."""

from __future__ import annotations

import numpy as np
import pytest

from workbench.edge.end_templates import FOOTPRINTS, Depths, EndView, end_phases, rendered_end
from workbench.units import DEG

COLUMN_MM, FILL, LEAN, TURN = 0.05, 0.2, 25.0 * DEG, 45.0 * DEG


@pytest.mark.parametrize("height_mm", [0.0, 0.01, 0.05, 0.2])
def test_the_last_pixel_of_a_chamfer_gets_as_much_light_as_it_needs(height_mm: float) -> None:
    """Summed over what it sees: the chamfer's share by Lambert's law, beyond it the face's."""
    known = Depths(np.zeros(5), np.eye(5), np.zeros((5, 5)))
    edges = COLUMN_MM * np.arange(6.0)
    view = EndView(known, edges, LEAN, COLUMN_MM, end_phases(True), 0.0, 0.0, fills=np.array([[FILL, 1.0]]))
    pixel = np.array([1 + np.flatnonzero(FOOTPRINTS[1:] == 1.0)[0]])  # a column wide
    one, first = np.ones(1), np.zeros(1, np.int64)
    _, _, past = rendered_end(view, height_mm * one, TURN * one, 85.0 * DEG * one, pixel, first, 0.0 * one)
    chamfer_mm = height_mm * (1.0 - np.tan(TURN) * np.tan(LEAN))
    within_mm = (np.arange(10_000) + 0.5) / 10_000 * COLUMN_MM - 0.5 * COLUMN_MM
    before_end = within_mm - past[0]
    light = np.where(before_end < chamfer_mm, np.cos(TURN + LEAN) / np.cos(LEAN), 1.0) * (before_end >= 0.0)
    assert light.mean() == pytest.approx(FILL, abs=2e-4)
