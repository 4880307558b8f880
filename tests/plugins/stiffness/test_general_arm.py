"""The optimiser for any arm: the kernels' own numbers where those hold, and an UR that mills."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from workbench.artefacts import Toolpath
from workbench.errors import InputError
from workbench.geometry.poses import inverse, quaternion_from_rotation, rotation_from_quaternion
from workbench.path import read
from workbench.plugins.stiffness import force, posture
from workbench.plugins.stiffness.arm import (
    MOST_POSES,
    Arm,
    GeneralArm,
    LoadedPath,
    arm_of,
    displacements,
    fast_arm,
    joint_angles,
    traverse,
)
from workbench.plugins.stiffness.traversal import BRANCHES
from workbench.plugins.stiffness.values import JointStiffness
from workbench.robot import Cell, forward_kinematics, read_cell

from .conftest import ROOT, K
from .test_posture import PATH, thinned


def test_the_numbers_are_the_kernels(cell: Cell) -> None:
    """Displacement, verdict and joint angles of the shipped robot, branch by branch."""
    arm, general = fast_arm(cell.chain), GeneralArm(cell.chain)
    assert isinstance(arm_of(cell.chain), Arm)
    rng = np.random.default_rng(3)
    q = rng.uniform(np.maximum(cell.chain.limits[:, 0], -np.pi), np.minimum(cell.chain.limits[:, 1], np.pi), (300, 6))
    flange = forward_kinematics(cell.chain, q)
    tip, acts = flange[:, :3, 3] + rng.normal(0, 100, (300, 3)), rng.normal(0, 100, (300, 3))
    solved = 0
    for shoulder, elbow in BRANCHES:
        branch: dict[str, Any] = {"shoulder": shoulder, "elbow": elbow}
        fast, said = displacements(arm, K, flange, tip, acts, **branch)
        slow, told = displacements(general, K, flange, tip, acts, **branch)
        assert (said == told).all()
        there = said < 3
        assert np.allclose(fast[there], slow[there], rtol=1e-8)
        for flip in (0, 1):
            ours, theirs = (joint_angles(one, flange[there], flip=flip, **branch) for one in (general, arm))
            assert np.abs((ours - theirs + np.pi) % (2 * np.pi) - np.pi).max() < 1e-7
        solved += int(there.sum())
    assert solved > 600


def test_the_traversal_is_the_kernels(cell: Cell) -> None:
    arm, general = fast_arm(cell.chain), GeneralArm(cell.chain)
    q = np.radians([20, 30, 10, 40, 50, -30]) + np.random.default_rng(4).normal(0, 0.05, (2, 3, 6))
    cutter = forward_kinematics(cell.chain, q) @ cell.flange_from_cutter
    load, acts = cutter[..., :3, 3], np.random.default_rng(5).normal(0, 50, (2, 3, 3))
    angles = np.radians([0, 60, -90])
    for shoulder, elbow in BRANCHES:
        given = (K, LoadedPath(cell.flange_from_cutter, cutter, load, acts), angles)
        fast, said = traverse(arm, *given, shoulder=shoulder, elbow=elbow)
        slow, told = traverse(general, *given, shoulder=shoulder, elbow=elbow)
        assert (said == told).all()
        assert np.allclose(fast[said == 0], slow[said == 0], rtol=1e-8)


@pytest.fixture
def ur(tmp_path: Path) -> Cell:
    tree = {
        "format": "robot-cell",
        "version": 1,
        "controller": {"dialect": "ur"},
        "robot": {
            "urdf": str(ROOT / "tests/robot/urdf/ur10e.urdf"),
            "base_frame": "base",
            "joint_stiffness_nm_per_rad": [2e4, 2e4, 2e4, 1e4, 1e4, 1e4],
        },
        "tool": {"flange_from_cutter": [[0, 0, 1, 120], [0, -1, 0, 0], [1, 0, 0, 80], [0, 0, 0, 1]]},
    }
    (tmp_path / "ur.json").write_text(json.dumps(tree))
    return read_cell(tmp_path / "ur.json")


def placed(path: Toolpath, cell: Cell, joints_deg: tuple[float, ...]) -> Toolpath:
    """The path with its middle point's frame where a posture has the cutter."""
    layer = path.layers[0]
    i = len(layer.position_mm) // 2
    frame = np.eye(4)
    frame[:3, :3], frame[:3, 3] = rotation_from_quaternion(layer.quaternion_wxyz[i]), layer.position_mm[i]
    move = forward_kinematics(cell.chain, np.radians(joints_deg)) @ cell.flange_from_cutter @ inverse(frame)
    turn = move[:3, :3] @ rotation_from_quaternion(layer.quaternion_wxyz)
    at = layer.position_mm @ move[:3, :3].T + move[:3, 3]
    return replace(path, layers=(replace(layer, position_mm=at, quaternion_wxyz=quaternion_from_rotation(turn)),))


def test_an_ur_has_postures(ur: Cell) -> None:
    """Its tool stands at every point, within limits and without a jump; the choice is the best of the grid's."""
    assert not ur.warnings
    path = placed(thinned(read(toolpath=PATH), 40), ur, (10, -70, 100, -60, -80, 30))
    stiffness = JointStiffness(np.array([2e4, 2e4, 2e4, 1e4, 1e4, 1e4]), np.zeros((6, 6)), 0.0, 0, 0, "stated")
    made, _, document, _ = posture(ur, stiffness, path, force(path)[0], step_deg=30.0, sampled_points=8)
    flange = forward_kinematics(ur.chain, made.joints)
    assert np.abs((flange @ made.flange_from_point)[:, :3, 3] - made.position_mm).max() < 1e-6
    layer = path.layers[0]
    axes = [
        p - 5 * rotation_from_quaternion(q)[:, :, 0]
        for p, q in ((made.position_mm, made.quaternion_wxyz), (layer.position_mm, layer.quaternion_wxyz))
    ]
    assert np.abs(axes[0] - axes[1]).max() < 1e-6  # the cutter's axis; about it the flange may turn
    assert np.abs(np.diff(made.joints, axis=0)).max() < np.radians(15)
    assert (np.abs(made.joints) <= ur.chain.limits[:, 1]).all()
    over = json.loads(document.content)["map"]["mean_displacement_mm"]
    values = [x for row in over for x in row if x is not None]
    assert len(values) > 1
    assert np.linalg.norm(made.displacement_mm, axis=1)[made.cutting].mean() < 1.2 * min(values)


def test_a_grid_that_would_take_hours_is_refused(ur: Cell) -> None:
    general = arm_of(ur.chain)
    assert isinstance(general, GeneralArm)
    with pytest.raises(InputError, match=f"expected at most {MOST_POSES}"):
        general.solutions(np.zeros((MOST_POSES + 1, 4, 4)))
