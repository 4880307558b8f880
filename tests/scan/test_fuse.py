"""`scan.fuse` against the paper's equation (9) written out with scipy, one frame after another."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation, Slerp

from workbench.api import pose_from, rotation_from_rpy
from workbench.artefacts import Recording
from workbench.errors import InputError
from workbench.scan import fuse, read
from workbench.units import Float


@pytest.fixture
def recording(build: Callable[..., Path]) -> Recording:
    return read(recording=build())


def expected_poses(recording: Recording, flange_from_profiler: Float) -> Float:
    poses = []
    for time, number in zip(recording.time_s, recording.pass_index, strict=True):
        ours = recording.robot_pass == number
        turn = Rotation.from_quat(np.roll(recording.robot_quaternion_wxyz[ours], -1, axis=1))
        base_from_flange = np.eye(4)
        base_from_flange[:3, :3] = Slerp(recording.robot_time_s[ours], turn)(time).as_matrix()
        for axis in range(3):
            along = recording.robot_position_mm[ours, axis]
            base_from_flange[axis, 3] = np.interp(time, recording.robot_time_s[ours], along)
        poses.append(base_from_flange @ flange_from_profiler)
    return np.array(poses)


def test_two_poses_a_pass_opposite_signs_and_interleaved_passes(recording: Recording) -> None:
    cloud = fuse(recording)
    order = np.argsort(recording.pass_index, kind="stable")  # the file begins with pass -5
    np.testing.assert_array_equal(cloud.pass_index, recording.pass_index[order])
    np.testing.assert_array_equal(cloud.time_s, recording.time_s[order])
    np.testing.assert_array_equal(cloud.x_mm, recording.x_mm[order])
    np.testing.assert_array_equal(cloud.z_mm, recording.z_mm[order])
    assert recording.flange_from_profiler is not None
    truth = expected_poses(recording, recording.flange_from_profiler)[order]
    np.testing.assert_allclose(cloud.base_from_profiler, truth, rtol=0, atol=1e-9)
    np.testing.assert_array_equal(cloud.keep, np.isfinite(cloud.x_mm) & np.isfinite(cloud.z_mm))
    assert cloud.keep.sum() == 12 * 7 - 8
    assert cloud.only_end_poses
    assert (cloud.source, cloud.part.part_id, cloud.hand_eye_covariance) == (recording.source, "A-7", None)


def test_a_dense_stream_of_poses(recording: Recording) -> None:
    rng = np.random.default_rng(6)
    time = np.linspace(-0.01, 0.21, 45)
    turn = Rotation.from_rotvec(np.outer(np.sin(time * 20), [0.02, -0.01, 0.03]))
    sign = rng.choice([-1.0, 1.0], (45, 1))
    dense = dataclasses.replace(
        recording,
        time_s=np.arange(12) / 60,
        pass_index=np.full(12, 3),
        robot_time_s=time,
        robot_position_mm=1000.0 + np.cumsum(rng.normal(size=(45, 3)), axis=0),
        robot_quaternion_wxyz=sign * np.roll(turn.as_quat(), 1, axis=1),
        robot_pass=np.full(45, 3),
    )
    assert dense.flange_from_profiler is not None
    cloud = fuse(dense)
    truth = expected_poses(dense, dense.flange_from_profiler)
    np.testing.assert_allclose(cloud.base_from_profiler, truth, rtol=0, atol=1e-9)
    assert cloud.x_mm is dense.x_mm  # one pass: nothing is copied
    assert not cloud.only_end_poses


def test_another_calibration_takes_the_place_of_the_recorded_one(recording: Recording, tmp_path: Path) -> None:
    pose = pose_from(rotation_from_rpy(0.2, 0.1, -0.3), np.array([100.0, 2.0, 3.0]))
    covariance = np.diag([1e-4] * 3 + [1e-8] * 3)
    content: dict[str, Any] = {"flange_from_profiler": pose.tolist(), "covariance": covariance.tolist()}
    path = tmp_path / "handeye.json"
    path.write_text(json.dumps(content))
    cloud = fuse(recording, hand_eye=path)
    order = np.argsort(recording.pass_index, kind="stable")
    np.testing.assert_allclose(cloud.base_from_profiler, expected_poses(recording, pose)[order], rtol=0, atol=1e-9)
    np.testing.assert_array_equal(cloud.flange_from_profiler, pose)
    np.testing.assert_array_equal(cloud.hand_eye_covariance, covariance)
    bare = dataclasses.replace(recording, flange_from_profiler=None)
    np.testing.assert_array_equal(fuse(bare, hand_eye=path).base_from_profiler, cloud.base_from_profiler)


@pytest.mark.parametrize("what", ["sensor", "robot"])
def test_the_calibration_of_another_instrument_is_refused(recording: Recording, tmp_path: Path, what: str) -> None:
    path = tmp_path / "handeye.json"
    path.write_text(json.dumps({"flange_from_profiler": np.eye(4).tolist(), "part": {f"{what}_serial": "AAA"}}))
    own, other, unknown = (
        dataclasses.replace(recording, part=dataclasses.replace(recording.part, **{f"{what}_serial": serial}))
        for serial in ("AAA", "BBB", None)
    )
    with pytest.raises(InputError, match=f"expected the recording's {what}, 'BBB', found 'AAA'"):
        fuse(other, hand_eye=path)
    assert fuse(own, hand_eye=path).part.hand_eye == fuse(unknown, hand_eye=path).part.hand_eye == "handeye.json"


def test_without_any_calibration_nothing_is_fused(recording: Recording) -> None:
    with pytest.raises(InputError, match="hand_eye/flange_from_profiler: missing"):
        fuse(dataclasses.replace(recording, flange_from_profiler=None))


def test_times_on_the_profilers_own_clock_are_not_fused(recording: Recording) -> None:
    with pytest.raises(InputError, match="robot's clock"):
        fuse(dataclasses.replace(recording, clock="own", sphere_diameter_mm=25.4))


def test_the_sensors_scale_of_a_calibration_is_taken_out(recording: Recording, tmp_path: Path) -> None:
    path = tmp_path / "handeye.json"
    pose = np.eye(4).tolist()
    path.write_text(json.dumps({"flange_from_profiler": pose, "sensor_scale": [1, 1.08], "sensor_middle_mm": [5, 140]}))
    order = np.argsort(recording.pass_index, kind="stable")
    cloud = fuse(recording, hand_eye=path)
    np.testing.assert_array_equal(cloud.x_mm, recording.x_mm[order])
    np.testing.assert_allclose(cloud.z_mm, 140 + (recording.z_mm[order] - 140) / 1.08, rtol=1e-6)


@pytest.mark.parametrize("seed", range(2))
def test_poses_far_apart_say_how_uncertain_the_frames_between_them_are(recording: Recording, seed: int) -> None:
    """Errors of 0.03 mm and 0.02 deg in poses 5 mm apart; an arc that leaves the chord between them by 0.02 mm."""
    rng, count = np.random.default_rng(seed), 200
    along = 5.0 * np.arange(count)
    line, radius = np.stack([along, 0 * along, 0 * along], axis=1), 5.0**2 / (8 * 0.02)
    arc = radius * np.stack([np.sin(along / radius), np.cos(along / radius), 0 * along], axis=1)
    still = Rotation.from_rotvec([0.3, 0.2, -0.5])

    def sparse(way: Float, noise_mm: float, noise_deg: float) -> tuple[float, float]:
        turns = Rotation.from_rotvec(np.radians(rng.normal(0.0, noise_deg, (count, 3)))) * still
        return sparse_u(way + rng.normal(0.0, noise_mm, (count, 3)), turns)

    def sparse_u(way: Float, turns: Rotation) -> tuple[float, float]:
        moved = dataclasses.replace(
            recording,
            time_s=np.linspace(along[0], along[-1], len(recording.time_s)),
            pass_index=np.zeros(len(recording.time_s), np.int64),
            robot_position_mm=way + np.array([1000.0, 0.0, 500.0]),
            robot_quaternion_wxyz=turns.as_quat()[:, [3, 0, 1, 2]],
            robot_time_s=along,
            robot_pass=np.zeros(count, np.int64),
        )
        return fuse(moved).sparse_poses_u

    place, turn = sparse(line, 0.03, 0.02)
    assert place == pytest.approx(0.03, rel=0.2)
    assert np.degrees(turn) == pytest.approx(0.02, rel=0.2)
    assert sparse(arc, 0.0, 0.0)[0] == pytest.approx(0.02 * np.sqrt(8 / 15) / np.sqrt(2), rel=0.1)
    assert sparse(0.2 * line, 0.03, 0.02) == (0.0, 0.0)
    ring = (
        Rotation.from_rotvec(np.outer(along / radius, [0.0, 0.0, -1.0])) * still
    )  # the flange goes round with the arc
    assert sparse_u(arc, ring)[1] < 1e-9
