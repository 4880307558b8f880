"""Recordings of what is no bevel: domes, bars, cables, grooves, steps, sheets, tables, nothing at all."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from workbench.artefacts import Recording
from workbench.geometry.poses import pose_from, quaternion_from_rotation
from workbench.units import Float

COLUMNS, PITCH_MM, FRAMES, STEP_MM, NOISE_MM = 500, 0.08, 200, 0.5, 0.012
STANDOFF_MM = 150.0

Shape = Callable[[np.random.Generator, Float, Float], Float]  # heights over x (1, M), at places along the scan (N, 1)


def _dome(rng: np.random.Generator, x: Float, y: Float) -> Float:
    radius, base = rng.uniform(8, 60), -rng.uniform(3, 12)
    inside = radius**2 - (x - rng.uniform(-4, 4)) ** 2 - (y - y.mean()) ** 2
    return np.maximum(np.sqrt(np.maximum(inside, 0.0)) - radius, base)


def _bar(rng: np.random.Generator, x: Float, y: Float) -> Float:
    radius, base = rng.uniform(3, 40), -rng.uniform(4, 30)
    inside = radius**2 - (x - rng.uniform(-4, 4) - rng.uniform(-0.03, 0.03) * y) ** 2
    return np.where(inside > 0, np.maximum(np.sqrt(np.maximum(inside, 0.0)) - radius, base), base)


def _cable(rng: np.random.Generator, x: Float, y: Float) -> Float:
    radius = rng.uniform(0.8, 3)
    way = rng.uniform(0.5, 4) * np.sin(y / rng.uniform(8, 30) + rng.uniform(0, 6))
    inside = radius**2 - (x - way) ** 2
    return np.where(inside > 0, np.sqrt(np.maximum(inside, 0.0)) + radius, 0.0)


def _v_groove(rng: np.random.Generator, x: Float, y: Float) -> Float:
    slopes, depth = 1.0 / np.tan(np.radians(rng.uniform(20, 60, 2))), rng.uniform(2, 12)
    x = x - rng.uniform(-3, 3) - rng.uniform(-0.02, 0.02) * y
    return np.where(x < 0, np.minimum(0.0, -depth - slopes[0] * x), np.minimum(0.0, -depth + slopes[1] * x))


def _u_groove(rng: np.random.Generator, x: Float, y: Float) -> Float:
    radius, depth = rng.uniform(2, 8), rng.uniform(3, 10)
    x = x - rng.uniform(-3, 3)
    inside = radius**2 - x**2
    return np.where(np.abs(x) < radius, -depth + radius - np.sqrt(np.maximum(inside, 0.0)), 0.0)


def _step(rng: np.random.Generator, x: Float, y: Float) -> Float:
    return (
        np.where(x > rng.uniform(-5, 5) + rng.uniform(-0.02, 0.02) * y, 0.0, -rng.uniform(1, 20))
        + rng.uniform(-0.3, 0.3) * x
    )


def _steps(rng: np.random.Generator, x: Float, y: Float) -> Float:
    at = np.sort(rng.uniform(-12, 12, 3))
    return sum(np.where(x > a, h, 0.0) for a, h in zip(at, rng.uniform(-4, 4, 3), strict=True)) + 0.0 * y


def _sheets(rng: np.random.Generator, x: Float, y: Float) -> Float:
    gap = rng.uniform(0.5, 3)
    upper = rng.uniform(-0.2, 0.2) * x
    return np.where((np.arange(x.size) % 2 == 0)[None], upper, upper - gap) + 0.0 * y


def _table(rng: np.random.Generator, x: Float, y: Float) -> Float:
    return rng.uniform(-0.4, 0.4) * x + rng.uniform(-0.01, 0.01) * y


def _waves(rng: np.random.Generator, x: Float, y: Float) -> Float:
    return rng.uniform(0.5, 3) * np.sin(x / rng.uniform(1, 5) + rng.uniform(-0.05, 0.05) * y)


def _ridge(rng: np.random.Generator, x: Float, y: Float) -> Float:
    """Two faces that meet, and no root face: a bar of angle steel."""
    slopes = np.tan(np.radians(rng.uniform(30, 60, 2)))
    x = x - rng.uniform(-3, 3)
    return -np.where(x < 0, -slopes[0] * x, slopes[1] * x) + 0.0 * y


def _noise(rng: np.random.Generator, x: Float, y: Float) -> Float:
    return rng.normal(0, rng.uniform(0.5, 5), (y.size, x.size))


SHAPES: dict[str, Shape] = {
    "dome": _dome,
    "round bar": _bar,
    "cable on a table": _cable,
    "V groove": _v_groove,
    "U groove": _u_groove,
    "step": _step,
    "several steps": _steps,
    "two sheets": _sheets,
    "empty table": _table,
    "corrugated sheet": _waves,
    "angle steel": _ridge,
    "no surface": _noise,
}


def shape_recording(kind: str, seed: int) -> Recording:
    """A recording (200 frames, 500 columns) of a shape that is no bevel, scanned well: square, with true poses."""
    rng = np.random.default_rng([seed, list(SHAPES).index(kind)])
    x = ((np.arange(COLUMNS) - (COLUMNS - 1) / 2) * PITCH_MM)[None]
    y = (np.arange(FRAMES) * STEP_MM)[:, None]
    turn = rng.uniform(-0.5, 0.5)  # of the part about the way
    height = np.broadcast_to(SHAPES[kind](rng, x, y), (FRAMES, COLUMNS)) + np.tan(turn) * x * (
        kind in ("step", "V groove")
    )
    z = STANDOFF_MM - height + rng.normal(0.0, NOISE_MM, height.shape)
    z = np.where((np.abs(height) < 40) & (rng.random(height.shape) > 0.01), z, np.nan)
    time = 1.0 + np.arange(FRAMES) / 50.0
    rotation = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])  # y of the profiler along x of the base
    hand_eye = pose_from(np.eye(3), np.array([120.0, 10.0, 40.0]))
    start = np.array([1200.0, 200.0, 900.0])
    return Recording(
        source=f"{kind} {seed}",
        time_s=time,
        x_mm=np.broadcast_to(x, z.shape).astype(np.float32).copy(),
        z_mm=z.astype(np.float32),
        pass_index=np.zeros(FRAMES, np.int64),
        robot_time_s=time[[0, -1]],
        robot_position_mm=np.stack([start, start + (FRAMES - 1) * STEP_MM * rotation[:, 1]]),
        robot_quaternion_wxyz=np.repeat(quaternion_from_rotation(rotation)[None], 2, axis=0),
        robot_pass=np.zeros(2, np.int64),
        flange_from_profiler=hand_eye,
    )
