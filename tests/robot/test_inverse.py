"""The inverse: every branch reaches the pose, no branch is missed, and an independent solver finds the same.

EAIK (Ostermeier, Kuelz, Althoff 2025) also gives least-squares answers where a pose cannot be had. Those that miss the
pose are left out by forward kinematics, which is pin's (test_kinematics.py). Where no axes are parallel or meet it
marks all its answers as such, and they reach the pose to 4e-7 only; least squares miss it by far more there.
"""

import dataclasses
from typing import Any

import numpy as np
import pytest

from workbench.errors import InputError
from workbench.robot import Chain, forward_kinematics, inverse_kinematics, within_limits
from workbench.units import Float

from .conftest import apart, missing

SPHERICAL = ["irb6700", "puma", "oblique"]
STRETCHED = {"ur10e": 0.0, "crx10ia": np.pi / 2, "irb6700": -np.arctan2(1592.5, 200)}  # joint 3
OFFSET = ["ur10e", "crx10ia"]  # their wrists along axis 5: roots of a polynomial
MOST = 64  # answers of EAIK, least squares included
REACHES, ROUGHLY, SAME = 1e-9, 1e-6, 1e-6  # m and 1; rad


def drawn(chain: Chain, name: str, where: str, count: int = 600) -> Float:
    """Random postures (count, 6): within limits, some joints on them, arm or wrist nearly or fully stretched."""
    rng = np.random.default_rng(41)
    q = rng.uniform(*np.clip(chain.limits.T, -np.pi, np.pi), (count, 6))
    near = rng.choice([-1, 1], count) * 10.0 ** rng.uniform(-4, -2, count)
    if where == "on limits":
        for row in q:
            joints = rng.choice(6, 3, replace=False)
            row[joints] = chain.limits[joints, rng.integers(0, 2, 3)]
    elif where == "arm nearly stretched":
        q[:, 2] = STRETCHED[name] + near
    elif where == "wrist nearly stretched":
        q[:, 4] = near
    return q


CASES = [(name, where) for name in (*SPHERICAL, *OFFSET) for where in ("within limits", "wrist nearly stretched")]
CASES += [(name, "on limits") for name in SPHERICAL] + [(name, "arm nearly stretched") for name in STRETCHED]


@pytest.mark.parametrize(("name", "where"), CASES)
def test_every_branch_reaches_and_the_posture_is_among_them(arms: Any, name: str, where: str) -> None:
    chain: Chain = arms(name)
    q = drawn(chain, name, where)
    poses = forward_kinematics(chain, q)
    found = inverse_kinematics(chain, poses)
    assert np.nanmax(missing(chain, found, poses)) < (1e-9 if name in OFFSET else 1e-12)
    assert np.nanmin(apart(found, q[:, None]), axis=1).max() < 1e-6
    assert (np.abs(found[np.isfinite(found)]) <= np.pi).all()
    count = set(np.isfinite(found[..., 0]).sum(axis=1))
    if where == "within limits":
        assert count <= ({2, 4, 6, 8, 12, 16} if name in OFFSET else {2, 4, 6, 8})
        assert (16 in count) == (name == "crx10ia")


@pytest.mark.parametrize(
    ("name", "where"), [*(one for one in CASES if one[0] not in OFFSET), ("ur10e", "within limits")]
)
def test_the_branches_are_those_of_eaik(arms: Any, name: str, where: str) -> None:
    chain: Chain = arms(name)
    poses = forward_kinematics(chain, drawn(chain, name, where, 200))
    ours, theirs = inverse_kinematics(chain, poses), peer(chain, poses)
    distance = apart(ours[:, :, None], theirs[:, None])
    distance[np.isnan(distance)] = np.inf
    assert (distance.min(axis=1)[np.isfinite(theirs[..., 0])] < SAME).all()
    assert (distance.min(axis=2)[np.isfinite(ours[..., 0])] < SAME).all()
    assert np.isfinite(ours[..., 0]).sum() > 3 * len(poses)


def peer(chain: Chain, poses: Float) -> Float:
    """EAIK's answers (n, MOST, 6) that reach the poses (n, 4, 4); NaN: fewer."""
    eaik = pytest.importorskip("eaik.pybindings.EAIK", reason="EAIK has no wheel for this Python")
    points = np.vstack([np.zeros(3), chain.points_mm, chain.base_from_flange_at_zero[:3, 3]]) / 1e3
    turn = chain.base_from_flange_at_zero[:3, :3]
    robot: Any = eaik.Robot(chain.axes.T, np.diff(points, axis=0).T, turn, [], True)
    metres = poses.copy()
    metres[:, :3, 3] /= 1e3
    found, marked = np.full((len(poses), MOST, 6), np.nan), True
    for row, solution in zip(found, robot.calculate_IK_batched(list(metres), 1), strict=True):
        if len(solution.Q):
            row[: len(solution.Q)] = solution.Q
            marked = marked and all(solution.is_LS)
    found[~(missing(chain, found, poses) < (ROUGHLY if marked else REACHES))] = np.nan
    return found


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


def test_poses_out_of_a_file_are_reached(arms: Any) -> None:
    """Rounded to 8 digits their rotations are none."""
    chain: Chain = arms("ur10e")
    poses = forward_kinematics(chain, np.radians([[10, -70, 100, -60, -80, 30], [50, -100, 60, -30, 70, 0]]))
    found = inverse_kinematics(chain, np.round(poses, 7))
    assert np.isfinite(found[..., 0]).sum() == 16
    assert np.nanmax(missing(chain, found, poses)) < 1e-4


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
    ("axes", "points_mm", "share"),
    [
        ({2: unit(3e-8, 1, 0)}, {1: [1e-5, 0, 780]}, 1.0),
        ({2: unit(1e-6, 1, 0)}, {1: [1e-4, 0, 780]}, 1.0),
        ({1: unit(1e-3, 1, -7e-4), 2: unit(-3e-4, 1, 1e-3)}, {1: [320, 1, 780]}, 0.997),  # but for double branches
    ],
)
def test_a_calibrated_arm_reaches_by_every_branch(chain: Chain, axes: Any, points_mm: Any, share: float) -> None:
    """Axes 2 and 3 are not quite parallel."""
    arm = other(chain, axes, points_mm)
    q = np.random.default_rng(15).uniform(-np.pi, np.pi, (500, 6))
    poses = forward_kinematics(arm, q)
    found = inverse_kinematics(arm, poses)
    assert np.nanmax(missing(arm, found, poses)) < 1e-11  # 1.2e-12 on some processors, beside double branches
    assert (apart(found, q[:, None]) < 1e-6).any(axis=1).mean() >= share


@pytest.mark.parametrize(
    ("name", "axes", "points_mm", "message"),
    [
        ("irb6700", {}, {4: [1912.5, 0, 2265]}, "wrist is not spherical"),
        ("irb6700", {4: np.array([1.0, 0, 0])}, {}, "axes 4 and 5 are parallel"),
        ("irb6700", {1: unit(0, 0, 1), 2: unit(0, 0, 1)}, {}, "cannot move the wrist's centre in all directions"),
        ("irb6700", {2: unit(1, 0, 0)}, {1: [0, 0, 780], 2: [0, 0, 780]}, "cannot move the wrist's centre"),
        ("irb6700", {2: unit(1, 1, 0)}, {}, "axes 2 and 3 are not parallel"),
        ("ur10e", {}, {5: [30, 0, 0]}, "wrist is not spherical"),  # axis 6 beside axis 5
    ],
)
def test_other_robots_are_refused(arms: Any, name: str, axes: Any, points_mm: Any, message: str) -> None:
    with pytest.raises(InputError, match=message):
        inverse_kinematics(other(arms(name), axes, points_mm), np.eye(4))
