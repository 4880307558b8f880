"""Poses against scipy's Rotation and Slerp and against pinocchio, to 1e-12, and the laws that hold without either.

Controllers' orientations against scipy and against worked examples.
"""

from __future__ import annotations

import math

import numpy as np
import pinocchio
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation, Slerp

from workbench.geometry import poses
from workbench.geometry.poses import CONVENTIONS, ORDERS, quaternions, rotation_from_quaternion
from workbench.units import DEG, Float

EXACT = {"rtol": 0.0, "atol": 1e-12}
ANGLES = np.random.default_rng(5).uniform(-3.1, 3.1, (40, 3))

number, share = st.floats(-1.0, 1.0), st.floats(0.0, 1.0)
turns = st.tuples(number, number, number, st.sampled_from([0.0, 1e-9, 1e-5, 1.0, 3.0, math.pi - 1e-7, math.pi])).map(
    lambda drawn: np.array(drawn[:3]) / max(float(np.linalg.norm(drawn[:3])), 0.1) * drawn[3]
)  # rotation vectors, of length 0, nearly 0, pi and nearly pi, and between
signs = st.sampled_from([-1.0, 1.0])


def wxyz(rotation: Rotation) -> Float:
    return np.roll(rotation.as_quat(), 1, axis=-1)


def interpolated(time: Float, pose_time: Float, position: Float, quaternion: Float) -> Float:
    return poses.interpolate_poses(time, pose_time, position, quaternion)


@given(turns, signs)
def test_quaternions_and_rotation_vectors_agree_with_scipy_and_pinocchio(vector: Float, sign: float) -> None:
    rotation = Rotation.from_rotvec(vector)
    np.testing.assert_allclose(poses.rotation_from_vector(vector), rotation.as_matrix(), **EXACT)
    np.testing.assert_allclose(poses.rotation_from_vector(vector), pinocchio.exp3(vector), **EXACT)
    np.testing.assert_allclose(rotation_from_quaternion(sign * wxyz(rotation)), rotation.as_matrix(), **EXACT)
    quaternion = poses.quaternion_from_rotation(rotation.as_matrix())
    assert quaternion[0] >= 0
    np.testing.assert_allclose(rotation_from_quaternion(quaternion), rotation.as_matrix(), **EXACT)
    back = poses.vector_from_rotation(rotation.as_matrix())
    assert np.linalg.norm(back) <= math.pi + 1e-12
    np.testing.assert_allclose(poses.rotation_from_vector(back), rotation.as_matrix(), **EXACT)
    if np.linalg.norm(vector) < 3.1:
        np.testing.assert_allclose(back, vector, **EXACT)


PAPER = 60.489 * DEG, -3.813 * DEG, -2.024 * DEG  # the paper's hand-eye result


@example(*PAPER)
@given(st.floats(-3.1, 3.1), st.floats(-1.5, 1.5), st.floats(-3.1, 3.1))
def test_rpy_is_roll_about_z_then_pitch_about_y_then_yaw_about_x(roll: float, pitch: float, yaw: float) -> None:
    r = poses.rotation_from_rpy(roll, pitch, yaw)
    np.testing.assert_allclose(r, Rotation.from_euler("ZYX", [roll, pitch, yaw]).as_matrix(), **EXACT)
    np.testing.assert_allclose(r, pinocchio.rpy.rpyToMatrix(yaw, pitch, roll), **EXACT)
    np.testing.assert_allclose(poses.rpy_from_rotation(r), (roll, pitch, yaw), rtol=0, atol=1e-10)


@pytest.mark.parametrize("pitch", [math.pi / 2, -math.pi / 2])
def test_rpy_at_gimbal_lock_still_gives_the_rotation(pitch: float) -> None:
    r = Rotation.from_euler("ZYX", [0.7, pitch, 0.2]).as_matrix()
    np.testing.assert_allclose(poses.rotation_from_rpy(*poses.rpy_from_rotation(r)), r, rtol=0, atol=1e-9)


@given(turns, turns, share, signs, signs)
def test_slerp_agrees_with_scipy_whatever_the_signs(a: Float, b: Float, at: float, p: float, q: float) -> None:
    ends = Rotation.from_rotvec([a, b])
    if (ends[0].inv() * ends[1]).magnitude() > 3.1:
        return  # no way is the shorter one
    found = poses.slerp(p * wxyz(ends[0]), q * wxyz(ends[1]), np.array(at))
    np.testing.assert_allclose(rotation_from_quaternion(found), Slerp([0, 1], ends)(at).as_matrix(), rtol=0, atol=1e-9)


@given(st.integers(0, 10**6), st.integers(2, 60), st.floats(-1e6, 1e6))
def test_interpolated_poses_agree_with_scipy_are_rigid_and_exact_at_the_poses(seed: int, n: int, start: float) -> None:
    rng = np.random.default_rng(seed)
    pose_time, position = start + np.cumsum(rng.uniform(0.004, 0.04, n)), rng.uniform(-5000, 5000, (n, 3))
    stream = Rotation.from_rotvec(np.cumsum(rng.normal(scale=rng.choice([0.02, 0.3]), size=(n, 3)), axis=0))
    quaternion = rng.choice([-1.0, 1.0], (n, 1)) * wxyz(stream)
    time = np.concatenate([pose_time, rng.uniform(pose_time[0], pose_time[-1], 50)])
    found = interpolated(time, pose_time, position, quaternion)
    np.testing.assert_array_equal(found[:n, :3, 3], position)
    np.testing.assert_allclose(found[:, :3, :3], Slerp(pose_time, stream)(time).as_matrix(), rtol=0, atol=1e-9)
    places = np.stack([np.interp(time, pose_time, axis) for axis in position.T], axis=1)
    np.testing.assert_allclose(found[:, :3, 3], places, rtol=0, atol=1e-9)
    assert all(poses.is_rigid(pose, 1e-12) for pose in found)


def test_a_single_pose_holds_at_all_times() -> None:
    q = np.array([[0.6, 0.8, 0.0, 0.0]])
    held = interpolated(np.array([0.0, 9.0]), np.array([3.0]), np.array([[1.0, 2.0, 3.0]]), q)
    np.testing.assert_array_equal(held[0], held[1])
    np.testing.assert_array_equal(held[0, :3, 3], (1, 2, 3))


@pytest.mark.parametrize("time", [-1e-9, 1.0000001])
def test_a_time_outside_the_poses_is_refused(time: float) -> None:
    with pytest.raises(ValueError, match="outside"):
        interpolated(np.array([time]), np.array([0.0, 1.0]), np.zeros((2, 3)), np.eye(4)[[0, 0]])


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
