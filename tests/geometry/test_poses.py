"""Poses against scipy's Rotation and Slerp and against pinocchio, to 1e-12, and the laws that hold without either.

Controllers' orientations against scipy and against worked examples.
"""

from __future__ import annotations

import math

import numpy as np
import pinocchio
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from scipy.spatial.transform import Rotation, Slerp

from workbench.geometry import poses
from workbench.geometry.poses import CONVENTIONS, ORDERS, quaternions, rotation_from_quaternion
from workbench.units import DEG, Float

EXACT = {"rtol": 0.0, "atol": 1e-12}
ANGLES = np.random.default_rng(5).uniform(-3.1, 3.1, (40, 3))


@pytest.fixture
def rotations() -> Rotation:
    """200 random rotations, then turns of 0, nearly 0, 180 and nearly 180 deg about several axes."""
    axes = np.array([[1, 0, 0], [0, 1, 0], [0, 0, 1], [0.6, 0, -0.8], [1 / 3, -2 / 3, 2 / 3]])
    special = [axes * angle for angle in (0.0, 1e-9, 1e-5, math.pi - 1e-7, math.pi)]
    random = Rotation.random(200, random_state=np.random.default_rng(1))
    return Rotation.concatenate([random, Rotation.from_rotvec(np.concatenate(special))])


def scipy_quaternion_wxyz(rotation: Rotation) -> Float:
    return np.roll(rotation.as_quat(), 1, axis=-1)


def test_quaternions_agree_with_scipy(rotations: Rotation) -> None:
    q = scipy_quaternion_wxyz(rotations)
    np.testing.assert_allclose(poses.rotation_from_quaternion(q), rotations.as_matrix(), **EXACT)
    np.testing.assert_allclose(poses.rotation_from_quaternion(-q), rotations.as_matrix(), **EXACT)
    ours = poses.quaternion_from_rotation(rotations.as_matrix())
    assert (ours[:, 0] >= 0).all()
    np.testing.assert_allclose(np.abs(np.sum(ours * q, axis=1)), 1.0, **EXACT)
    np.testing.assert_allclose(poses.rotation_from_quaternion(ours), rotations.as_matrix(), **EXACT)


def test_rotation_vectors_agree_with_scipy_and_pinocchio(rotations: Rotation) -> None:
    v = rotations.as_rotvec()
    np.testing.assert_allclose(poses.rotation_from_vector(v), rotations.as_matrix(), **EXACT)
    log = poses.vector_from_rotation(rotations.as_matrix())
    assert (np.linalg.norm(log, axis=1) <= math.pi + 1e-12).all()
    np.testing.assert_allclose(poses.rotation_from_vector(log), rotations.as_matrix(), **EXACT)
    short = np.linalg.norm(v, axis=1) < 3.0
    np.testing.assert_allclose(log[short], v[short], **EXACT)
    for row in v[:20]:
        np.testing.assert_allclose(poses.rotation_from_vector(row), pinocchio.exp3(row), **EXACT)


def test_rpy_is_roll_about_z_then_pitch_about_y_then_yaw_about_x() -> None:
    roll, pitch, yaw = 60.489 * DEG, -3.813 * DEG, -2.024 * DEG  # the paper's hand-eye result
    r = poses.rotation_from_rpy(roll, pitch, yaw)
    np.testing.assert_allclose(r, Rotation.from_euler("ZYX", [roll, pitch, yaw]).as_matrix(), **EXACT)
    np.testing.assert_allclose(r, pinocchio.rpy.rpyToMatrix(yaw, pitch, roll), **EXACT)
    np.testing.assert_allclose(poses.rpy_from_rotation(r), (roll, pitch, yaw), **EXACT)


@pytest.mark.parametrize("pitch", [math.pi / 2, -math.pi / 2])
def test_rpy_at_gimbal_lock_still_gives_the_rotation(pitch: float) -> None:
    r = Rotation.from_euler("ZYX", [0.7, pitch, 0.2]).as_matrix()
    angles = poses.rpy_from_rotation(r)
    np.testing.assert_allclose(poses.rotation_from_rpy(*angles), r, rtol=0, atol=1e-9)


def test_slerp_agrees_with_scipy_whatever_the_signs() -> None:
    rng = np.random.default_rng(2)
    pairs = Rotation.random(100, random_state=rng), Rotation.random(100, random_state=rng)
    fraction = rng.random(100)
    signs = rng.choice([-1.0, 1.0], (2, 100, 1))
    q = poses.slerp(*(s * scipy_quaternion_wxyz(r) for s, r in zip(signs, pairs, strict=True)), fraction)
    for i in range(100):
        theirs = Slerp([0, 1], Rotation.concatenate([pairs[0][i], pairs[1][i]]))(fraction[i])
        np.testing.assert_allclose(poses.rotation_from_quaternion(q[i]), theirs.as_matrix(), **EXACT)


def test_interpolated_poses_agree_with_scipy_in_a_dense_stream() -> None:
    rng = np.random.default_rng(3)
    pose_time = np.cumsum(rng.uniform(0.004, 0.04, 60))
    steps = Rotation.from_rotvec(rng.normal(scale=0.02, size=(60, 3)))
    rotations = [steps[0]]
    for step in steps[1:]:
        rotations.append(step * rotations[-1])
    stream = Rotation.concatenate(rotations)
    position = np.cumsum(rng.normal(size=(60, 3)), axis=0)
    time = np.sort(rng.uniform(pose_time[0], pose_time[-1], 200))
    ours = poses.interpolate_poses(time, pose_time, position, scipy_quaternion_wxyz(stream))
    np.testing.assert_allclose(ours[:, :3, :3], Slerp(pose_time, stream)(time).as_matrix(), **EXACT)
    for axis in range(3):
        np.testing.assert_allclose(ours[:, axis, 3], np.interp(time, pose_time, position[:, axis]), **EXACT)


unit_quaternions = (
    hnp.arrays(float, 4, elements=st.floats(-1, 1, width=32))
    .filter(lambda q: np.linalg.norm(q) > 0.1)
    .map(lambda q: q / np.linalg.norm(q))
)
positions = hnp.arrays(float, 3, elements=st.floats(-5000, 5000))


@settings(deadline=None, derandomize=True)
@given(
    ends=st.lists(st.tuples(positions, unit_quaternions), min_size=2, max_size=5),
    start_s=st.floats(-1e6, 1e6),
    fractions=st.lists(st.floats(0, 1), min_size=1, max_size=4),
)
def test_interpolation_is_rigid_and_exact_at_the_poses(
    ends: list[tuple[Float, Float]], start_s: float, fractions: list[float]
) -> None:
    pose_time = start_s + np.arange(len(ends)) * 0.5
    position, quaternion = (np.array(column) for column in zip(*ends, strict=True))
    at_ends = poses.interpolate_poses(pose_time, pose_time, position, quaternion)
    np.testing.assert_array_equal(at_ends[:, :3, 3], position)
    np.testing.assert_allclose(at_ends[:, :3, :3], poses.rotation_from_quaternion(quaternion), rtol=0, atol=1e-12)
    time = pose_time[0] + np.array(fractions) * (pose_time[-1] - pose_time[0])
    for pose in poses.interpolate_poses(time, pose_time, position, quaternion):
        assert poses.is_rigid(pose, 1e-12)


@settings(deadline=None, derandomize=True)
@given(angle=st.floats(0, math.pi * 0.999), axis=unit_quaternions.map(lambda q: q[1:]), fraction=st.floats(0, 1))
def test_slerp_turns_uniformly(angle: float, axis: Float, fraction: float) -> None:
    norm = np.linalg.norm(axis)
    unit = axis / norm if norm > 1e-3 else np.array([0.0, 0.0, 1.0])
    end = poses.quaternion_from_rotation(poses.rotation_from_vector(unit * angle))
    q = poses.slerp(np.array([1.0, 0, 0, 0]), end, np.array(fraction))
    np.testing.assert_allclose(
        poses.rotation_from_quaternion(q), poses.rotation_from_vector(unit * angle * fraction), rtol=0, atol=1e-9
    )


def test_a_single_pose_holds_at_all_times() -> None:
    q = np.array([[0.6, 0.8, 0.0, 0.0]])
    held = poses.interpolate_poses(np.array([0.0, 9.0]), np.array([3.0]), np.array([[1.0, 2.0, 3.0]]), q)
    np.testing.assert_array_equal(held[0], held[1])
    np.testing.assert_array_equal(held[0, :3, 3], (1, 2, 3))


@pytest.mark.parametrize("time", [-1e-9, 1.0000001])
def test_a_time_outside_the_poses_is_refused(time: float) -> None:
    q = np.array([[1.0, 0, 0, 0], [1.0, 0, 0, 0]])
    with pytest.raises(ValueError, match="outside"):
        poses.interpolate_poses(np.array([time]), np.array([0.0, 1.0]), np.zeros((2, 3)), q)


def test_inverse_undoes_a_pose() -> None:
    rng = np.random.default_rng(4)
    pose = poses.pose_from(Rotation.random(7, random_state=rng).as_matrix(), rng.normal(scale=500, size=(7, 3)))
    np.testing.assert_allclose(poses.inverse(pose) @ pose, np.broadcast_to(np.eye(4), (7, 4, 4)), atol=1e-12)


def improper() -> dict[str, Float]:
    good = poses.pose_from(poses.rotation_from_rpy(0.1, 0.2, 0.3), np.array([1.0, 2.0, 3.0]))
    bad = {name: good.copy() for name in ("scaled", "mirrored", "sheared", "last row", "not finite", "huge")}
    bad["scaled"][:3, :3] *= 1.00001
    bad["mirrored"][:3, 0] *= -1
    bad["sheared"][0, 1] += 1e-5
    bad["last row"][3, 0] = 1e-3
    bad["huge"][0, 0] = 1e200
    bad["not finite"][0, 3] = np.nan
    assert poses.is_rigid(good)
    return {**bad, "shape": good[:3]}


@pytest.mark.parametrize(("name", "pose"), improper().items())
def test_improper_motions_are_told(name: str, pose: Float) -> None:
    assert not poses.is_rigid(pose), name


def matrices(values: Float, convention: str) -> Float:
    return rotation_from_quaternion(quaternions(values, convention))


@pytest.mark.parametrize("order", ORDERS)
def test_euler_orders_agree_with_scipy(order: str) -> None:
    # scipy: lower case turns about axes that stay, upper case about the moving ones
    extrinsic, intrinsic = Rotation.from_euler(order, ANGLES), Rotation.from_euler(order.upper(), ANGLES)
    np.testing.assert_allclose(matrices(ANGLES, f"euler_{order}_extrinsic"), extrinsic.as_matrix(), atol=1e-12)
    np.testing.assert_allclose(matrices(ANGLES, f"euler_{order}_intrinsic"), intrinsic.as_matrix(), atol=1e-12)


def test_twelve_orders_no_two_alike() -> None:
    assert len(set(ORDERS)) == 12
    assert len(set(CONVENTIONS)) == len(CONVENTIONS) == 34
