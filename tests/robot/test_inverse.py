"""The closed-form inverse: every branch reaches the pose, and no branch is missed."""

import dataclasses
from typing import Any

import numpy as np
import pytest

from workbench.errors import InputError
from workbench.geometry.poses import rotation_from_vector
from workbench.robot import Chain, forward_kinematics, inverse_kinematics, spherical_wrist, within_limits
from workbench.robot.kinematics import motions
from workbench.robot.wrist import general_position, parallel_position
from workbench.units import Float


def errors(chain: Chain, joints: Float, poses: Float) -> Float:
    """Largest entry of pose errors (..., 8), in m and 1; NaN where there is no branch."""
    difference = forward_kinematics(chain, np.nan_to_num(joints)) - poses[..., None, :, :]
    difference[..., :3, 3] /= 1e3
    return np.where(np.isnan(joints[..., 0]), np.nan, np.abs(difference).max(axis=(-1, -2)))


def apart(a: Float, b: Float) -> Float:
    """Largest difference of angles, a turn being nothing."""
    return np.abs((a - b + np.pi) % (2 * np.pi) - np.pi).max(axis=-1)


def test_every_branch_reaches_and_the_posture_is_among_them(chain: Chain, postures: Any) -> None:
    q = postures(2000, 11)
    poses = forward_kinematics(chain, q)
    found = inverse_kinematics(chain, poses)
    assert np.nanmax(errors(chain, found, poses)) < 1e-12
    assert np.nanmin(apart(found, q[:, None]), axis=1).max() < 1e-9
    count = np.isfinite(found[..., 0]).sum(axis=1)
    assert set(count) == {4, 8}
    assert (np.abs(found[np.isfinite(found)]) <= np.pi).all()


def test_branches_are_eight_different_postures(chain: Chain, postures: Any) -> None:
    found = inverse_kinematics(chain, forward_kinematics(chain, postures(200, 12)))
    for branches in found:
        there = branches[np.isfinite(branches[:, 0])]
        distances = apart(there[:, None], there[None]) + 10 * np.eye(len(there))
        assert distances.min() > 1e-6


@pytest.mark.parametrize("bend", [0.0, 1e-15, 1e-12, 1e-8, 1e-4])
def test_stretched_wrist_keeps_its_pose(chain: Chain, postures: Any, bend: float) -> None:
    q = postures(200, 14)
    q[:, 4] = bend
    poses = forward_kinematics(chain, q)
    found = inverse_kinematics(chain, poses)
    assert np.nanmax(errors(chain, found, poses)) < 1e-12
    assert np.isfinite(found[..., 0]).sum(axis=1).min() >= 4


def test_wrist_above_axis_1_keeps_its_pose(chain: Chain) -> None:
    """q2, q3 with the wrist's centre on axis 1: joint 1 is free, a pose is found all the same."""
    from scipy.optimize import brentq

    def off(q3: float) -> float:
        pose = forward_kinematics(chain, np.array([0.0, -0.5, q3, 0.0, 0.0, 0.0]))
        return float(pose[0, 3] - 200 * pose[0, 2])

    q3 = brentq(off, 0.5, 2.5, xtol=1e-15)
    poses = forward_kinematics(chain, np.array([[0.7, -0.5, q3, 0.3, 0.9, -0.2]]))
    found = inverse_kinematics(chain, poses)
    assert np.nanmin(errors(chain, found, poses)) < 1e-9


def test_out_of_reach_has_no_branch(chain: Chain) -> None:
    far = np.tile(np.eye(4), (3, 1, 1))
    far[:, :3, 3] = [[5000, 0, 1000], [0, 0, 6000], [0, 0, 980]]  # the last one inside the elbow's circle
    assert np.isnan(inverse_kinematics(chain, far)).all()


def test_limits_choose_the_turn(chain: Chain) -> None:
    q = np.radians([[170.5, 0, 0, 0, 0, 0], [0, 0, 0, -90, 0, -170]])
    placed = within_limits(chain, q)
    assert np.isnan(placed[0, 0])
    assert np.allclose(np.degrees(placed[1]), [0, 0, 0, -90, 0, -170])
    near = within_limits(chain, q[1], np.radians([0, 0, 0, 250, 0, 300]))
    assert np.allclose(np.degrees(near), [0, 0, 0, 270, 0, 190])
    low, high = chain.limits.T
    assert np.isfinite(within_limits(chain, np.array([low, high]))).all()


def unit(*vector: float) -> Float:
    return np.array(vector) / np.linalg.norm(vector)


def other(chain: Chain, axes: dict[int, Float], points_mm: dict[int, Any]) -> Chain:
    """The chain with some axes and points replaced."""
    h, o = chain.axes.copy(), chain.points_mm.copy()
    for i, axis in axes.items():
        h[i] = axis
    for i, point in points_mm.items():
        o[i] = point
    return dataclasses.replace(chain, axes=h, points_mm=o)


@pytest.mark.parametrize(
    ("axes", "points_mm"),
    [
        ({1: unit(0.1, 1, 0.2)}, {}),
        ({0: unit(0.1, 0.2, 1), 1: unit(0.1, 1, 0.2), 2: unit(-0.3, 0.5, 1)}, {1: [320, 100, 780]}),
        ({1: np.array([0.0, 0, 1])}, {}),  # axes 1 and 2 parallel
        ({2: np.array([1.0, 0, 0])}, {1: [0, 0, 780], 2: [0, 0, 2060]}),  # 1 and 2 meet, 2 and 3 meet
        ({2: unit(1e-6, 1, 0)}, {1: [1e-4, 0, 780]}),  # nearly parallel, nearly meeting: a calibrated arm
        ({2: unit(3e-8, 1, 0)}, {1: [1e-5, 0, 780]}),
    ],
)
def test_arms_of_any_kind_reach_by_every_branch(chain: Chain, axes: Any, points_mm: Any) -> None:
    arm = other(chain, axes, points_mm)
    q = np.random.default_rng(15).uniform(-np.pi, np.pi, (500, 6))
    poses = forward_kinematics(arm, q)
    found = inverse_kinematics(arm, poses)
    assert np.nanmax(errors(arm, found, poses)) < 1e-12
    assert np.nanmin(apart(found, q[:, None]), axis=1).max() < 1e-6


def test_general_method_has_the_branches_of_the_parallel_one(chain: Chain, postures: Any) -> None:
    centre = spherical_wrist(chain).centre_mm
    wanted = forward_kinematics(chain, postures(500, 16))[:, :3, 3]
    general = general_position(chain, centre, wanted)
    parallel = parallel_position(chain.axes, chain.points_mm / 1e3, centre / 1e3, wanted / 1e3)[0]
    assert (np.isfinite(general).sum(axis=1) == np.isfinite(parallel).sum(axis=1)).all()
    distance = apart(parallel[:, :, None], general[:, None])
    assert (
        np.nanmax(np.nanmin(np.where(np.isnan(distance), np.inf, distance), axis=2)[np.isfinite(parallel[..., 0])])
        < 1e-9
    )


def test_general_arm_out_of_reach_has_no_branch(arms: Any) -> None:
    far = np.tile(np.eye(4), (2, 1, 1))
    far[:, :3, 3] = [[4000, 0, 1000], [0, 0, 5000]]
    assert np.isnan(inverse_kinematics(arms("skewed"), far)).all()


def test_oblique_wrist_reaches_what_its_axes_allow(arms: Any) -> None:
    """Axis 6 stands between the difference and the sum of its and axis 4's angles with axis 5, as seen from axis 4."""
    arm, rng = arms("oblique"), np.random.default_rng(17)
    h, at_zero, centre = arm.axes, arm.base_from_flange_at_zero, spherical_wrist(arm).centre_mm
    poses = forward_kinematics(arm, rng.uniform(-2, 2, (200, 6)))
    wrist = poses[:, :3, :3] @ at_zero[:3, :3].T @ (centre - at_zero[:3, 3]) + poses[:, :3, 3]
    poses[:, :3, :3] = pinned = rotation_from_vector(rng.normal(size=(200, 3)))
    poses[:, :3, 3] = wrist - pinned @ at_zero[:3, :3].T @ (centre - at_zero[:3, 3])
    first = general_position(arm, centre, wrist)
    links = motions(arm, np.concatenate([np.nan_to_num(first), np.zeros_like(first)], axis=-1))[..., 3, :3, :3]
    bend = np.degrees(np.arccos(np.sum(links @ h[3] * (pinned @ at_zero[:3, :3].T @ h[5])[:, None], axis=-1)))
    side, other_side = np.degrees(np.arccos([h[3] @ h[4], h[4] @ h[5]]))
    reached = np.isfinite(first[..., 0]) & (abs(side - other_side) < bend) & (bend < side + other_side)
    found = inverse_kinematics(arm, poses)
    assert np.nanmax(errors(arm, found, poses)) < 1e-12
    assert (np.isfinite(found[..., 0]).sum(axis=1) == 2 * reached.sum(axis=1)).all()
    assert 0 < reached.sum() < np.isfinite(first[..., 0]).sum()


@pytest.mark.parametrize(
    ("axes", "points_mm", "message"),
    [
        ({}, {4: [1912.5, 0, 2265]}, "wrist is not spherical"),
        ({4: np.array([1.0, 0, 0])}, {}, "axes 4 and 5 are parallel"),
        ({1: np.array([0.0, 0, 1]), 2: np.array([0.0, 0, 1])}, {}, "cannot move the wrist's centre in all directions"),
        ({2: unit(1, 0, 0)}, {1: [0, 0, 780], 2: [0, 0, 780]}, "cannot move the wrist's centre in all directions"),
    ],
)
def test_other_robots_are_refused(chain: Chain, axes: Any, points_mm: Any, message: str) -> None:
    with pytest.raises(InputError, match=message):
        inverse_kinematics(other(chain, axes, points_mm), np.eye(4))
