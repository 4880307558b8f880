"""The closed-form inverse: every branch reaches the pose, and no branch is missed."""

import dataclasses
from typing import Any

import numpy as np
import pytest

from workbench.errors import InputError
from workbench.geometry.poses import vector_from_rotation
from workbench.robot import Chain, forward_kinematics, inverse_kinematics, jacobian, within_limits
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


def test_no_branch_is_missed(chain: Chain, postures: Any) -> None:
    """Newton from many starts, which knows nothing of wrists, finds the branches of the closed form and no others."""
    poses = forward_kinematics(chain, postures(20, 13))
    found = inverse_kinematics(chain, poses)
    rng = np.random.default_rng(13)
    met = np.zeros(found.shape[:2], bool)
    for pose, branches, seen in zip(poses, found, met, strict=True):
        solved = newton(chain, pose, rng.uniform(-np.pi, np.pi, (120, 6)))
        assert len(solved) > 20
        distance = apart(solved[:, None], branches[None])
        assert np.nanmin(distance, axis=1).max() < 1e-6
        seen[np.nanargmin(distance, axis=1)] = True
    there = np.isfinite(found[..., 0])
    assert met[there].mean() > 0.99


def newton(chain: Chain, pose: Float, q: Float) -> Float:
    """Damped least squares from every row of `q`; those that arrived."""
    scale = np.array([1e-3] * 3 + [1.0] * 3)
    for _ in range(40):
        here = forward_kinematics(chain, q)
        turn = vector_from_rotation(pose[:3, :3] @ np.swapaxes(here[:, :3, :3], 1, 2))
        miss = np.hstack([pose[:3, 3] - here[:, :3, 3], turn]) * scale
        j = scale[:, None] * jacobian(chain, q)
        damping = 1e-2 * np.minimum(np.linalg.norm(miss, axis=1), 1.0) ** 2
        jt = np.swapaxes(j, 1, 2)
        step = np.linalg.solve(jt @ j + damping[:, None, None] * np.eye(6), jt @ miss[..., None])[..., 0]
        q = q + step * np.minimum(1, 0.8 / np.maximum(np.linalg.norm(step, axis=1, keepdims=True), 1e-12))
    return q[np.linalg.norm(miss, axis=1) < 1e-10]


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


@pytest.mark.parametrize(
    ("joint", "axis", "shift", "message"),
    [
        (4, None, [0.0, 0.0, 5.0], "wrist is not spherical"),
        (2, [0.0, 0.6, 0.8], [0.0, 0.0, 0.0], "axes 2 and 3 are not parallel"),
        (4, [0.6, 0.8, 0.0], [0.0, 0.0, 0.0], "right angles"),
    ],
)
def test_other_robots_are_refused(chain: Chain, joint: int, axis: Any, shift: Any, message: str) -> None:
    axes, points = chain.axes.copy(), chain.points_mm.copy()
    axes[joint] = axes[joint] if axis is None else axis
    points[joint] += shift
    other = dataclasses.replace(chain, axes=axes, points_mm=points)
    with pytest.raises(InputError, match=message):
        inverse_kinematics(other, np.eye(4))
