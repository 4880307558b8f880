"""The closed-form inverse: every branch reaches the pose, and no branch is missed."""

import dataclasses
from typing import Any

import numpy as np
import pytest

from workbench.errors import InputError
from workbench.robot import Chain, forward_kinematics, inverse_kinematics, within_limits
from workbench.units import Float

from .conftest import apart, missing


def test_every_branch_reaches_and_the_posture_is_among_them(chain: Chain, postures: Any) -> None:
    q = postures(2000, 11)
    poses = forward_kinematics(chain, q)
    found = inverse_kinematics(chain, poses)
    assert np.nanmax(missing(chain, found, poses)) < 1e-12
    assert np.nanmin(apart(found, q[:, None]), axis=1).max() < 1e-9
    count = np.isfinite(found[..., 0]).sum(axis=1)
    assert set(count) == {4, 8}
    assert (np.abs(found[np.isfinite(found)]) <= np.pi).all()


@pytest.mark.parametrize("bend", [0.0, 1e-15, 1e-12, 1e-8, 1e-4])
def test_stretched_wrist_keeps_its_pose(chain: Chain, postures: Any, bend: float) -> None:
    q = postures(200, 14)
    q[:, 4] = bend
    poses = forward_kinematics(chain, q)
    found = inverse_kinematics(chain, poses)
    assert np.nanmax(missing(chain, found, poses)) < 1e-12
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
    assert np.nanmin(missing(chain, found, poses)) < 1e-9


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
    assert np.nanmax(missing(arm, found, poses)) < 1e-12
    assert np.nanmin(apart(found, q[:, None]), axis=1).max() < 1e-6


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
