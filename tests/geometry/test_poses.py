"""Poses against scipy's Rotation and Slerp and against pinocchio, to 1e-12, and the laws that hold without either."""

from __future__ import annotations

import math

import numpy as np
import pinocchio
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation, Slerp

from workbench.api import (
    DEG,
    Float,
    interpolate_poses,
    inverse,
    pose_from,
    quaternion_from_rotation,
    rotation_from_quaternion,
    rotation_from_rpy,
    rotation_from_vector,
    rpy_from_rotation,
    vector_from_rotation,
)

EXACT = {"rtol": 0.0, "atol": 1e-12}

number, share = st.floats(-1.0, 1.0), st.floats(0.0, 1.0)
turns = st.tuples(number, number, number, st.sampled_from([0.0, 1e-9, 1e-5, 1.0, 3.0, math.pi - 1e-7, math.pi])).map(
    lambda drawn: np.array(drawn[:3]) / max(float(np.linalg.norm(drawn[:3])), 0.1) * drawn[3]
)  # rotation vectors, of length 0, nearly 0, pi and nearly pi, and between
signs = st.sampled_from([-1.0, 1.0])


def wxyz(rotation: Rotation) -> Float:
    return np.roll(rotation.as_quat(), 1, axis=-1)


@given(turns, signs)
def test_quaternions_and_rotation_vectors_agree_with_scipy_and_pinocchio(vector: Float, sign: float) -> None:
    rotation = Rotation.from_rotvec(vector)
    np.testing.assert_allclose(rotation_from_vector(vector), rotation.as_matrix(), **EXACT)
    np.testing.assert_allclose(rotation_from_vector(vector), pinocchio.exp3(vector), **EXACT)
    np.testing.assert_allclose(rotation_from_quaternion(sign * wxyz(rotation)), rotation.as_matrix(), **EXACT)
    quaternion = quaternion_from_rotation(rotation.as_matrix())
    assert quaternion[0] >= 0
    np.testing.assert_allclose(rotation_from_quaternion(quaternion), rotation.as_matrix(), **EXACT)
    back = vector_from_rotation(rotation.as_matrix())
    assert np.linalg.norm(back) <= math.pi + 1e-12
    np.testing.assert_allclose(rotation_from_vector(back), rotation.as_matrix(), **EXACT)
    if np.linalg.norm(vector) < 3.1:
        np.testing.assert_allclose(back, vector, **EXACT)


PAPER = 60.489 * DEG, -3.813 * DEG, -2.024 * DEG  # the paper's hand-eye result


@example(*PAPER)
@given(st.floats(-3.1, 3.1), st.floats(-1.5, 1.5), st.floats(-3.1, 3.1))
def test_rpy_is_roll_about_z_then_pitch_about_y_then_yaw_about_x(roll: float, pitch: float, yaw: float) -> None:
    r = rotation_from_rpy(roll, pitch, yaw)
    np.testing.assert_allclose(r, Rotation.from_euler("ZYX", [roll, pitch, yaw]).as_matrix(), **EXACT)
    np.testing.assert_allclose(r, pinocchio.rpy.rpyToMatrix(yaw, pitch, roll), **EXACT)
    np.testing.assert_allclose(rpy_from_rotation(r), (roll, pitch, yaw), rtol=0, atol=1e-10)


@pytest.mark.parametrize("pitch", [math.pi / 2, -math.pi / 2])
def test_rpy_at_gimbal_lock_still_gives_the_rotation(pitch: float) -> None:
    r = Rotation.from_euler("ZYX", [0.7, pitch, 0.2]).as_matrix()
    np.testing.assert_allclose(rotation_from_rpy(*rpy_from_rotation(r)), r, rtol=0, atol=1e-9)


@given(st.integers(0, 10**6), st.integers(2, 60), st.floats(-1e6, 1e6))
def test_interpolated_poses_agree_with_scipy_are_rigid_and_exact_at_the_poses(seed: int, n: int, start: float) -> None:
    rng = np.random.default_rng(seed)
    pose_time, position = start + np.cumsum(rng.uniform(0.004, 0.04, n)), rng.uniform(-5000, 5000, (n, 3))
    stream = Rotation.from_rotvec(np.cumsum(rng.normal(scale=rng.choice([0.02, 0.3]), size=(n, 3)), axis=0))
    quaternion = rng.choice([-1.0, 1.0], (n, 1)) * wxyz(stream)
    time = np.concatenate([pose_time, rng.uniform(pose_time[0], pose_time[-1], 50)])
    found = interpolate_poses(time, pose_time, position, quaternion)
    np.testing.assert_array_equal(found[:n, :3, 3], position)
    np.testing.assert_allclose(found[:, :3, :3], Slerp(pose_time, stream)(time).as_matrix(), rtol=0, atol=1e-9)
    places = np.stack([np.interp(time, pose_time, axis) for axis in position.T], axis=1)
    np.testing.assert_allclose(found[:, :3, 3], places, rtol=0, atol=1e-9)
    turn = found[:, :3, :3]
    np.testing.assert_allclose(turn @ np.swapaxes(turn, 1, 2), np.broadcast_to(np.eye(3), turn.shape), **EXACT)


def test_a_single_pose_holds_at_all_times() -> None:
    q = np.array([[0.6, 0.8, 0.0, 0.0]])
    held = interpolate_poses(np.array([0.0, 9.0]), np.array([3.0]), np.array([[1.0, 2.0, 3.0]]), q)
    np.testing.assert_array_equal(held[0], held[1])
    np.testing.assert_array_equal(held[0, :3, 3], (1, 2, 3))


@pytest.mark.parametrize("time", [-1e-9, 1.0000001])
def test_a_time_outside_the_poses_is_refused(time: float) -> None:
    with pytest.raises(ValueError, match="outside"):
        interpolate_poses(np.array([time]), np.array([0.0, 1.0]), np.zeros((2, 3)), np.eye(4)[[0, 0]])


def test_inverse_undoes_a_pose() -> None:
    rng = np.random.default_rng(4)
    pose = pose_from(Rotation.random(7, random_state=rng).as_matrix(), rng.normal(scale=500, size=(7, 3)))
    np.testing.assert_allclose(inverse(pose) @ pose, np.broadcast_to(np.eye(4), (7, 4, 4)), atol=1e-12)
