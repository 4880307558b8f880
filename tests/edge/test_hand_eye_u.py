"""What an uncertain hand-eye pose does to a raw edge's place and direction, against drawn hand-eye errors."""

from __future__ import annotations

import dataclasses

import numpy as np
from scipy.spatial.transform import Rotation

from bench.drawn.plates import random_recipe
from bench.recordings import frames
from workbench.artefacts import Edge, Recording
from workbench.edge import segment_raw
from workbench.scan import fuse
from workbench.synthetic import simulate_recording
from workbench.units import DEG, Float

SIGMA = np.array([0.2, 0.1, 0.3, 0.05 * DEG, 0.1 * DEG, 0.02 * DEG])  # mm and rad, in the flange
CORRELATED = np.outer(SIGMA, SIGMA) * (0.5 * np.eye(6) + 0.5)


def edge_of(recording: Recording, error: Float, upper_side: Float) -> Edge:
    """The edge with a hand-eye pose that is wrong by `error` (6,): R_true = exp(w) R, in the flange."""
    assert recording.flange_from_profiler is not None
    pose = recording.flange_from_profiler.copy()
    pose[:3, 3] += error[:3]
    pose[:3, :3] = Rotation.from_rotvec(error[3:]).as_matrix() @ pose[:3, :3]
    cloud = fuse(dataclasses.replace(recording, flange_from_profiler=pose))
    side = tuple(float(v) for v in upper_side)
    return segment_raw(dataclasses.replace(cloud, hand_eye_covariance=CORRELATED), upper_side=side)


def test_place_and_direction_scatter_as_stated() -> None:
    recording, truth = simulate_recording(random_recipe("raw_arc", 31))
    recording = frames(recording, np.arange(0, len(recording.time_s), 3))
    stated = edge_of(recording, np.zeros(6), truth.across[0])
    assert stated.hand_eye_u_mm is not None
    k = len(stated.arc_length_mm) // 2
    rng = np.random.default_rng(31)
    off = []
    for error in rng.multivariate_normal(np.zeros(6), CORRELATED, size=10):
        moved = edge_of(recording, error, truth.across[0])
        near = np.argmin(np.linalg.norm(moved.position_mm - stated.position_mm[k], axis=1))
        gap = moved.position_mm[near] - stated.position_mm[k]
        turn = np.arcsin(np.clip(moved.normal[near] @ stated.across[k], -1, 1))
        off.append([gap @ stated.normal[k], gap @ stated.across[k], turn])
    z = np.array(off) / [*stated.hand_eye_u_mm[k], stated.normal_u[k]]
    rms = np.sqrt(np.mean(z**2, axis=0))
    assert ((rms > 0.55) & (rms < 1.5)).all(), rms  # 10 draws: rms of 1 +- 0.22
    assert segment_raw(fuse(recording), upper_side=tuple(truth.across[0].tolist())).hand_eye_u_mm is None  # told none
