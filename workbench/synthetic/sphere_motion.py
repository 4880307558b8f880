"""How the robot shows the sphere to the scanner: true poses of all frames, the poses that it records, the design."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from workbench.geometry.poses import pose_from, quaternion_from_rotation, rotation_from_rpy, rotation_from_vector
from workbench.synthetic.recipe import Scanner
from workbench.synthetic.sphere_recipe import SpherePass, SphereRecipe
from workbench.synthetic.surface import pose
from workbench.units import DEG, Float

_PAUSE_S = 2.0  # between passes
_WEAVES, _SWINGS = np.array([1.5, 0.0, 2.5]), 2.0  # waves of a scan: in the view, and in orientation
_SWING_AXIS = np.array([0.3, 0.4, np.sqrt(0.75)])  # in the flange frame
_WAVES = 3  # sine waves that make one axis of the systematic error
_MM_PER_RAD = 1000.0  # flange positions a metre apart are as far as orientations a radian apart


@dataclass(frozen=True, slots=True, eq=False)
class SphereMotion:
    """One pass: N frames, K recorded poses."""

    time_s: Float  # (N,) on the profiler's clock
    base_from_flange: Float  # (N, 4, 4) true
    pose_time_s: Float  # (K,) on the robot's clock
    position_mm: Float  # (K, 3) as recorded
    quaternion_wxyz: Float  # (K, 4) as recorded


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
        held,
        start_s + pose_time,
        said[:, :3, 3],
        quaternion_from_rotation(said[:, :3, :3]),
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
    turned = nominal @ rotation_from_vector(np.array(one.turn_deg) * DEG) @ rotation_from_vector(swing)
    flange_from_profiler = pose(robot.flange_from_profiler)
    in_flange = in_profiler(recipe.scanner, view) @ flange_from_profiler[:3, :3].T + flange_from_profiler[:3, 3]
    return pose_from(turned, np.array(recipe.sphere.center_mm) - (turned @ in_flange[..., None])[..., 0])


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
