"""The program as it is played: bodies stand where the robot has them, and the words are the program's."""

import numpy as np
import pytest
from scipy.spatial import cKDTree

from workbench.artefacts import Moves
from workbench.program import write
from workbench.robot import Cell, cell_strokes

from .conftest import passed


@pytest.mark.parametrize("share", [0.0, 0.3, 1.0])
def test_bodies_stand_where_the_robot_has_them(moves: Moves, irb6700: Cell, share: float) -> None:
    """Ends of all edges are corners of the cell as it is drawn in that posture; the cutter's way ends at its tip."""
    *_, judgement, chapter = write(moves, passed(moves.toolpath), irb6700)
    scene, driven = chapter.scene, judgement.driven
    frame = int(share * (len(scene.frames) - 1))
    assert len(scene.frames) == len(driven["line"]) <= 600  # none is left out
    drawn = cell_strokes(irb6700, driven["joints"][frame], float(driven["turntable"][frame]))
    corners = cKDTree(np.concatenate([end for one in drawn for end in one.lines_mm]))
    bodies = [one for one in scene.strokes if one.name != "way of the tool"]
    assert {"robot"} <= {one.name for one in bodies}
    assert len({id(one.moved) for one in bodies if one.name == "robot"}) > 5  # the arm too, whose links are capsules
    for one in bodies:
        ends = np.concatenate(one.lines_mm)
        pose = np.eye(4) if one.moved is None else one.moved[frame]
        away, _ = corners.query(ends @ pose[:3, :3].T + pose[:3, 3])
        assert away.max() < 0.02
