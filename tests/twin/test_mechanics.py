"""Where the cutter really is: rigid errors, the robot's smooth error, straight moves."""

from __future__ import annotations

import numpy as np
import pytest

from workbench.api import pose_from, quaternion_from_rotation, rotation_from_vector
from workbench.twin.mill_stage import Mechanics, straight_moves
from workbench.units import DEG

ZERO = np.zeros(3)


def mechanics(**more):
    perfect = {
        "base_from_path": np.eye(4),
        "offset_mm": ZERO,
        "rotation": ZERO,
        "noise_mm": 0.0,
        "repeating_mm": 0.0,
        "noise_length_mm": 20.0,
        "deflection_mm": ZERO,
        "deflections_mm": {},
        "seed": (3,),
    }
    return Mechanics(**(perfect | more))


def line(*x):
    position = np.zeros((len(x), 3))
    position[:, 0] = x
    turn = rotation_from_vector(np.array([0.2, 0.5, -0.3]))
    return position, np.tile(quaternion_from_rotation(turn), (len(x), 1)), turn


def test_robot_error_is_a_gaussian_process_of_the_stated_covariance():
    """Over 600 draws, at 0, 5, 20 and 60 mm: sd^2 exp(-d^2 / (2 length^2)), axes independent."""
    position, quaternion, _ = line(0.0, 5.0, 20.0, 60.0)
    machine = mechanics(noise_mm=0.1)
    draws = np.array([machine.poses(position, quaternion, 1, draw)[:, :3, 3] - position for draw in range(600)])
    covariance = np.einsum("dik,djk->ij", draws, draws) / (3 * 600)
    apart = np.abs(position[:, None, 0] - position[None, :, 0])
    assert covariance == pytest.approx(0.01 * np.exp(-(apart**2) / (2 * 20**2)), abs=0.0012)
    assert np.abs(np.mean(draws[:, 0, 0] * draws[:, 0, 1])) < 0.0015
    kurtosis = np.mean(draws**4) / np.mean(draws**2) ** 2
    assert kurtosis == pytest.approx(3.0, abs=0.3)


def test_an_error_that_repeats_depends_on_the_place_alone():
    """The same in every run and every draw; over places far apart of the stated standard deviation and smooth."""
    position, quaternion, _ = line(*np.arange(0.0, 40000.0, 10.0))
    machine = mechanics(repeating_mm=0.1, seed=(3, 0))
    off = machine.poses(position, quaternion, 1, 1)[:, :3, 3] - position
    again = mechanics(repeating_mm=0.1, seed=(3, 7)).poses(position[::-1], quaternion, 2, 5)[::-1, :3, 3] - position
    assert np.array_equal(off, again)
    assert off.std() == pytest.approx(0.1, rel=0.1)
    assert np.mean(off[1:] * off[:-1]) / np.mean(off**2) == pytest.approx(np.exp(-(10**2) / (2 * 20**2)), abs=0.05)
    assert not np.allclose(off, mechanics(repeating_mm=0.1, seed=(4, 0)).poses(position, quaternion, 1, 1)[:, :3, 3])


def test_errors_compose():
    """Deflection acts in the turned tool's frame, offset and rotation in the base, all about the tool's origin."""
    position, quaternion, turn = line(0.0, 10.0)
    swing, bent = np.array([0.0, 0.0, 90 * DEG]), {2: np.array([[0.0, 0, 0], [0.1, 0.2, 0.3]])}
    machine = mechanics(offset_mm=np.array([1.0, 2, 3]), rotation=swing, deflections_mm=bent)
    poses, other = (machine.poses(position, quaternion, layer, 1) for layer in (2, 1))
    expected = rotation_from_vector(swing) @ turn
    assert np.abs(poses[:, :3, :3] - expected).max() < 1e-12
    assert poses[0, :3, 3] == pytest.approx([1, 2, 3])
    assert poses[1, :3, 3] == pytest.approx(np.array([11, 2, 3]) + expected @ [0.1, 0.2, 0.3])
    assert other[1, :3, 3] == pytest.approx([11, 2, 3])


def test_straight_moves_are_linear_and_fine():
    position, _, turn = line(0.0, 10.0, 10.5)
    rotation = np.stack([turn, turn @ rotation_from_vector(np.array([0, 0, 25 * DEG])), turn])
    poses, values = straight_moves(pose_from(rotation, position), np.array([5.0, 4.0, 4.5]))
    assert len(poses) == 1 + 25 + 25
    assert np.linalg.norm(np.diff(poses[:, :3, 3], axis=0), axis=1).max() < 1.0
    middle = 1 + 25 // 2
    share = middle / 25
    assert poses[middle, 0, 3] == pytest.approx(10 * share)
    assert poses[middle, :3, :3] == pytest.approx(turn @ rotation_from_vector(np.array([0, 0, 25 * share * DEG])))
    assert values[[0, middle, 25, -1]] == pytest.approx([5.0, 5.0 - share, 4.0, 4.5])
    assert poses[25] == pytest.approx(pose_from(rotation, position)[1])
