"""Sphere recordings by formula: the laser plane cuts the sphere exactly; poses and points get their noise."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from bench.calibration.faces import TRUE, built
from workbench.api import Recording, pose_from

RADIUS = 5.0
COLUMNS, PITCH_MM = 1200, 0.05  # of a profile
MARGIN_S, POSE_MM, POSE_DEG = 0.3, 0.07, 0.01  # of a scan: poses before and after it, their noise
CENTER = np.array([1890.33, 241.48, 1079.72])
NOMINAL = Rotation.from_euler("ZYX", [20.0, 65.0, 10.0], degrees=True)


@dataclass
class Cell:
    """A simulated set of postures: true and recorded poses, sphere centres in the profiler frame, circles."""

    true_poses: Any  # (k, 4, 4)
    poses: Any  # (k, 4, 4) as recorded
    centre: Any  # (k, 3) true
    radius: float = RADIUS


def postures(rng: np.random.Generator, k: int, turn_deg: float = 25.0, off_plane: float = 1.5) -> tuple[Any, Any]:
    """k random flange orientations (k, 3, 3) and sphere centres in the profiler frame (k, 3)."""
    turns = Rotation.from_rotvec(rng.uniform(-1, 1, (k, 3)) * np.radians(turn_deg)) * NOMINAL
    h = rng.uniform(off_plane, 0.85 * RADIUS, k) * rng.choice([-1.0, 1.0], k)
    centre = np.column_stack([rng.uniform(-10, 10, k), h, rng.uniform(-15, 15, k)])
    return turns.as_matrix(), centre


def cell(rng: np.random.Generator, turns: Any, centre: Any, pose_mm: float = 0.07, pose_deg: float = 0.01) -> Cell:
    """Poses that bring the sphere's centre to `centre` in the profiler frame, and what the robot says of them."""
    k = len(turns)
    position = CENTER - np.einsum("kij,kj->ki", turns, centre @ TRUE[:3, :3].T + TRUE[:3, 3])
    noise = Rotation.from_rotvec(rng.normal(0, np.radians(pose_deg), (k, 3)))
    recorded = (Rotation.from_matrix(turns) * noise).as_matrix()
    return Cell(pose_from(turns, position), pose_from(recorded, position + rng.normal(0, pose_mm, (k, 3))), centre)


def profile(
    rng: np.random.Generator,
    center: Any,
    radius: float = RADIUS,
    *,
    noise_mm: float = 0.015,
    sense: int = -1,
    background: bool = False,
    outliers: float = 0.0,
) -> Any:
    """x, z (COLUMNS,) of one profile: the sphere about `center` in the profiler frame, from the side of the sense.

    `background`: a tilted table below; `outliers`: share of points that lie anywhere.
    """
    x = (np.arange(COLUMNS) - COLUMNS / 2) * PITCH_MM
    q2 = radius**2 - center[1] ** 2 - (x - center[0]) ** 2
    steep = q2 > 0.03 * (radius**2 - center[1] ** 2)
    z = np.full(COLUMNS, np.nan)
    z[steep] = center[2] + sense * np.sqrt(q2[steep])
    if background:
        table = ~(q2 > 0)
        z[table] = center[2] - sense * (radius + 12.0) + 0.08 * x[table]
    z += rng.normal(0, noise_mm, COLUMNS)
    stray = rng.random(COLUMNS) < outliers
    z[stray] = center[2] + rng.uniform(-25, 25, stray.sum())
    return x, z


def recording(rng: np.random.Generator, made: Cell, design: Any = TRUE, **how: Any) -> Recording:
    """A calibration recording of postures held still, one frame each."""
    grids = [profile(rng, c, made.radius, **how) for c in made.centre]
    return built(made.poses, grids, source="sphere.h5", flange_from_profiler=design, sphere_diameter_mm=2 * RADIUS)


def off_design(rng: np.random.Generator, turn_deg: float = 20.0, shift_mm: float = 50.0) -> Any:
    """The true hand-eye pose, wrong by so much in a random direction."""
    axis, way = (v / np.linalg.norm(v) for v in rng.normal(size=(2, 3)))
    turn = Rotation.from_rotvec(axis * np.radians(turn_deg)).as_matrix()
    return pose_from(turn @ TRUE[:3, :3], TRUE[:3, 3] + shift_mm * way)


def edited(row: str, labels: int, change: Any) -> str:
    """A row of a table with `change` of the numbers behind its labels."""
    cells = row.split(",")
    values = change(np.array([float(cell) for cell in cells[labels:]]))
    return ",".join([*cells[:labels], *(f"{v:.9f}" for v in values)])


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(7)


@dataclass
class Scan:
    """One scan: the flange's true motion p(t), t in [0, seconds], sphere centre along `path` in the profiler frame."""

    turn: Any  # (3, 3) flange orientation
    start: Any  # (3,) sphere centre in the profiler frame
    end: Any
    seconds: float = 1.0
    weave_deg: float = 0.0  # amplitude of a swing about two axes, once and twice a scan


def scan_motion(scan: Scan, time: Any) -> tuple[Any, Any]:
    """True flange orientations (k, 3, 3) and positions (k, 3) at times (k,); the motion goes on beyond its ends."""
    phase = 2 * np.pi * time[:, None] / scan.seconds
    swing = np.radians(scan.weave_deg) * (np.sin(2 * phase) * [0.3, 0.4, 0.87] + np.sin(phase + 1) * [0.0, 0.9, -0.4])
    turn = scan.turn @ Rotation.from_rotvec(swing).as_matrix()
    f = (time / scan.seconds)[:, None]
    centre = (1 - f) * scan.start + f * scan.end
    if scan.weave_deg:  # sideways too
        centre = centre + 4.0 * np.sin(2 * np.pi * f * 1.5) * [1.0, 0.0, 1.0]
    flange = centre @ TRUE[:3, :3].T + TRUE[:3, 3]
    return turn, CENTER - (turn @ flange[..., None])[..., 0]


def scan_recording(
    rng: np.random.Generator,
    scans: Any,
    offset_s: float = 0.0,
    own: bool = True,
    frames: int = 50,
    rate_hz: float = 25.0,
    design: Any = TRUE,
) -> Recording:
    """A calibration recording of scans over the sphere, poses at `rate_hz`, profiles on a clock ahead by `offset_s`."""
    grids: list[tuple[Any, Any]] = []
    said, of_frames, of_poses = [], [], []
    for number, scan in enumerate(scans):
        time = np.linspace(0, scan.seconds, frames)
        turn, position = scan_motion(scan, time)
        centre = np.einsum("kji,kj->ki", turn, CENTER - position)
        centre = (centre - TRUE[:3, 3]) @ TRUE[:3, :3]
        blind = np.zeros(COLUMNS), np.full(COLUMNS, np.nan)
        grids += [profile(rng, c) if abs(c[1]) < RADIUS - 0.05 else blind for c in centre]
        poses = np.arange(-MARGIN_S, scan.seconds + MARGIN_S + 1e-9, 1 / rate_hz)
        turn, position = scan_motion(scan, poses)
        noisy = Rotation.from_matrix(turn) * Rotation.from_rotvec(rng.normal(0, np.radians(POSE_DEG), (len(poses), 3)))
        said.append(pose_from(noisy.as_matrix(), position + rng.normal(0, POSE_MM, position.shape)))
        begin = 10.0 * number
        of_frames.append((begin + time + offset_s, np.full(frames, number)))
        of_poses.append((begin + poses, np.full(len(poses), number)))
    (time_s, passes), (robot_time_s, robot_pass) = (
        [np.concatenate(part) for part in zip(*every, strict=True)] for every in (of_frames, of_poses)
    )
    return built(
        np.concatenate(said),
        grids,
        source="scans.h5",
        time_s=time_s,
        pass_index=passes,
        robot_time_s=robot_time_s,
        robot_pass=robot_pass,
        flange_from_profiler=design,
        sphere_diameter_mm=2 * RADIUS,
        clock="own" if own else "robot",
    )


def scans_over(rng: np.random.Generator, count: int = 6, turn_deg: float = 25.0, weave_deg: float = 0.0) -> list[Scan]:
    """Scans in several orientations, to and fro across the laser plane."""
    turns, centre = postures(rng, count, turn_deg)
    out = []
    for i in range(count):
        way = np.array([rng.uniform(-2, 2), (-1) ** i * 5.5, rng.uniform(-2, 2)])
        middle = centre[i] * [1.0, 0.0, 1.0]
        out.append(Scan(turns[i], middle - way, middle + way, weave_deg=weave_deg))
    return out
