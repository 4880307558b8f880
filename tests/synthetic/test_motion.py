"""Poses and frames in time. That fused points lie on the part: tests/laws/test_exact.py."""

from __future__ import annotations

import numpy as np
import pytest

from workbench.synthetic import parse_recipe, simulate_recording


@pytest.mark.parametrize("motion", ["stream", "stop_and_go", "two_poses"])
@pytest.mark.parametrize("rate", [25, 250])
def test_frames_lie_within_the_pose_times(motion, rate):
    recipe = {
        "seed": 4,
        "part": {"length_mm": 60},
        "scanner": {"columns": 200, "pitch_mm": 0.15},
        "robot": {"frame_pitch_mm": 1.0, "pose_rate_hz": rate, "clock_jitter_s": 0.01},
        "passes": [{"from_mm": 3, "to_mm": 57, "motion": motion}],
    }
    recording, _ = simulate_recording(parse_recipe(recipe))
    assert np.all(np.diff(recording.time_s) > 0)
    assert np.all(np.diff(recording.robot_time_s) > 0)
    assert recording.robot_time_s[0] <= recording.time_s[0] < recording.time_s[-1] <= recording.robot_time_s[-1]
