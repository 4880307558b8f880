"""What an uncertain hand-eye pose does to a raw edge's place and direction, against hand-eye poses that are wrong."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from bench.drawn.plates import random_recipe
from bench.recordings import frames
from workbench.artefacts import Edge, Recording
from workbench.edge import segment_raw
from workbench.scan import fuse
from workbench.synthetic import simulate_recording
from workbench.units import DEG, Float

SIGMA = np.array([0.2, 0.1, 0.3, 0.05 * DEG, 0.1 * DEG, 0.02 * DEG])  # mm and rad, in the flange
ROOT = SIGMA[:, None] * np.random.default_rng(3).normal(size=(6, 3))  # of a covariance, all of it correlated


def edge_of(recording: Recording, error: Float, upper_side: Float) -> Edge:
    """The edge with a hand-eye pose that is wrong by `error` (6,): R_true = exp(w) R, in the flange."""
    assert recording.flange_from_profiler is not None
    pose = recording.flange_from_profiler.copy()
    pose[:3, 3] += error[:3]
    pose[:3, :3] = Rotation.from_rotvec(error[3:]).as_matrix() @ pose[:3, :3]
    cloud = fuse(dataclasses.replace(recording, flange_from_profiler=pose))
    side = tuple(float(v) for v in upper_side)
    return segment_raw(dataclasses.replace(cloud, hand_eye_covariance=ROOT @ ROOT.T), upper_side=side)


def test_place_and_direction_move_as_stated() -> None:
    """Once by each column of the covariance's root: squares of what these do add to that of any error drawn from it."""
    recording, truth = simulate_recording(random_recipe("raw_arc", 31))
    count = len(recording.time_s)
    recording = frames(recording, np.arange(count // 3, 2 * count // 3, 4))
    right = edge_of(recording, np.zeros(6), truth.across[0])
    assert right.hand_eye_u_mm is not None
    k = len(right.arc_length_mm) // 2
    off = []
    for error in ROOT.T:
        moved = edge_of(recording, error, truth.across[0])
        near = np.argmin(np.linalg.norm(moved.position_mm - right.position_mm[k], axis=1))
        gap = moved.position_mm[near] - right.position_mm[k]
        off.append([gap @ right.normal[k], gap @ right.across[k], moved.normal[near] @ right.across[k]])
    assert np.linalg.norm(off, axis=0) == pytest.approx([*right.hand_eye_u_mm[k], right.normal_u[k]], rel=0.1)
