"""What the robot errs by: noise of its poses and of the calibration in the record only, its smooth error in none."""

from __future__ import annotations

import numpy as np
import pytest

from workbench.synthetic import parse_recipe, simulate_recording


def simulated(**robot):
    return simulate_recording(
        parse_recipe(
            {
                "seed": 4,
                "part": {"length_mm": 60},
                "scanner": {"noise": {"sd_mm": 0}, "columns": 200, "pitch_mm": 0.15},
                "robot": {"frame_pitch_mm": 1.0} | robot,
                "passes": [{"from_mm": 3, "to_mm": 57, "motion": "stream"}],
            }
        )
    )


def test_pose_noise_and_hand_eye_error_are_in_the_record_only():
    exact, _ = simulated()
    noisy, truth = simulated(pose_noise_mm=0.05, hand_eye_error_mm=0.2, hand_eye_error_deg=0.1)
    assert np.array_equal(exact.z_mm, noisy.z_mm, equal_nan=True)
    assert np.std(noisy.robot_position_mm - exact.robot_position_mm) == pytest.approx(0.05, rel=0.15)
    offset = noisy.flange_from_profiler[:3, 3] - exact.flange_from_profiler[:3, 3]
    assert 0.02 < np.linalg.norm(offset) < 0.8
    assert np.array_equal(truth.document()["flange_from_profiler"], exact.flange_from_profiler)


def test_a_smooth_error_repeats_over_its_wavelength_and_is_in_no_pose():
    exact, erring = simulated()[0], simulated(smooth_error_mm=0.2, smooth_error_wavelength_mm=[20, 20])[0]
    np.testing.assert_array_equal(exact.robot_position_mm, erring.robot_position_mm)
    off = np.nanmedian(erring.z_mm - exact.z_mm, axis=1)  # a frame each mm
    assert 0.1 < np.abs(off).max() < 0.5
    np.testing.assert_allclose(off[20:], off[:-20], atol=0.01)
