"""The loops over pinocchio, which the benchmark stands beside, give the displacements that the kernels give."""

import numpy as np
import pytest

from bench.peers.clik import OneByOne
from bench.speed.postures import CELL, K, cluttered
from bench.speed.postures_rows import traversed
from workbench.plugins.stiffness.arm import displacements, fast_arm
from workbench.robot import CollisionModel, forward_kinematics, read_cell


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


def test_clutter_is_clutter() -> None:
    cell = read_cell(CELL)
    assert len(CollisionModel(cluttered(cell)).pairs) > len(CollisionModel(cell).pairs) + 200


def test_rows_compare_with_their_goals() -> None:
    found = {
        "points": 60,
        "branches": 4,
        "traversal_s": 0.31104,
        "open_s": 0.3,
        "open_cells": 64,
        "cluttered_s": 11.0,
        "cluttered_cells": 960,
        "bound_s": 1e-6,
        "certified": 0.7,
        "screen_s": 1e-5,
        "colliding": 0.2,
        "clik_s": 1.6e-3,
        "closed_s": 1.5e-4,
        "eaik_s": 4e-5,
        "eaik_branches": 8.0,
        "converged": 1.0,
        "law_s": 6.0,
        "law_points": 1016,
        "law_gap": 0.0,
        "law_gain": 0.004,
    }
    rows = list(traversed(found))
    assert [row.met for row in rows] == [True, True, None, True, True, True, False, True, None, None]
    assert np.isclose(rows[1].factor, 100)
    assert np.isclose(rows[2].factor, 15_000)
    assert np.isclose(rows[3].factor, 500)
    without = {name: value for name, value in found.items() if not name.startswith("eaik")}
    assert len(list(traversed(without))) == len(rows) - 1


def test_eaik_finds_the_branches_of_the_pose() -> None:
    cell = read_cell(CELL)
    peer = OneByOne(CELL.parent / "irb6700_150_320.urdf", cell.chain, K)
    if peer.eaik is None:
        pytest.skip("EAIK has no wheel for this Python")
    pose = forward_kinematics(cell.chain, np.radians([-20.0, 15.0, 20.0, 30.0, 50.0, -40.0]))
    branches = peer.all_branches(pose)
    assert len(branches) == 8
    assert np.allclose(forward_kinematics(cell.chain, np.array(branches)), pose, atol=1e-9)
