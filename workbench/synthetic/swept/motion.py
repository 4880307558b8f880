"""How the robot carries the scanner: true poses of the frames, and the poses that it records."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import scipy

from workbench.geometry.poses import inverse, pose_from, rotation_from_rpy
from workbench.synthetic.recipe import Placement
from workbench.synthetic.swept.recipe import AnyRecipe, Way
from workbench.synthetic.swept.spine import Curve
from workbench.units import DEG, Float, Shaped

PAUSE_S = 2.0  # between passes


@dataclass(frozen=True, slots=True, eq=False)
class Motion:
    """One pass: N frames, K recorded poses."""

    time_s: Shaped[Float, " N"]  # as recorded
    part_from_profiler: Shaped[Float, "N 4 4"]  # true
    pose_time_s: Shaped[Float, " K"]
    position_mm: Shaped[Float, "K 3"]  # flange in the base, as recorded
    quaternion_wxyz: Shaped[Float, "K 4"]


def placed(placement: Placement) -> Float:
    """The pose (4, 4) of a placement."""
    roll, pitch, yaw = np.array(placement.rpy_deg) * DEG
    return pose_from(rotation_from_rpy(roll, pitch, yaw), np.array(placement.position_mm))


def moves(recipe: AnyRecipe, curve: Curve) -> list[Motion]:
    """The motion of every pass, one after the other in time."""
    start, motions = 1.0, []
    for index, way in enumerate(recipe.passes):
        motions.append(_move(recipe, curve, way, start, np.random.default_rng([recipe.seed, 11, index])))
        start = float(max(motions[-1].time_s[-1], motions[-1].pose_time_s[-1])) + PAUSE_S
    return motions


def recorded_hand_eye(recipe: AnyRecipe) -> Float:
    """flange_from_profiler as the recording states it."""
    robot, rng = recipe.robot, np.random.default_rng([recipe.seed, 12])
    true = placed(robot.flange_from_profiler)
    turn = scipy.spatial.transform.Rotation.from_rotvec(
        rng.standard_normal(3) * robot.hand_eye_error_deg * DEG
    ).as_matrix()
    return pose_from(turn @ true[:3, :3], true[:3, 3] + rng.standard_normal(3) * robot.hand_eye_error_mm)


def _move(recipe: AnyRecipe, curve: Curve, way: Way, start_s: float, rng: np.random.Generator) -> Motion:
    robot = recipe.robot
    turns = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(way.way_mm)))])  # way gone at each turning point
    count = math.floor(turns[-1] / robot.frame_pitch_mm + 1e-9) + 1
    speed = robot.frame_rate_hz * robot.frame_pitch_mm
    time = start_s + np.arange(count) / robot.frame_rate_hz
    pose_time = _pose_times(way, time, robot.pose_rate_hz, abs(robot.time_offset_s))

    def poses(at_s: Float) -> Float:
        gone = (at_s - start_s) * speed
        return _poses(recipe, curve, way, np.interp(gone, turns, way.way_mm), gone)

    to_base = placed(recipe.part.base_from_part)
    true = poses(time)
    from_base = inverse(to_base)[:3, :3]
    true[:, :3, 3] += _unrecorded(recipe, (time - start_s) * speed, turns[-1], rng) @ from_base.T
    flange = to_base @ poses(pose_time) @ inverse(placed(robot.flange_from_profiler))
    position = flange[:, :3, 3] + rng.standard_normal((len(flange), 3)) * robot.pose_noise_mm
    noise = scipy.spatial.transform.Rotation.from_rotvec(
        rng.standard_normal((len(flange), 3)) * robot.pose_noise_deg * DEG
    )
    quaternion = (noise * scipy.spatial.transform.Rotation.from_matrix(flange[:, :3, :3])).as_quat(scalar_first=True)
    return Motion(time + robot.time_offset_s, true, pose_time, position, np.asarray(quaternion))


def _pose_times(way: Way, time: Float, rate_hz: float, margin_s: float) -> Float:
    if way.motion == "stop_and_go":
        return np.asarray(time.copy())
    if way.motion == "two_poses":
        return np.array([time[0], max(time[-1], time[0] + 1.0 / rate_hz)])
    return np.arange(time[0] - margin_s - 0.7 / rate_hz, time[-1] + margin_s + 1.5 / rate_hz, 1.0 / rate_hz)


def _unrecorded(recipe: AnyRecipe, gone: Float, whole: float, rng: np.random.Generator) -> Float:
    """What the robot does but does not say (n, 3), in the base: drift, a smooth error, vibration."""
    robot = recipe.robot
    way = rng.standard_normal(3)
    drift = robot.drift_mm * (gone / whole - 0.5)[:, None] * way / np.linalg.norm(way)
    wave = 2 * math.pi * gone[:, None] / robot.smooth_error_wavelength_mm + rng.uniform(0, 2 * math.pi, 3)
    return np.asarray(
        drift + robot.smooth_error_mm * np.sin(wave) + robot.vibration_mm * rng.standard_normal((len(gone), 3))
    )


def _poses(recipe: AnyRecipe, curve: Curve, way: Way, s: Float, gone: Float) -> Float:
    """part_from_profiler (n, 4, 4): the scanner's stance in the edge's frame (n, t, m), swaying."""
    low, high = min(way.way_mm), max(way.way_mm)
    if way.follow == "line":
        ends = curve.frames(np.array([low, high]))
        chord = ends.position[1] - ends.position[0]
        chord /= np.linalg.norm(chord)
        up = ends.m.mean(axis=0)
        up -= (up @ chord) * chord
        up /= np.linalg.norm(up)
        axes = np.broadcast_to(np.stack([np.cross(chord, up), chord, up], axis=1), (len(s), 3, 3))
        share = ((s - low) / (high - low))[:, None]
        place = ends.position[0] + share * (ends.position[1] - ends.position[0])
    else:
        frames = curve.frames(s)
        n, m = (frames.n, frames.m) if way.follow == "section" else (frames.n0, frames.m0)
        axes, place = np.stack([n, frames.t, m], axis=2), frames.position
    stance, aim = _stance(recipe, way)
    sway = np.array(way.sway_deg) * DEG * np.sin(2 * math.pi * gone / way.sway_wavelength_mm)[:, None]
    share = (s - low) / (high - low)
    offset = way.skew_mm[0] + (way.skew_mm[1] - way.skew_mm[0]) * share
    turned = stance @ scipy.spatial.transform.Rotation.from_rotvec(sway).as_matrix()
    target = np.array([way.aim_mm[0], 0.0, way.aim_mm[1]]) + offset[:, None] * stance[:, 0]
    rotation = axes @ turned
    # it sways about the place that it looks at
    return pose_from(rotation, place + np.einsum("kij,kj->ki", axes, target) - rotation @ aim)


def _stance(recipe: AnyRecipe, way: Way) -> tuple[Float, Float]:
    """Rotation (3, 3) of the profiler in the edge's axes (n, t, m), and the point it aims at, in the profiler."""
    scanner, tip = recipe.scanner, way.elevation_deg * DEG
    look = np.array([-math.cos(tip), 0.0, -math.sin(tip)])
    side = np.array([-math.sin(tip), 0.0, math.cos(tip)])
    lean = scipy.spatial.transform.Rotation.from_rotvec(
        side * way.lead_deg * DEG
    ) * scipy.spatial.transform.Rotation.from_rotvec(look * way.oblique_deg * DEG)
    z = look if scanner.z_away else -look
    x = -side if way.upside_down else side
    axes = lean.as_matrix() @ np.stack([x, np.cross(z, x), z], axis=1)
    sign = 1.0 if scanner.z_away else -1.0
    return axes, np.array([0.0, 0.0, sign * (scanner.standoff_mm - scanner.zero_range_mm)])
