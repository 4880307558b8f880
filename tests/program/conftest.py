"""Paths as programs."""

from dataclasses import replace

import pytest

from workbench.artefacts import Moves, Part, PathGate, Toolpath
from workbench.robot import Cell

from .paths import Shape
from .postured import cell_of, postured


def passed(path: Toolpath, *, reached: bool = True) -> PathGate:
    """As `path.check` decides on a sound path, and `stiffness.posture` where it finds postures."""
    return PathGate(True, "ok", toolpath=path, tolerance_mm=0.05, reached=reached)


def rejected(path: Toolpath) -> PathGate:
    """As it decides on another."""
    return PathGate(False, "layer 1 cuts below the finished bevel", toolpath=path, tolerance_mm=0.05)


@pytest.fixture(scope="session")
def irb6700(tmp_path_factory: pytest.TempPathFactory) -> Cell:
    """The shipped robot with a spindle at its side."""
    return cell_of("irb6700", tmp_path_factory.mktemp("cell"), dialect="abb")


@pytest.fixture(scope="session")
def moves(irb6700: Cell) -> Moves:
    """An arc with a lifted stretch, in two layers, where the robot stands: straight and circular moves."""
    made = postured(irb6700, "irb6700", Shape(bend=1 / 300, length_mm=300, lifted_mm=(120, 160)))
    assert made.postures is not None
    path = replace(made.toolpath, part=Part(part_id="plate 7"))
    return replace(made, toolpath=path, postures=replace(made.postures, toolpath=path))
