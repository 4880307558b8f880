"""Poses: noise-free returns, fused by the recording's own conventions, lie on the analytic surface."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation, Slerp

from workbench.synthetic import parse_recipe, raycast, simulate_recording
from workbench.synthetic.workpiece import build_surface, pose

EXACT = {"noise": {"sd_mm": 0}, "columns": 200, "pitch_mm": 0.15}
PART = {
    "length_mm": 60,
    "thickness_mm": {"start": 8, "end": 8.3},
    "root_mm": {"start": 1.3, "end": 1.8, "amplitude": 0.1, "wavelength_mm": 40},
    "bevel_deg": {"start": 38.0, "end": 41, "amplitude": 0.5, "wavelength_mm": 70},
    "base_from_part": {"position_mm": [1300, -700, 900], "rpy_deg": [130, 40, -70]},
}
ARC = {"shape": "arc", "radius_mm": 300}
WAVE = {"shape": "wavy", "wavelength_mm": 120}


def recipe_of(part=None, scan=None, scanner=None, robot=None, **more):
    return parse_recipe(
        {
            "seed": 4,
            "part": PART | (part or {}),
            "scanner": EXACT | (scanner or {}),
            "robot": {"frame_pitch_mm": 1.0} | (robot or {}),
            "passes": [{"from_mm": 3, "to_mm": 57} | (scan or {})],
            **more,
        }
    )


def base_points(recording):
    """Position linear, orientation slerp, base_from_flange @ flange_from_profiler (docs/conventions.md); one pass."""
    time, poses = recording.time_s, recording.robot_time_s
    turn = Slerp(poses, Rotation.from_quat(recording.robot_quaternion_wxyz, scalar_first=True))(time).as_matrix()
    flange = np.tile(np.eye(4), (len(time), 1, 1))
    flange[:, :3, :3] = turn
    flange[:, :3, 3] = np.stack([np.interp(time, poses, p) for p in recording.robot_position_mm.T], axis=1)
    profiler = flange @ recording.flange_from_profiler
    x, z = recording.x_mm[..., None].astype(float), recording.z_mm[..., None].astype(float)
    return profiler[:, None, :3, 0] * x + profiler[:, None, :3, 2] * z + profiler[:, None, :3, 3]


def distances(recipe, points):
    """Distance from the body's surface, and face, of base points (n, 3)."""
    surface, part_from_base = build_surface(recipe.part), np.linalg.inv(pose(recipe.part.base_from_part))
    found = []
    for x, y, z in points @ part_from_base[:3, :3].T + part_from_base[:3, 3]:
        u, h, *_ = raycast.project(surface, x, y)
        found.append(raycast.body(surface, u, h, z)[:2])
    return np.array(found).T


@pytest.mark.parametrize(
    ("part", "scan", "scanner"),
    [
        ({}, {"oblique_deg": 15, "lead_deg": -8, "turn_deg": [2, 3, -2], "skew_mm": [-2, 2]}, {}),
        ({}, {}, {"z_away": False, "zero_range_mm": 170, "x_offset_mm": 7}),
        ({"end_face_tilt_deg": 5}, {"elevation_deg": -30}, {"x_rises": False, "z_away": False, "beam": "parallel"}),
        ({"curve": ARC}, {"motion": "stream", "follow": "edge"}, {"sampling": "angular", "z_away": False}),
        ({"curve": ARC | {"sense": "concave"}}, {"motion": "stop_and_go", "follow": "edge", "elevation_deg": 60}, {}),
        ({"curve": WAVE}, {"motion": "stream"}, {}),
    ],
)
def test_fused_points_lie_on_the_part(part, scan, scanner):
    recipe = recipe_of(part, scan, scanner, robot={"pose_rate_hz": 25, "frame_rate_hz": 10})  # 10 mm/s
    recording, truth = simulate_recording(recipe)
    points = base_points(recording)[np.isfinite(recording.z_mm)]
    gap, faces = distances(recipe, points[::5])
    assert np.abs(gap).max() < 1e-3
    assert {raycast.ROOT, raycast.BEVEL} <= set(faces)
    assert truth.seen.mean() > 0.8


@pytest.mark.parametrize("motion", ["stream", "stop_and_go", "two_poses"])
@pytest.mark.parametrize("rate", [25, 250])
def test_frames_lie_within_the_pose_times(motion, rate):
    robot = {"pose_rate_hz": rate, "clock_jitter_s": 0.01}
    recording, _ = simulate_recording(recipe_of(scan={"motion": motion}, robot=robot))
    assert np.all(np.diff(recording.time_s) > 0)
    assert np.all(np.diff(recording.robot_time_s) > 0)
    assert recording.robot_time_s[0] <= recording.time_s[0] < recording.time_s[-1] <= recording.robot_time_s[-1]
