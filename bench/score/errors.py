"""Errors of sensor and robot that are added to any simulator's recording."""

from __future__ import annotations

from typing import Any

import numpy as np

from bench.recordings import told, with_values
from workbench.artefacts import Recording
from workbench.scan.fuse_stage import flange_poses
from workbench.units import Float

LINEARITY_UM = 1.0  # rms of what a data sheet allows
SLOW_MM = (8.0, 60.0)  # wavelengths of it over columns and range
GRID_MM = 0.25  # on which a robot's error is drawn


def with_linearity(recording: Recording, rng: np.random.Generator) -> Recording:
    """Ranges off by a field over the measuring window that is the same in every frame."""
    x, z = recording.x_mm.astype(float), recording.z_mm.astype(float)
    wave = 2.0 * np.pi / rng.uniform(*SLOW_MM, (6, 1, 1)) * rng.choice([-1.0, 1.0], (6, 1, 1))
    turn, phase = rng.uniform(0.0, np.pi, (6, 1, 1)), rng.uniform(0.0, 2.0 * np.pi, (6, 1, 1))
    field = np.zeros_like(z)
    for k, a, p in zip(wave.ravel(), turn.ravel(), phase.ravel(), strict=True):
        field += np.cos(k * (np.cos(a) * x + np.sin(a) * z) + p)
    field *= LINEARITY_UM / 1e3 / np.sqrt(3.0)  # six cosines have variance 3
    return with_values(recording, z_mm=(z + field).astype(np.float32))


def with_robot_error(recording: Recording, rng: np.random.Generator, strength_mm: float, length_mm: float) -> Recording:
    """Recorded positions off by a Gaussian process along the way: one pose per frame, each axis for itself."""
    poses = flange_poses(recording)
    place = poses[:, :3, 3].copy()
    for number in np.unique(recording.pass_index):
        mine = recording.pass_index == number
        way = np.concatenate([[0.0], np.linalg.norm(np.diff(place[mine], axis=0), axis=1).cumsum()])
        place[mine] += strength_mm * process(rng, way, length_mm)
    return told(recording, place, poses[:, :3, :3])


def process(rng: np.random.Generator, way_mm: Float, length_mm: float) -> Float:
    """Three (n, 3) processes of unit variance at places along a way; correlation exp(-(d / length)^2 / 2)."""
    step = max(GRID_MM, length_mm / 8.0)
    reach = int(np.ceil(4.0 * length_mm / step))
    kernel = np.exp(-((np.arange(-reach, reach + 1) * step / length_mm) ** 2))
    count = int(np.ceil(way_mm[-1] / step)) + 2
    white = rng.normal(size=(count + 2 * reach, 3))
    smooth: Any = np.stack([np.convolve(column, kernel, mode="valid") for column in white.T], axis=1)
    smooth /= np.sqrt((kernel**2).sum())
    return np.stack([np.interp(way_mm, np.arange(count) * step, column[:count]) for column in smooth.T], axis=1)


def robot(rng: np.random.Generator, low_mm: float, high_mm: float) -> tuple[float, float]:
    """Strength and length, mm, as robots have them."""
    return float(rng.uniform(low_mm, high_mm)), float(np.exp(rng.uniform(0.0, np.log(40.0))))


def as_real(
    recording: Recording, rng: np.random.Generator, low_mm: float, high_mm: float
) -> tuple[Recording, dict[str, Any]]:
    """A recording with both, and what a user knows of them: the data sheets."""
    strength, length = robot(rng, low_mm, high_mm)
    made = with_robot_error(with_linearity(recording, rng), rng, strength, length)
    sheet = {"linearity_mm": LINEARITY_UM / 1e3, "linearity_length_mm": SLOW_MM[0]}
    known = {
        "sensor": sheet,
        "robot_noise_mm": digit(strength),
        "robot_noise_length_mm": digit(length),
    }
    return made, known


def digit(value: float) -> float:
    """As a data sheet says it."""
    return float(f"{value:.1g}")


def about_robot(known: dict[str, Any]) -> str:
    """For who reads of a part."""
    return f"robot {known['robot_noise_mm']:g} mm over {known['robot_noise_length_mm']:g} mm"
