"""From a path in reach to a judged program on a robot whose wrist is no sphere: the optimiser's own postures."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from workbench.api import inverse, pose_from, rotation_from_quaternion
from workbench.artefacts import Judgement, PathGate, Toolpath
from workbench.path import simplify
from workbench.plugins.stiffness import force, posture, read
from workbench.program import write
from workbench.robot import Cell, forward_kinematics

from .paths import Shape, mill_path, moved
from .postured import ROBOTS, cell_of

ROBOT, OWN = "ur10e", "ur"
STIFFNESS_NM_PER_RAD = (2e4,) * 6  # of their size, not theirs
ACCELERATIONS = np.radians([300.0, 300, 300, 500, 500, 700])


def in_reach(path: Toolpath, cell: Cell) -> Toolpath:
    """The path with the middle of its first layer where a posture of the robot has the cutter's flank."""
    layer = path.layers[0]
    i = len(layer.feed_mm_s) // 2
    frame = pose_from(rotation_from_quaternion(layer.quaternion_wxyz[i]), layer.position_mm[i])
    there = forward_kinematics(cell.chain, np.radians(ROBOTS[ROBOT][1])) @ cell.flange_from_cutter
    return moved(path, there @ inverse(frame))


def test_a_path_becomes_a_judged_program(tmp_path: Path) -> None:
    """In the maker's own language and as a trajectory; each point of the path where the program's rows put the tool."""
    cell = replace(cell_of(ROBOT, tmp_path, dialect=OWN), accelerations=ACCELERATIONS)
    path = in_reach(mill_path(Shape(bend=1 / 300, length_mm=20)), cell)
    stiffness = read(joint_stiffness_nm_per_rad=STIFFNESS_NM_PER_RAD)
    grid = {"cutter_rotation_deg": (-30, 30), "turntable_deg": (0, 0), "step_deg": 15.0, "sampled_points": 6}
    gate = PathGate(True, "", toolpath=path, tolerance_mm=0.05)
    made, gate, *_ = posture(cell, stiffness, path, force(path)[0], gate, whole_map=False, **grid)
    assert gate.passed, gate.reason
    for controller in (OWN, "trajectory"):
        *_, after, judgement, _ = write(simplify(path, made), gate, cell, controller=controller, root_tolerance_mm=5)
        assert isinstance(judgement, Judgement), after
        assert judgement.passed
        assert judgement.deviation_mm < 0.05
        assert judgement.program.dialect == controller
    rows = np.array([move.joints for move in judgement.program.moves])
    stand = (forward_kinematics(cell.chain, rows) @ made.flange_from_point)[:, :3, 3]
    off = [np.linalg.norm(stand - point, axis=1).min() for point in made.position_mm]
    assert max(off) < 0.01
    assert judgement.time_s == pytest.approx(judgement.program.moves[-1].time_s)
