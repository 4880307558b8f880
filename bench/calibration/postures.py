"""The paper's calibration in simulation: three orientations of the flange, three measurements each."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from workbench.geometry.poses import pose_from, rotation_from_rpy, rotation_from_vector
from workbench.plugins.calibration.methods import Centres
from workbench.units import DEG, Float

TRUE = pose_from(rotation_from_rpy(*(np.array([60.489, -3.813, -2.024]) * DEG)), np.array([126.92, 9.44, 41.48]))
CENTER_MM = np.array([1890.33, 241.48, 1079.72])  # the paper's result and its sphere
RADIUS_MM = 5.0
REPEATABILITY_MM = 0.2  # of the paper's robot: taken as three standard deviations of the length, 0.07 mm an axis
POSE_MM, POSE_DEG, CENTRE_MM = 0.07, 0.01, 0.005  # noise: flange an axis, and the circle's centre
TURN_DEG = 25.0


@dataclass(frozen=True)
class Measured:
    """Nine measurements: what the methods get, the design's hand-eye pose, and whose orientation each has."""

    centres: Centres
    design: Float  # (4, 4)
    orientation: Float  # (9,) 0, 1 or 2


def measured(rng: np.random.Generator, moved: bool, design_deg: float = 1.0, design_mm: float = 3.0) -> Measured:
    """Nine measurements. `moved`: each orientation in three places; else one place, gone to three times."""
    nominal = rotation_from_rpy(*(np.array([20.0, 65.0, 10.0]) * DEG))
    turns = nominal @ rotation_from_vector(rng.uniform(-1, 1, (3, 3)) * TURN_DEG * DEG)
    places = _places(rng, 9 if moved else 3)
    P = places if moved else np.repeat(places, 3, axis=0)
    r = np.repeat(turns, 3, axis=0)
    t = CENTER_MM - (r @ (P @ TRUE[:3, :3].T + TRUE[:3, 3])[..., None])[..., 0]
    # What the robot records is not quite where it is.
    said_r = r @ rotation_from_vector(rng.normal(0, POSE_DEG * DEG, (9, 3)))
    seen = P + rng.normal(0, CENTRE_MM, (9, 3))
    seen[:, 1] = np.copysign(np.sqrt(np.maximum(RADIUS_MM**2 - _squared_radius(rng, P[:, 1]), 0.0)), P[:, 1])
    axis, way = (v / np.linalg.norm(v) for v in rng.normal(size=(2, 3)))
    off = rotation_from_vector(axis * design_deg * DEG)
    design = pose_from(off @ TRUE[:3, :3], TRUE[:3, 3] + design_mm * way)
    return Measured(Centres(seen, said_r, t + rng.normal(0, POSE_MM, (9, 3))), design, np.repeat(np.arange(3), 3))


def _places(rng: np.random.Generator, count: int) -> Float:
    y = rng.choice([-1.0, 1.0], count) * rng.uniform(1.5, 4.25, count)
    return np.stack([rng.uniform(-10, 10, count), y, rng.uniform(-15, 15, count)], axis=1)


def _squared_radius(rng: np.random.Generator, y: Float) -> Float:
    """r^2 of the circles as fitted: sd 0.01 mm of the radius."""
    r = np.sqrt(RADIUS_MM**2 - y**2)
    return np.asarray((r + rng.normal(0, 0.01, len(y))) ** 2)


def sphere_centres(pose: Float, seen: Centres) -> Float:
    """Sphere centres (9, 3) in the base by a hand-eye pose: Table 1's rows."""
    flange = seen.P @ pose[:3, :3].T + pose[:3, 3]
    return np.asarray((seen.r @ flange[..., None])[..., 0] + seen.t)


def vol_mm(pose: Float) -> float:
    """RMS error of a point over +-16 x +-20 mm of the field of view."""
    corners = np.array([[a * 16 / np.sqrt(3), 0.0, b * 20 / np.sqrt(3)] for a in (-1, 1) for b in (-1, 1)])
    off = corners @ (pose - TRUE)[:3, :3].T + (pose - TRUE)[:3, 3]
    return float(np.sqrt(np.mean(np.sum(off**2, axis=1))))
