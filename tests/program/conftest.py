"""Paths as programs."""

import pytest

from workbench.artefacts import Gate, Moves
from workbench.path import simplify

from .paths import Shape, mill_path

PASSED, REJECTED = Gate(True, "ok"), Gate(False, "layer 1 cuts below the finished bevel")


@pytest.fixture(scope="session")
def moves() -> Moves:
    """An arc with a lifted stretch, in two layers: straight and circular moves."""
    return simplify(mill_path(Shape(bend=1 / 300, length_mm=300, lifted_mm=(120, 160)), part_id="plate 7"))
