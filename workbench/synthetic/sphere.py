"""A sphere recipe in, a calibration recording and its exact truth out: in memory, or as files."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from workbench.artefacts import Recording
from workbench.geometry.poses import (
    inverse,
    mapped,
    pose_from,
    quaternion_from_rotation,
    rotation_from_rpy,
    rotation_from_vector,
)
from workbench.recording_file import Frames
from workbench.synthetic import raycast
from workbench.synthetic.recipe import Scanner, SpherePass, SphereRecipe
from workbench.synthetic.scan import Logged, column_offsets, coordinates, disturb, entry, rays, recorded, sensor_of
from workbench.synthetic.workpiece import pose
from workbench.units import DEG, Bool, Float, Int, Shaped

_BLOCK_FRAMES = 64


@dataclass(frozen=True, slots=True, eq=False)
class SphereTruth:
    """What a synthetic calibration recording was made from. N frames."""

    recipe: SphereRecipe
    flange_from_profiler: Shaped[Float, "4 4"]  # true
    design: Shaped[Float, "4 4"]  # as the recording states it
    base_from_flange: Shaped[Float, "N 4 4"]  # true, of every frame
    centre_mm: Shaped[Float, "N 3"]  # of the sphere in the profiler frame
    pass_index: Shaped[Int, " N"]

    @property
    def gross_passes(self) -> tuple[int, ...]:
        """Passes whose recorded poses are grossly off."""
        return tuple(i for i, one in enumerate(self.recipe.passes) if any(one.gross_mm))

    def document(self) -> dict[str, Any]:
        """The content of a truth file: strict JSON."""
        sphere, robot = self.recipe.sphere, self.recipe.robot
        return {
            "format": "sphere-truth",
            "version": 1,
            "seed": self.recipe.seed,
            "flange_from_profiler": self.flange_from_profiler.tolist(),
            "design_flange_from_profiler": self.design.tolist(),
            "sphere_center_mm": list(sphere.center_mm),
            "sphere_diameter_mm": sphere.diameter_mm,
            "time_offset_s": robot.clock_offset_s if robot.clock == "own" else None,
            "gross_passes": list(self.gross_passes),
            "pass": self.pass_index.tolist(),
            "sphere_in_profiler_mm": self.centre_mm.round(9).tolist(),
            "recipe": self.recipe.model_dump(mode="json"),
        }


def simulate_sphere(recipe: SphereRecipe) -> tuple[Recording, SphereTruth]:
    """The calibration recording that `recipe` describes, and its truth. The same recipe gives the same numbers."""
    motions, robot, sphere = sphere_motion(recipe), recipe.robot, recipe.sphere
    poses, number = _frames_of(motions)
    design, center = design_hand_eye(recipe), _centers(recipe, number)
    seen = scene(recipe, poses, center)
    truth = SphereTruth(recipe, pose(robot.flange_from_profiler), design, poses, seen.centre, number)
    stated = sphere.stated_diameter_mm or sphere.diameter_mm
    grids = _profiles(recipe, poses, center)
    return recorded(motions, grids, design, sphere_diameter_mm=stated, clock=robot.clock), truth


def true_poses(recipe: SphereRecipe) -> tuple[Float, Float, Float]:
    """flange_from_profiler (4, 4), flange poses (N, 4, 4), sphere centres in the profiler frame (N, 3): true."""
    poses, number = _frames_of(sphere_motion(recipe))
    return pose(recipe.robot.flange_from_profiler), poses, scene(recipe, poses, _centers(recipe, number)).centre


def _frames_of(motions: list[SphereMotion]) -> tuple[Float, Int]:
    """True flange poses (N, 4, 4) and pass numbers (N,) of all frames."""
    poses = [m.base_from_flange for m in motions]
    return np.concatenate(poses), np.repeat(np.arange(len(poses)), [len(one) for one in poses])


def _center(recipe: SphereRecipe, one: SpherePass) -> Float:
    return np.array(recipe.sphere.center_mm if one.center_mm is None else one.center_mm)


def _centers(recipe: SphereRecipe, pass_index: Int) -> Float:
    """Where the sphere stands in the base (N, 3) in frames of passes (N,)."""
    return np.array([_center(recipe, one) for one in recipe.passes])[pass_index]


def _profiles(recipe: SphereRecipe, poses: Float, center: Float) -> Frames:
    """x and z (N, M) as returned."""
    sensor, offsets, blocks = sensor_of(recipe.scanner), column_offsets(recipe.scanner), []
    for number, first in enumerate(range(0, len(poses), _BLOCK_FRAMES)):
        block = slice(first, first + _BLOCK_FRAMES)
        exact, cosines = cast(scene(recipe, poses[block], center[block]), sensor, offsets)
        ranges = disturb(recipe, exact, cosines, np.random.default_rng([recipe.seed, 3, number]))
        blocks.append(coordinates(sensor, ranges, offsets))
    x, z = (np.concatenate(grids) for grids in zip(*blocks, strict=True))
    return Frames(x, z, None)


# Rays of the scanner against the sphere, its stem and the table: exact, in the profiler frame of every frame.

_OFF = 1e-7  # of a ray's length: what it starts on does not hide it


@dataclass(frozen=True, slots=True, eq=False)
class Scene:
    """Sphere, stem and table in the profiler frames of N frames."""

    centre: Shaped[Float, "N 3"]  # of the sphere
    up: Shaped[Float, "N 3"]  # unit: normal of the table, axis of the stem
    radius_mm: float
    stem_mm: float  # its radius; 0: none
    table_mm: float  # of the table below the centre; infinite: none


def scene(recipe: SphereRecipe, base_from_flange: Float, center: Float) -> Scene:
    """What stands before the scanner while the flange is at poses (N, 4, 4) and the sphere at `center` (N, 3)."""
    sphere, hand_eye = recipe.sphere, pose(recipe.robot.flange_from_profiler)
    profiler_from_base = inverse(base_from_flange @ hand_eye)
    nominal = rotation_from_rpy(*(np.array(recipe.robot.nominal_rpy_deg) * DEG)) @ hand_eye[:3, :3]
    towards = np.array([0.0, 0.0, -1.0 if recipe.scanner.z_away else 1.0])
    tilt = rotation_from_vector(np.array([*sphere.table_tilt_deg, 0.0]) * DEG)
    rotation = profiler_from_base[:, :3, :3]
    radius = sphere.diameter_mm / 2
    return Scene(
        (rotation @ center[..., None])[..., 0] + profiler_from_base[:, :3, 3],
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
    origin, way, eyes = rays(sensor, offsets)
    solid = _solid(here, origin, way)
    table = _table(here, origin, way)
    range_mm = np.minimum(np.minimum(*solid), table)
    reached = (range_mm > sensor.near) & (range_mm < sensor.far)
    point = origin + np.where(reached, range_mm, 0.0)[..., None] * way
    normal = _normal(here, point, np.argmin(np.stack([*solid, table]), axis=0))
    cosine = np.abs(np.sum(normal * way, axis=-1)) / np.linalg.norm(way, axis=-1)
    seen = reached & (cosine >= sensor.cos_min)
    for eye in eyes:
        seen &= _sees(here, point, eye)
    return np.where(seen, range_mm, np.nan), np.where(seen, cosine, 0.0)


def _sees(here: Scene, point: Float, target: Float) -> Bool:
    """Whether nothing stands between surface points (N, M, 3) and `target` (3,)."""
    return np.asarray(np.minimum(*_solid(here, point, target - point)) > 1.0)


def _solid(here: Scene, origin: Float, way: Float) -> tuple[Float, Float]:
    """Where rays (..., M, 3) first meet the sphere, and the stem: multiples of `way` (N, M), infinite for none."""
    off = origin - here.centre[:, None]
    sphere = entry(np.sum(way * way, -1), np.sum(way * off, -1), np.sum(off * off, -1) - here.radius_mm**2, _OFF)
    if here.stem_mm == 0:
        return sphere, np.full_like(sphere, np.inf)
    up = here.up[:, None]
    off_along, way_along = np.sum(off * up, -1), np.sum(way * up, -1)
    across, going = off - off_along[..., None] * up, way - way_along[..., None] * up
    stem = entry(
        np.sum(going * going, -1), np.sum(going * across, -1), np.sum(across * across, -1) - here.stem_mm**2, _OFF
    )
    height = off_along + np.where(np.isfinite(stem), stem, 0.0) * way_along
    below = -here.table_mm if np.isfinite(here.table_mm) else -10 * here.radius_mm
    return sphere, np.where((height < 0) & (height > below), stem, np.inf)


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


# How the robot shows the sphere to the scanner: true poses of all frames, the poses that it records, the design.

_PAUSE_S = 2.0  # between passes
_WEAVES, _SWINGS = np.array([1.5, 0.0, 2.5]), 2.0  # waves of a scan: in the view, and in orientation
_SWING_AXIS = np.array([0.3, 0.4, np.sqrt(0.75)])  # in the flange frame
_WAVES = 3  # sine waves that make one axis of the systematic error
_MM_PER_RAD = 1000.0  # flange positions a metre apart are as far as orientations a radian apart


@dataclass(frozen=True, slots=True, eq=False)
class SphereMotion(Logged):
    """One pass, its frames on the profiler's clock, its poses on the robot's."""

    base_from_flange: Shaped[Float, "N 4 4"]  # true


def sphere_motion(recipe: SphereRecipe) -> list[SphereMotion]:
    """The motion of every pass, one after the other in time."""
    motions, start = [], 1.0
    for index, one in enumerate(recipe.passes):
        motions.append(_move(recipe, one, index, start))
        start += _PAUSE_S + (one.seconds if one.to_mm is not None else one.repeats / recipe.robot.frame_rate_hz)
    return motions


def design_hand_eye(recipe: SphereRecipe) -> Float:
    """flange_from_profiler (4, 4) by design: the true one, off by the stated sizes in random directions."""
    robot, rng = recipe.robot, np.random.default_rng([recipe.seed, 2])
    axis, way = (v / np.linalg.norm(v) for v in rng.normal(size=(2, 3)))
    true = pose(robot.flange_from_profiler)
    turn = rotation_from_vector(axis * robot.design_error_deg * DEG)
    return pose_from(turn @ true[:3, :3], true[:3, 3] + way * robot.design_error_mm)


def in_profiler(scanner: Scanner, view: Float) -> Float:
    """Points (..., 3) of the view in the profiler frame."""
    sign = 1.0 if scanner.z_away else -1.0
    depth = sign * (scanner.standoff_mm + view[..., 2] - scanner.zero_range_mm)
    return np.stack([scanner.x_offset_mm + view[..., 0], view[..., 1], depth], axis=-1)


def _move(recipe: SphereRecipe, one: SpherePass, index: int, start_s: float) -> SphereMotion:
    """A pass. Its poses are those that put the sphere where the recipe says; what is recorded is off."""
    robot, rng = recipe.robot, np.random.default_rng([recipe.seed, 1, index])
    if one.to_mm is None:
        time, pose_time = np.arange(one.repeats) / robot.frame_rate_hz, np.zeros(1)
    else:
        time = np.arange(int(one.seconds * robot.frame_rate_hz) + 1) / robot.frame_rate_hz
        pose_time = np.arange(-robot.pose_margin_s, one.seconds + robot.pose_margin_s + 1e-9, 1 / robot.pose_rate_hz)

    def noise(count: int) -> Float:
        own, common = rng.normal(0, 1, (count, 3)), 0.0
        if robot.pose_noise_common:
            common = rng.normal(0, 1, 3) * np.sqrt(robot.pose_noise_common)
        return np.asarray(own * np.sqrt(1 - robot.pose_noise_common) + common)

    said = flange_poses(recipe, one, pose_time)
    said[:, :3, 3] += systematic_error(recipe, said) + one.gross_mm + noise(len(said)) * robot.pose_noise_mm
    said[:, :3, :3] @= rotation_from_vector(noise(len(said)) * robot.pose_noise_deg * DEG)
    held = flange_poses(recipe, one, time if one.to_mm is not None else np.zeros(len(time)))
    return SphereMotion(
        start_s + time + robot.clock_offset_s,
        start_s + pose_time,
        said[:, :3, 3],
        quaternion_from_rotation(said[:, :3, :3]),
        held,
    )


def flange_poses(recipe: SphereRecipe, one: SpherePass, time_s: Float) -> Float:
    """True base_from_flange (n, 4, 4) at times (n,) from the start of a pass; a scan goes on beyond its ends."""
    robot = recipe.robot
    done = (time_s / one.seconds)[:, None] if one.to_mm is not None else np.zeros((len(time_s), 1))
    end = one.sphere_mm if one.to_mm is None else one.to_mm
    view = (1 - done) * np.array(one.sphere_mm) + done * np.array(end)
    view = view + one.weave_mm * np.sin(2 * np.pi * _WEAVES * done)
    swing = one.weave_deg * DEG * np.sin(2 * np.pi * _SWINGS * done) * _SWING_AXIS
    nominal = rotation_from_rpy(*(np.array(robot.nominal_rpy_deg) * DEG))
    orientation = nominal @ rotation_from_vector(np.array(one.turn_deg) * DEG) @ rotation_from_vector(swing)
    flange_from_profiler = pose(robot.flange_from_profiler)
    in_flange = mapped(flange_from_profiler, in_profiler(recipe.scanner, view))
    return pose_from(orientation, _center(recipe, one) - (orientation @ in_flange[..., None])[..., 0])


def systematic_error(recipe: SphereRecipe, base_from_flange: Float) -> Float:
    """Position error (n, 3) in the base, a function of the posture (n, 4, 4): sine waves over its coordinates."""
    robot, rng = recipe.robot, np.random.default_rng([recipe.seed, 4])
    direction = rng.normal(size=(3, _WAVES, 6))
    direction /= np.linalg.norm(direction, axis=-1, keepdims=True)
    phase = rng.uniform(0, 2 * np.pi, (3, _WAVES))
    nominal = rotation_from_rpy(*(np.array(robot.nominal_rpy_deg) * DEG))
    turn = _small_vector(nominal.T @ base_from_flange[:, :3, :3])
    place = np.concatenate([turn, (base_from_flange[:, :3, 3] - recipe.sphere.center_mm) / _MM_PER_RAD], axis=1)
    waves = np.sin(place @ direction.reshape(-1, 6).T * (360 / robot.systematic_reach_deg) + phase.ravel())
    return np.asarray(waves.reshape(-1, 3, _WAVES).sum(axis=2) * robot.systematic_mm * np.sqrt(2 / _WAVES))


def _small_vector(rotation: Float) -> Float:
    """2 sin(angle) / 2 times the axis: smooth everywhere, the rotation vector where small."""
    off = rotation - np.swapaxes(rotation, -1, -2)
    return np.stack([off[:, 2, 1], off[:, 0, 2], off[:, 1, 0]], axis=1) / 2
