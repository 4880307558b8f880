"""Pictures of the cell: the plate that the path makes, and no paper around what is drawn."""

import io

import numpy as np
import pytest
from PIL import Image

from workbench.path import read
from workbench.plugins.stiffness.outcome import PLATE_MM, plate_triangles
from workbench.robot import Cell, cell_triangles, posture_picture
from workbench.units import DEG

from .conftest import ROOT

PATH = ROOT / "data" / "synthetic" / "paths" / "raw_arc.json"


@pytest.fixture(scope="module", autouse=True)
def charts() -> None:
    """Here the picture itself is looked at."""


def test_the_plate_is_a_closed_body_of_the_plate_s_volume() -> None:
    path = read(toolpath=PATH)
    triangles = plate_triangles(path)
    a, b, c = triangles.transpose(1, 0, 2) - triangles.mean(axis=(0, 1))
    volume = np.einsum("ni,ni->", a, np.cross(b, c)) / 6
    assert np.cross(b - a, c - a).sum(axis=0) == pytest.approx(0.0, abs=1e-6)  # closed: every area has its opposite
    final = path.layers[-1]
    width = float(np.mean(final.width_mm[final.cutting]))
    thick = path.root_mm + width * np.cos(path.bevel_deg * DEG)
    section = PLATE_MM * thick + width * np.sin(path.bevel_deg * DEG) * (path.root_mm + thick) / 2
    assert 0.85 < volume / (section * path.edge_length_mm) < 1.0  # from outside; the edge is the outside of a bend


def test_a_picture_has_no_paper_around_it(cell: Cell) -> None:
    bodies = [(body, one) for body, one in cell_triangles(cell, np.zeros(6), 0.0) if body != "floor"]
    way = np.array([[1500.0, 0.0, 800.0], [1700.0, 0.0, 800.0]])
    for close_up in (None, 250.0):
        drawn = Image.open(io.BytesIO(posture_picture(cell, bodies, way, close_up)))
        inked = np.argwhere((np.asarray(drawn.convert("RGB")) < 245).any(axis=2))
        assert (inked.min(axis=0) <= 6).all()
        assert (inked.max(axis=0) >= np.array([drawn.height, drawn.width]) - 7).all()
