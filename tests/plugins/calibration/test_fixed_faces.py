"""Hand-eye poses from a straight edge, a plane and a tracker's points: against the truth, and against a sphere's."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from bench.calibration import faces
from bench.metrology import instruments
from tests.plugins.calibration import conftest as spheres
from workbench.api import InputError, pose_from
from workbench.plugins.calibration import circles, hand_eye, hand_eye_faces
from workbench.plugins.calibration.model import View, volume_u

REAL = Path(__file__).parents[4] / "shared" / "data" / "real"
FIELD = View((0.0, 95.0), (16.0, 20.0))


@pytest.mark.parametrize("target", ["edge", "plane"])
def test_errors_are_as_large_as_stated(target: Any) -> None:
    """Without a design's pose; chi-square of six has mean 6 and variance 12, 95 % lie below 12.6."""
    found = [instruments.measure(target, seed) for seed in range(8)]
    assert np.mean([one["covered"] for one in found]) >= 0.75
    assert abs(np.mean([one["nees"] for one in found]) - 6) < 3 * np.sqrt(12 / 8)


def test_an_edge_and_a_sphere_agree() -> None:
    """The same hand-eye pose by both, from data that share nothing: apart by what both state."""
    apart = []
    for seed in range(4):
        rng = np.random.default_rng(seed)
        ball = spheres.recording(rng, spheres.cell(rng, *spheres.postures(rng, 12)))
        by_ball = hand_eye(circles(ball), ball)[0]
        by_edge = hand_eye_faces(faces.still(rng, 16))[0]
        assert by_ball.covariance is not None
        assert by_edge.covariance is not None
        off = by_ball.flange_from_profiler @ np.linalg.inv(by_edge.flange_from_profiler)
        shift = by_ball.flange_from_profiler[:3, 3] - by_edge.flange_from_profiler[:3, 3]
        both = np.concatenate([shift, Rotation.from_matrix(off[:3, :3]).as_rotvec()])
        apart.append(float(both @ np.linalg.solve(by_ball.covariance + by_edge.covariance, both)))
    assert np.mean(apart) < 6 + 3 * np.sqrt(12 / 4)


def test_a_trackers_points_tell_the_clock_too() -> None:
    rng = np.random.default_rng(2)
    eye, document, chapter = hand_eye_faces(faces.tracked(rng, 0.025), target="points")
    assert faces.squared(eye) < 22.5  # 99.9 % of six
    said = json.loads(document.content)
    assert abs(said["time_offset_s"] - 0.025) < 3 * said["time_offset_u_s"]
    assert 0 < said["time_offset_u_s"] < 1e-3
    assert "clock" in chapter.html


def test_one_axis_of_turning_is_refused_by_name() -> None:
    rng = np.random.default_rng(3)
    poses = faces.postures(rng, 12, 0.0)
    turns = Rotation.from_rotvec(np.linspace(-0.4, 0.4, 12)[:, None] * faces.ALONG)
    lever = poses[:, :3, 3] - faces.CORNER
    poses = pose_from((turns * Rotation.from_matrix(poses[:, :3, :3])).as_matrix(), faces.CORNER + turns.apply(lever))
    made = faces.recorded(rng, poses, [faces.profile(rng, pose, 1) for pose in poses])
    with pytest.raises(InputError, match=r"do not determine the|explain the profiles equally"):
        hand_eye_faces(made, target="plane")


def test_too_few_postures_are_refused() -> None:
    made = faces.still(np.random.default_rng(4), 3)
    with pytest.raises(InputError, match="at least 4 distinct postures that see the edge, found 3"):
        hand_eye_faces(made)


def test_a_wrong_posture_is_left_out_and_named() -> None:
    made = faces.still(np.random.default_rng(6), 16)
    position = made.robot_position_mm.copy()
    position[5] += [0.0, 4.0, 3.0]
    eye, document, _ = hand_eye_faces(replace(made, robot_position_mm=position))
    assert [one["frame"] for one in json.loads(document.content)["frames_rejected"]] == [5]
    assert faces.squared(eye) < 22.5


def test_more_postures_tell_more() -> None:
    few, many = (hand_eye_faces(faces.still(np.random.default_rng(7), k))[0] for k in (10, 30))
    assert few.covariance is not None
    assert many.covariance is not None
    turn = few.flange_from_profiler[:3, :3]
    assert volume_u(many.covariance, turn, FIELD) < volume_u(few.covariance, turn, FIELD)


def test_a_simulation_by_others() -> None:
    """LVS_ST_CALIB: poses as logarithms, points of two lines; true are (10, 20, 30) mm, no turn, 12 ms (frame 0)."""
    folder = REAL / "weld_line"
    if not folder.is_dir():
        pytest.skip("others' files are not here")
    poses, seen = np.loadtxt(folder / "egm.txt"), np.loadtxt(folder / "cam.txt")[::50]
    turn, along = poses[:, 1:4], poses[:, 4:]
    angle = np.maximum(np.linalg.norm(turn, axis=1)[:, None], 1e-9)
    once = np.cross(turn, along)
    place = along + (1 - np.cos(angle)) / angle**2 * once
    place = place + (angle - np.sin(angle)) / angle**3 * np.cross(turn, once)
    made = faces.recorded(
        np.random.default_rng(0),
        np.tile(np.eye(4), (len(poses), 1, 1)),
        [(row[[2, 5]], row[[3, 6]]) for row in seen],
        time_s=seen[:, 0] / 1e3,
        pass_index=np.zeros(len(seen), int),
        robot_time_s=poses[:, 0] / 1e3,
        robot_position_mm=place,
        robot_quaternion_wxyz=Rotation.from_rotvec(turn).as_quat(scalar_first=True),
        robot_pass=np.zeros(len(poses), int),
        clock="own",
    )
    eye, document, _ = hand_eye_faces(made, target="points", profile_noise_mm=0.03)
    truth = np.array([[0, -1, 0, 10.0], [1, 0, 0, 20.0], [0, 0, 1, 30.0], [0, 0, 0, 1]])
    assert eye.covariance is not None
    off = Rotation.from_matrix(truth[:3, :3] @ eye.flange_from_profiler[:3, :3].T).as_rotvec()
    error = np.concatenate([truth[:3, 3] - eye.flange_from_profiler[:3, 3], off])
    assert error @ np.linalg.solve(eye.covariance, error) < 22.5
    said = json.loads(document.content)
    assert abs(said["time_offset_s"] - 0.012) < 3 * said["time_offset_u_s"]
