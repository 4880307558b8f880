"""Hand-eye poses from a straight edge, a plane and a tracker's points: against the truth, and against a sphere's."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from bench.calibration import faces
from tests.seldom import seldom
from workbench.api import InputError, pose_from
from workbench.plugins.calibration import hand_eye_faces

MADE = {  # recordings of a part with two faces in view, with one, and of lines across a seam tracker
    "edge": lambda rng: faces.still(rng, 16),
    "plane": lambda rng: faces.still(rng, 16, 1),
    "points": lambda rng: faces.tracked(rng, 0.025),
}


@pytest.mark.parametrize("target", ["edge", *seldom("plane", "points")])
def test_errors_are_as_large_as_stated(target: Any) -> None:
    """Two without a design's pose; chi-square of six has mean 6 and variance 12, 95 % lie below 12.6."""
    design = {"flange_from_profiler": faces.TRUE}
    made = [replace(MADE[target](np.random.default_rng(k)), **design if k > 1 else {}) for k in range(12)]
    found = np.array([faces.squared(hand_eye_faces(one, target=target, max_u_mm=3.0)[0]) for one in made])
    assert np.sum(found < 12.6) >= 9
    assert abs(np.mean(found) - 6) < 3 * np.sqrt(12 / len(found))


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
