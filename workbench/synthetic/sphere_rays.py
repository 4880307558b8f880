"""Rays of the scanner against the sphere, its stem and the table: exact, in the profiler frame of every frame."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from workbench.geometry.poses import inverse, rotation_from_rpy, rotation_from_vector
from workbench.synthetic import raycast
from workbench.synthetic.sphere_recipe import SphereRecipe
from workbench.synthetic.surface import pose
from workbench.units import DEG, Bool, Float, Int

_OFF = 1e-7  # of a ray's length: what it starts on does not hide it


@dataclass(frozen=True, slots=True, eq=False)
class Scene:
    """Sphere, stem and table in the profiler frames of N frames."""

    centre: Float  # (N, 3) of the sphere
    up: Float  # (N, 3) unit: normal of the table, axis of the stem
    radius_mm: float
    stem_mm: float  # its radius; 0: none
    table_mm: float  # of the table below the centre; infinite: none


def scene(recipe: SphereRecipe, base_from_flange: Float) -> Scene:
    """What stands before the scanner while the flange is at poses (N, 4, 4)."""
    sphere, hand_eye = recipe.sphere, pose(recipe.robot.flange_from_profiler)
    profiler_from_base = inverse(base_from_flange @ hand_eye)
    nominal = rotation_from_rpy(*(np.array(recipe.robot.nominal_rpy_deg) * DEG)) @ hand_eye[:3, :3]
    towards = np.array([0.0, 0.0, -1.0 if recipe.scanner.z_away else 1.0])
    tilt = rotation_from_vector(np.array([*sphere.table_tilt_deg, 0.0]) * DEG)
    rotation = profiler_from_base[:, :3, :3]
    radius = sphere.diameter_mm / 2
    return Scene(
        rotation @ np.array(sphere.center_mm) + profiler_from_base[:, :3, 3],
        rotation @ (nominal @ tilt @ towards),
        radius,
        sphere.stem_diameter_mm / 2,
        np.inf if sphere.table_gap_mm is None else radius + sphere.table_gap_mm,
    )


def cast(here: Scene, sensor: raycast.Sensor, offsets: Float) -> tuple[Float, Float]:
    """Range of every ray (N, M; NaN: no return) along the range axis from the emitter, and cos(incidence).

    `offsets` (M,) are the columns' lateral positions, or the tangents of their angles where `sensor.angular`. A point
    counts where the laser meets it within the range, not too grazing, and where the camera sees it.
    """
    emitter = np.array([sensor.emitter_x, 0.0, sensor.emitter_z])
    lateral = np.stack([offsets, np.zeros(len(offsets)), np.zeros(len(offsets))], axis=1)
    ahead = np.array([0.0, 0.0, sensor.sign])
    origin = emitter + np.zeros_like(lateral) if sensor.angular else emitter + lateral
    way = ahead + lateral if sensor.angular else ahead + np.zeros_like(lateral)
    solid = _solid(here, origin, way)
    table = _table(here, origin, way)
    range_mm = np.minimum(np.minimum(*solid), table)
    reached = (range_mm > sensor.near) & (range_mm < sensor.far)
    point = origin + np.where(reached, range_mm, 0.0)[..., None] * way
    normal = _normal(here, point, np.argmin(np.stack([*solid, table]), axis=0))
    cosine = np.abs(np.sum(normal * way, axis=-1)) / np.linalg.norm(way, axis=-1)
    seen = reached & (cosine >= sensor.cos_min) & _sees(here, point, emitter + np.array([0.0, sensor.baseline, 0.0]))
    if sensor.fan and not sensor.angular:
        seen &= _sees(here, point, emitter)
    return np.where(seen, range_mm, np.nan), np.where(seen, cosine, 0.0)


def _sees(here: Scene, point: Float, target: Float) -> Bool:
    """Whether nothing stands between surface points (N, M, 3) and `target` (3,)."""
    return np.asarray(np.minimum(*_solid(here, point, target - point)) > 1.0)


def _solid(here: Scene, origin: Float, way: Float) -> tuple[Float, Float]:
    """Where rays (..., M, 3) first meet the sphere, and the stem: multiples of `way` (N, M), infinite for none."""
    off = origin - here.centre[:, None]
    sphere = _first(np.sum(way * way, -1), np.sum(way * off, -1), np.sum(off * off, -1) - here.radius_mm**2)
    if here.stem_mm == 0:
        return sphere, np.full_like(sphere, np.inf)
    up = here.up[:, None]
    off_along, way_along = np.sum(off * up, -1), np.sum(way * up, -1)
    across, going = off - off_along[..., None] * up, way - way_along[..., None] * up
    stem = _first(np.sum(going * going, -1), np.sum(going * across, -1), np.sum(across * across, -1) - here.stem_mm**2)
    height = off_along + np.where(np.isfinite(stem), stem, 0.0) * way_along
    below = -here.table_mm if np.isfinite(here.table_mm) else -10 * here.radius_mm
    return sphere, np.where((height < 0) & (height > below), stem, np.inf)


def _first(a: Float, b: Float, c: Float) -> Float:
    """Smallest root beyond `_OFF` of a s^2 + 2 b s + c that enters the body from outside; infinite for none."""
    root = b * b - a * c
    with np.errstate(invalid="ignore", divide="ignore"):
        s = (-b - np.sqrt(root)) / a
    return np.where(np.isfinite(s) & (s > _OFF), s, np.inf)


def _table(here: Scene, origin: Float, way: Float) -> Float:
    """Where rays meet the table: multiples of `way` (N, M)."""
    if not np.isfinite(here.table_mm):
        return np.full((len(here.centre), len(way)), np.inf)
    up = here.up[:, None]
    height = np.sum((origin - here.centre[:, None]) * up, axis=-1) + here.table_mm
    down = -np.sum(way * up, axis=-1)
    return np.where(down > 1e-9, height / np.maximum(down, 1e-9), np.inf)


def _normal(here: Scene, point: Float, which: Int) -> Float:
    """Unit normals (N, M, 3) of sphere (0), stem (1) or table (2) at points on them."""
    up = np.broadcast_to(here.up[:, None], point.shape)
    off = point - here.centre[:, None]
    across = off - np.sum(off * up, -1, keepdims=True) * up
    normal = np.choose(which[..., None], [off, across, up])
    return np.asarray(normal / np.maximum(np.linalg.norm(normal, axis=-1, keepdims=True), 1e-12))
