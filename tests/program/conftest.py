"""Paths as programs."""

import pytest

from workbench.artefacts import Moves, Part, PathGate, Toolpath
from workbench.path import simplify

from .paths import Shape, mill_path


def passed(path: Toolpath) -> PathGate:
    """As `path.check` decides on a sound path."""
    return PathGate(True, "ok", toolpath=path, tolerance_mm=0.05)


def rejected(path: Toolpath) -> PathGate:
    """As it decides on another."""
    return PathGate(False, "layer 1 cuts below the finished bevel", toolpath=path, tolerance_mm=0.05)


@pytest.fixture(scope="session")
def moves() -> Moves:
    """An arc with a lifted stretch, in two layers: straight and circular moves."""
    return simplify(mill_path(Shape(bend=1 / 300, length_mm=300, lifted_mm=(120, 160)), part=Part(part_id="plate 7")))
