"""Recordings of a fixed part with flat faces, by formula."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from workbench.api import DEG, Float, HandEye, Recording, pose_from, vector_from_rotation

TRUE = pose_from(
    Rotation.from_euler("ZYX", [60.489, -3.813, -2.024], degrees=True).as_matrix(), np.array([126.92, 9.44, 41.48])
)  # the paper's
CORNER = np.array([1890.0, 240.0, 1080.0])  # on the edge
ALONG = np.array([0.2, 1.0, 0.1]) / np.linalg.norm([0.2, 1.0, 0.1])
ACROSS = np.array([np.cross(ALONG, v) for v in ([1.0, 0.0, 0.6], [-1.0, 0.1, 0.8])])
NORMALS = ACROSS / np.linalg.norm(ACROSS, axis=1)[:, None]
COLUMNS, PITCH_MM, NOISE_MM = 400, 0.1, 0.015
POSE_MM, POSE_DEG = 0.07, 0.01
SCAN_S = 20.0


def postures(rng: np.random.Generator, k: int, turn_deg: float = 25.0) -> Float:
    """k poses (k, 4, 4) of the flange from which the edge is in view, within `turn_deg` about each axis."""
    middle = Rotation.from_matrix(np.stack([np.cross(ALONG, [0, 0, -1.0]), ALONG, [0, 0, -1.0]], axis=1))
    base = middle * Rotation.from_matrix(TRUE[:3, :3].T)
    turns = (Rotation.from_rotvec(rng.uniform(-1, 1, (k, 3)) * turn_deg * DEG) * base).as_matrix()
    at = np.column_stack([rng.uniform(-5, 5, k), np.zeros(k), rng.uniform(80, 110, k)])
    target = CORNER + rng.uniform(-60, 60, k)[:, None] * ALONG
    return pose_from(turns, target - np.einsum("kij,kj->ki", turns, at @ TRUE[:3, :3].T + TRUE[:3, 3]))


def profile(rng: np.random.Generator, pose: Float, faces: int) -> tuple[Float, Float]:
    """x and z (COLUMNS,): of each x the nearer of the faces in the laser plane."""
    x = (np.arange(COLUMNS) - COLUMNS / 2) * PITCH_MM
    inverse = np.linalg.inv(pose @ TRUE)
    corner, every = inverse[:3, :3] @ CORNER + inverse[:3, 3], NORMALS[:faces] @ inverse[:3, :3].T
    z = np.max([(n @ corner - n[0] * x) / n[2] for n in every], axis=0)
    return x, z + rng.normal(0, NOISE_MM, COLUMNS)


def corner_points(rng: np.random.Generator, pose: Float) -> tuple[Float, Float]:
    """x and z (2,) of where two lines, parallel to the edge and 12 mm apart, pass the laser plane."""
    inverse = np.linalg.inv(pose @ TRUE)
    along = inverse[:3, :3] @ ALONG
    places = [CORNER, CORNER + 12.0 * NORMALS[0] + 3.0 * NORMALS[1]]
    found = [p - p[1] / along[1] * along for p in (inverse[:3, :3] @ one + inverse[:3, 3] for one in places)]
    at = np.array(found)[:, [0, 2]] + rng.normal(0, NOISE_MM, (2, 2))
    return at[:, 0], at[:, 1]


def recorded(rng: np.random.Generator, poses: Float, grids: list[tuple[Float, Float]], **fields: Any) -> Recording:
    """As `built`, of true poses: the robot says them with its noise."""
    noise = Rotation.from_rotvec(rng.normal(0, POSE_DEG * DEG, (len(poses), 3)))
    turned = (Rotation.from_matrix(poses[:, :3, :3]) * noise).as_matrix()
    return built(pose_from(turned, poses[:, :3, 3] + rng.normal(0, POSE_MM, (len(poses), 3))), grids, **fields)


def built(poses: Float, grids: list[tuple[Float, Float]], **fields: Any) -> Recording:
    """A recording of postures held still, a frame each; or with `fields` instead. Poses as the robot says them."""
    k = np.arange(len(poses))
    given: dict[str, Any] = {
        "source": "edge.h5",
        "time_s": 1.0 * k,
        "x_mm": np.array([x for x, _ in grids], np.float32),
        "z_mm": np.array([z for _, z in grids], np.float32),
        "pass_index": k,
        "robot_time_s": 1.0 * k,
        "robot_position_mm": poses[:, :3, 3],
        "robot_quaternion_wxyz": Rotation.from_matrix(poses[:, :3, :3]).as_quat(scalar_first=True),
        "robot_pass": k,
    }
    return Recording(**(given | fields))


def still(rng: np.random.Generator, k: int, faces: int = 2, **fields: Any) -> Recording:
    """k postures that see an edge (two faces), or one plane."""
    poses = postures(rng, k)
    return recorded(rng, poses, [profile(rng, pose, faces) for pose in poses], **fields)


def tracked(rng: np.random.Generator, offset_s: float) -> Recording:
    """A weaving scan along two lines by a seam tracker, whose clock is ahead by `offset_s`."""
    knots = postures(rng, 2, 0.0)[:1]

    def at(time: Float) -> Float:
        swing = 20.0 * DEG * np.sin(2 * np.pi * time[:, None] * [0.13, 0.17, 0.11])
        turns = (Rotation.from_rotvec(swing) * Rotation.from_matrix(knots[:, :3, :3])).as_matrix()
        height = 95.0 + 12.0 * np.sin(2 * np.pi * 0.07 * time)
        seen = np.column_stack([8.0 * np.sin(2 * np.pi * 0.21 * time), 0.0 * time, height])
        target = CORNER + (40.0 * np.sin(2 * np.pi * 0.1 * time))[:, None] * ALONG
        return pose_from(turns, target - np.einsum("kij,kj->ki", turns, seen @ TRUE[:3, :3].T + TRUE[:3, 3]))

    frames, poses = np.arange(0.3, SCAN_S, 0.05), np.arange(0.0, SCAN_S + 0.3, 0.02)
    grids = [corner_points(rng, pose) for pose in at(frames)]
    return recorded(
        rng,
        at(poses),
        grids,
        time_s=frames + offset_s,
        pass_index=np.zeros(len(frames), int),
        robot_time_s=poses,
        robot_pass=np.zeros(len(poses), int),
        clock="own",
    )


def off(eye: HandEye) -> Float:
    """Truth less answer (6,): translation mm, rotation vector rad."""
    pose = eye.flange_from_profiler
    return np.concatenate([TRUE[:3, 3] - pose[:3, 3], vector_from_rotation(TRUE[:3, :3] @ pose[:3, :3].T)])


def squared(eye: HandEye) -> float:
    """Squared distance of a pose from the truth by its covariance: chi-square of six where that is right."""
    assert eye.covariance is not None
    return float(off(eye) @ np.linalg.solve(eye.covariance, off(eye)))
