"""Labels of a picture of the cell: none cut off at the edge of its view."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from workbench.robot.draw import CAPTION_PX, FONT_PX, HEIGHT_PX, LETTER_PX, WIDTH_PX, Notes

HALF_MM = 1000.0  # of the view's height
TEXT = "1187.5 mm"


class Plotter:
    """Keeps the places of texts."""

    def __init__(self) -> None:
        self.camera = SimpleNamespace(parallel_scale=HALF_MM, focal_point=(300.0, -200.0, 500.0))
        self.places: list[np.ndarray] = []

    def add_point_labels(self, points: np.ndarray, texts: list[str], **_: Any) -> None:
        self.places.append(points[0])

    def add_mesh(self, *_: Any, **__: Any) -> None:
        """A line."""


@pytest.mark.parametrize("side", [(1, 0), (-1, 0), (0, 1), (0, -1), (1, 1), (0.2, 0.1)])
def test_a_label_stays_in_its_view(side: tuple[float, float]) -> None:
    """In pixels of a view, a quarter of the picture, seen from the side: x to the right, z up."""
    screen, plotter = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]]), Plotter()
    notes = Notes(plotter, screen)
    wide = HALF_MM * WIDTH_PX / HEIGHT_PX
    at = np.array([300.0 + side[0] * (wide - 5), 0.0, 500.0 + side[1] * (HALF_MM - 5)])
    notes.beside(at, np.array([50.0, 40.0]), TEXT, "#000000")
    notes.on(at, TEXT, "#000000")
    view = np.array([WIDTH_PX, HEIGHT_PX]) / 2
    px = HALF_MM / (view[1] / 2)
    far = at + np.array([3 * wide, 0, 0])
    assert not notes.shows(np.array([far, far]))  # a gap out of view gets no label at its edge
    assert notes.shows(np.array([far, [300.0, 0, 500]]))
    for place in plotter.places:
        left, low = ((place - plotter.camera.focal_point) @ screen[:2].T) / px + view / 2
        assert 0 <= left <= view[0] - LETTER_PX * len(TEXT) + 1e-6
        assert 0 <= low <= view[1] - CAPTION_PX - FONT_PX + 1e-6
