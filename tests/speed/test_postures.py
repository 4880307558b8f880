"""The loops over pinocchio, which the benchmark stands beside, give the displacements that the kernels give."""

import numpy as np
import pytest

from bench.peers.clik import OneByOne
from bench.speed.postures import CELL, K
from workbench.plugins.stiffness.arm import displacements, fast_arm
from workbench.robot import forward_kinematics, read_cell


def test_both_sides_give_the_same() -> None:
    cell = read_cell(CELL)
    peer, rng = OneByOne(CELL.parent / "irb6700_150_320.urdf", cell.chain, K), np.random.default_rng(0)
    q = np.radians([-20.0, 15.0, 20.0, 30.0, 50.0, -40.0]) + rng.normal(0, 0.1, (10, 6))
    poses, force = forward_kinematics(cell.chain, q), rng.normal(0, 100, (10, 3))
    point = cell.flange_from_cutter[:3, 3]
    tip = poses[:, :3, :3] @ point + poses[:, :3, 3]
    found, said = displacements(fast_arm(cell.chain), K, poses, tip, force)
    assert (said == 0).all()
    start = np.radians([0.0, 10.0, 10.0, 10.0, 60.0, 10.0])
    for i in range(10):
        closed = peer.closed_form(poses[i], 0)
        assert np.isclose(peer.displacement_mm(closed, point, force[i]), found[i], rtol=1e-9)
        solved = peer.clik(poses[i], start)
        assert solved is not None
        away = forward_kinematics(cell.chain, solved) - poses[i]  # CLIK may end in another branch
        assert np.abs(away[:3, 3]).max() < 0.2
        assert np.abs(away[:3, :3]).max() < 2e-4


def test_eaik_finds_the_branches_of_the_pose() -> None:
    cell = read_cell(CELL)
    peer = OneByOne(CELL.parent / "irb6700_150_320.urdf", cell.chain, K)
    if peer.eaik is None:
        pytest.skip("EAIK has no wheel for this Python")
    pose = forward_kinematics(cell.chain, np.radians([-20.0, 15.0, 20.0, 30.0, 50.0, -40.0]))
    branches = peer.all_branches(pose)
    assert len(branches) == 8
    assert np.allclose(forward_kinematics(cell.chain, np.array(branches)), pose, atol=1e-9)
