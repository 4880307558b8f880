"""Validation on held-out postures tells a wrong calibration where the spread of fitted centres does not."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from bench.drawn.spheres import random_sphere_recipe
from tests.plugins.calibration.conftest import drawn
from workbench.api import HandEye
from workbench.plugins.calibration import circles, hand_eye, validate

OTHER = {"center_mm": [900.0, -400.0, 700.0]}


def calibrated(seed, /, **changes):
    recording, _ = drawn("sphere_nine", seed, **changes)
    recording = dataclasses.replace(recording, source=f"{seed}-{sorted(changes)}")
    return circles(recording), recording


def test_held_out_errors_are_as_large_as_expected():
    misfits, ratios = [], []
    for seed in range(8):
        profiles, recording = calibrated(seed)
        found, _ = validate(hand_eye(profiles, recording)[1], profiles, recording)
        misfits.append(found.misfit)
        ratios.append(found.rms_mm / found.expected_mm)
    assert np.mean(misfits) == pytest.approx(1.0, abs=0.25)
    assert np.mean(ratios) == pytest.approx(1.0, abs=0.15)


def second_recording(seed):
    """The calibration of one recording, and another of the same profiler, with its sphere elsewhere."""
    profiles, recording = calibrated(seed)
    more = random_sphere_recipe("sphere_nine", seed + 100).model_dump(mode="json")
    return hand_eye(profiles, recording)[1], calibrated(seed, sphere=OTHER, passes=more["passes"], seed=seed + 100)


def test_a_second_recording_agrees():
    misfits = []
    for seed in range(4):
        calibration, (profiles, recording) = second_recording(seed)
        found, _ = validate(calibration, profiles, recording)
        assert "second recording" in found.how
        misfits.append(found.misfit)
    assert np.mean(misfits) == pytest.approx(1.0, abs=0.3)


def test_a_second_recording_shows_a_profiler_that_was_knocked():
    calibration, (profiles, recording) = second_recording(1)
    pose = calibration.hand_eye.flange_from_profiler.copy()
    pose[:3, 3] += [1.0, 1.0, -1.0]
    moved = dataclasses.replace(calibration, hand_eye=HandEye(pose, source=calibration.hand_eye.source))
    assert validate(moved, profiles, recording)[0].misfit > 3
