"""An uncertain hand-eye pose counts in the bevel angle where the laser plane stands oblique to the edge."""

from __future__ import annotations

import dataclasses

import numpy as np
from scipy.spatial.transform import Rotation

from bench.drawn.plates import random_recipe
from workbench.cloud import denoise
from workbench.edge import segment
from workbench.inspect import sections
from workbench.scan import fuse
from workbench.synthetic import simulate_recording
from workbench.units import DEG, Float

SIGMA = 0.5 * DEG  # of the hand-eye rotation, an axis


def deviations(seed: int) -> tuple[Float, Float, Float]:
    """Errors of the bevel angle (deg) under a wrong hand-eye rotation, u that knows of it and u that does not."""
    recording, truth = simulate_recording(random_recipe("oblique", seed))
    turn = np.eye(4)
    turn[:3, :3] = Rotation.from_rotvec(np.random.default_rng(seed).normal(0, SIGMA, 3)).as_matrix()
    assert recording.flange_from_profiler is not None
    wrong = dataclasses.replace(recording, flange_from_profiler=turn @ recording.flange_from_profiler)
    cloud = denoise(fuse(wrong))
    errors, blind, aware = [], [], []
    for each, covariance in ((blind, None), (aware, np.diag([0.01] * 3 + [SIGMA**2] * 3))):
        for section in sections(segment(dataclasses.replace(cloud, hand_eye_covariance=covariance))).sections:
            if section.values["bevel_deg"] is not None and section.values["bevel_u_deg"] is not None:
                each.append(section.values["bevel_u_deg"])
                errors.append(section.values["bevel_deg"] - float(truth.bevel_deg_at(section.origin_mm)))
    return np.array(errors[: len(blind)]), np.array(aware), np.array(blind)


def test_what_the_calibration_leaves_open_counts_in_the_angle() -> None:
    error, aware, blind = (np.concatenate(part) for part in zip(*map(deviations, range(20, 22)), strict=True))
    assert (aware > blind).all()
    assert np.mean(np.abs(error) <= 2 * aware) > 0.85
    assert np.mean(np.abs(error) <= 2 * blind) < 0.6
