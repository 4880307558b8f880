"""Calibration spheres by two simulators that share nothing but what a data sheet says of the sensor.

`by_rays`: every pixel column is a bundle of rays that meet the ball in space. `by_sections`: the laser plane cuts the
ball in a circle, of which columns sample the arc that faces the sensor.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.ndimage import gaussian_filter1d
from scipy.spatial.transform import Rotation

from workbench.artefacts import Recording
from workbench.geometry.poses import pose_from
from workbench.units import Float


class Sensor(NamedTuple):
    """Of a data sheet: columns, width and stand-off in the middle of the range, the range, sd of one range; mm."""

    name: str
    columns: int
    width_mm: float
    stand_off_mm: float
    range_mm: float
    noise_mm: float


# Micro-Epsilon, scanCONTROL 29xx brochure: points of a profile, x and z ranges, reference resolution. Keyence, LJ-V7000
# series catalogue: reference distance, measuring range, profile data interval; a pixel's noise is taken as 2 um.
SENSORS = (
    Sensor("scanCONTROL 29xx-50", 1280, 50.0, 95.0, 50.0, 0.004),
    Sensor("scanCONTROL 29xx-100", 1280, 100.0, 240.0, 100.0, 0.012),
    Sensor("LJ-V7080", 800, 32.0, 80.0, 46.0, 0.002),
)
DIAMETERS_MM = (10.0, 12.7, 20.0)
OFF_SHARE = (0.25, 0.85)  # of the laser plane from the centre, in radii


class Shown(NamedTuple):
    """A sphere shown to a sensor in postures: true poses, and what the robot reports of them."""

    sensor: Sensor
    radius_mm: float
    flange_from_profiler: Float  # (4, 4)
    centre_mm: Float  # (k, 3) of the sphere, in the profiler frame, z from the sensor's origin away
    told: Float  # (k, 4, 4) base_from_flange as recorded


def shown(rng: np.random.Generator, postures: int, robot_mm: float, robot_deg: float) -> Shown:
    """Postures about a nominal one, 25 deg each way; the sphere within the view."""
    sensor = SENSORS[rng.integers(len(SENSORS))]
    radius = float(rng.choice(DIAMETERS_MM)) / 2.0
    hand_eye = pose_from(Rotation.random(random_state=rng).as_matrix(), rng.normal(0.0, 90.0, 3))
    half = 0.5 * sensor.width_mm - radius, 0.35 * sensor.range_mm - radius
    side = rng.choice([-1.0, 1.0], postures) * rng.uniform(*OFF_SHARE, postures) * radius
    x, z = (h * rng.uniform(-0.8, 0.8, postures) for h in half)
    centre = np.stack([x, side, sensor.stand_off_mm + z], axis=1)
    nominal = Rotation.random(random_state=rng).as_matrix()
    turns = Rotation.from_rotvec(np.radians(rng.uniform(-25.0, 25.0, (postures, 3)))).as_matrix() @ nominal
    ball = rng.normal(0.0, 600.0, 3) + np.array([1200.0, 0.0, 500.0])
    at = (hand_eye[:3, :3] @ centre.T).T + hand_eye[:3, 3]
    place = ball - np.einsum("kij,kj->ki", turns, at)
    wrong = Rotation.from_rotvec(np.radians(rng.normal(0.0, robot_deg, (postures, 3)))).as_matrix()
    return Shown(
        sensor, radius, hand_eye, centre, pose_from(wrong @ turns, place + rng.normal(0.0, robot_mm, (postures, 3)))
    )


def recorded(rng: np.random.Generator, seen: Shown, x: Float, z: Float, repeats: int) -> Recording:
    """Frames (k * repeats, columns) of postures held still, a pass each; the design is off by some mm and degrees."""
    count = len(seen.told)
    time = np.arange(count)[:, None] * 4.0 + 0.02 * np.arange(repeats)
    wrong = Rotation.from_rotvec(np.radians(rng.normal(0.0, 3.0, 3))).as_matrix()
    design = seen.flange_from_profiler.copy()
    design[:3, :3], design[:3, 3] = wrong @ design[:3, :3], design[:3, 3] + rng.normal(0.0, 6.0, 3)
    return Recording(
        source="sphere",
        time_s=1.0 + time.ravel(),
        x_mm=x.astype(np.float32),
        z_mm=z.astype(np.float32),
        pass_index=np.repeat(np.arange(count), repeats),
        robot_time_s=1.0 + time[:, :1].ravel() + 0.01 * (repeats - 1),
        robot_position_mm=seen.told[:, :3, 3],
        robot_quaternion_wxyz=Rotation.from_matrix(seen.told[:, :3, :3]).as_quat()[:, [3, 0, 1, 2]],
        robot_pass=np.arange(count),
        flange_from_profiler=design,
        sphere_diameter_mm=2.0 * seen.radius_mm,
    )


def by_rays(rng: np.random.Generator, seen: Shown, repeats: int, strays: float) -> Recording:
    """Fan of rays, four a column over its footprint; noise of speckle along columns, grazing returns lost."""
    sensor, sub = seen.sensor, 4
    pitch = sensor.width_mm / sensor.columns
    lateral = (np.arange(sensor.columns * sub) + 0.5) / sub * pitch - 0.5 * sensor.width_mm
    way = np.stack([lateral / sensor.stand_off_mm, 0 * lateral, 1 + 0 * lateral], axis=1)
    way /= np.linalg.norm(way, axis=1, keepdims=True)
    middle = seen.centre_mm @ way.T  # (k, rays) along each ray to where it passes the centre
    left = seen.radius_mm**2 - (np.sum(seen.centre_mm**2, axis=1)[:, None] - middle**2)
    distance = np.where(left > 0.0, middle - np.sqrt(np.maximum(left, 0.0)), np.nan)
    steep = np.sqrt(np.maximum(left, 0.0)) / seen.radius_mm  # cosine of the incidence
    distance[steep < 0.3] = np.nan
    depth = (distance * way[:, 2]).reshape(len(distance), sensor.columns, sub)
    count = np.isfinite(depth).sum(axis=2)
    z = np.where(count >= sub - 1, np.nansum(depth, axis=2) / np.maximum(count, 1), np.nan)
    z = np.repeat(z, repeats, axis=0)
    speckle = gaussian_filter1d(rng.normal(size=z.shape), rng.uniform(0.4, 1.0), axis=1)
    z = z + sensor.noise_mm * speckle / speckle.std()
    stray = rng.random(z.shape) < strays
    z = np.where(stray, sensor.stand_off_mm + sensor.range_mm * rng.uniform(-0.4, 0.4, z.shape), z)
    x = z / sensor.stand_off_mm * lateral.reshape(-1, sub).mean(axis=1)
    return recorded(rng, seen, np.where(np.isfinite(z), x, np.nan), z, repeats)


def by_sections(rng: np.random.Generator, seen: Shown, repeats: int, strays: float) -> Recording:
    """Parallel columns on the circle of the section; white noise that grows with the slope, quantised ranges."""
    sensor = seen.sensor
    x = (np.arange(sensor.columns) - 0.5 * (sensor.columns - 1)) * sensor.width_mm / sensor.columns
    rows, inside = [], []
    for cx, off, cz in seen.centre_mm:
        section = seen.radius_mm**2 - off**2 - (x - cx) ** 2
        slope = np.abs(x - cx) / np.sqrt(np.maximum(section, 1e-9))
        good = (section > 0.0) & (slope < 2.5)
        rows.append(np.where(good, cz - np.sqrt(np.maximum(section, 0.0)), np.nan))
        inside.append(np.where(good, np.sqrt(1.0 + slope**2), 1.0))
    z, grows = np.repeat(rows, repeats, axis=0), np.repeat(inside, repeats, axis=0)
    z = np.round((z + rng.normal(0.0, sensor.noise_mm, z.shape) * grows) / 1e-3) * 1e-3
    z[rng.random(z.shape) < 0.01] = np.nan
    flying = rng.random(z.shape) < strays
    z[flying] = rng.uniform(sensor.stand_off_mm - 5.0, sensor.stand_off_mm + 15.0, int(flying.sum()))
    return recorded(rng, seen, np.where(np.isfinite(z), x, np.nan), z, repeats)
