"""Sphere recordings by formula: the laser plane cuts the sphere exactly; poses and points get their noise."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from bench.calibration.faces import TRUE, built
from bench.drawn.spheres import random_sphere_recipe
from workbench.api import Recording, pose_from
from workbench.synthetic import SphereTruth, parse_sphere_recipe, simulate_sphere

RADIUS = 5.0
COLUMNS, PITCH_MM = 1200, 0.05  # of a profile
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


def drawn(condition: str, seed: int, /, **changes: Any) -> tuple[Recording, SphereTruth]:
    """A drawn recording of the package's simulator, keys of its recipe changed, and the truth."""
    document = random_sphere_recipe(condition, seed).model_dump(mode="json")
    for key, value in changes.items():
        document[key] = document[key] | value if isinstance(value, dict) else value
    return simulate_sphere(parse_sphere_recipe(document))
