"""Pictures of the cell: the plate that the path makes, and no paper around what is drawn."""

import io

import numpy as np
import pytest
from PIL import Image

from workbench.robot import Cell, cell_triangles, posture_picture

from .conftest import ROOT

PATH = ROOT / "data" / "synthetic" / "paths" / "raw_arc.json"


@pytest.fixture(scope="module", autouse=True)
def charts() -> None:
    """Here the picture itself is looked at."""


def test_a_picture_has_no_paper_around_it(cell: Cell) -> None:
    bodies = [(body, one) for body, one in cell_triangles(cell, np.zeros(6), 0.0) if body != "floor"]
    way = np.array([[1500.0, 0.0, 800.0], [1700.0, 0.0, 800.0]])
    for close_up in (None, 250.0):
        drawn = Image.open(io.BytesIO(posture_picture(cell, bodies, way, close_up)))
        inked = np.argwhere((np.asarray(drawn.convert("RGB")) < 245).any(axis=2))
        assert (inked.min(axis=0) <= 6).all()
        assert (inked.max(axis=0) >= np.array([drawn.height, drawn.width]) - 7).all()
