"""How the robot carries the scanner past the edge: frames, their true poses, and the poses that it records."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import scipy

from workbench.geometry.poses import inverse, pose_from
from workbench.synthetic import raycast
from workbench.synthetic.recipe import Pass, Recipe
from workbench.synthetic.surface import edge_frames, pose
from workbench.units import DEG, Float, Shaped


@dataclass(frozen=True, slots=True, eq=False)
class PassMotion:
    """One pass: N frames with their true poses, K recorded ones."""

    time_s: Shaped[Float, " N"]  # as recorded
    base_from_profiler: Shaped[Float, "N 4 4"]  # true
    pose_time_s: Shaped[Float, " K"]
    position_mm: Shaped[Float, "K 3"]  # flange in the base, as recorded
    quaternion_wxyz: Shaped[Float, "K 4"]


def move(recipe: Recipe, surface: raycast.Surface, index: int, start_s: float, repeat: int = 0) -> PassMotion:
    """The motion of pass `index`, which begins at `start_s`. Each `repeat` of a scan draws other errors."""
    scan, robot = recipe.passes[index], recipe.robot
    rng = generator(recipe, 1, index, repeat=repeat)
    length = abs(scan.to_mm - scan.from_mm)
    frames = math.floor(length / robot.frame_pitch_mm + 1e-9) + 1
    time = start_s + np.arange(frames) / robot.frame_rate_hz
    pose_time = _pose_times(scan, robot.pose_rate_hz, time)
    speed = robot.frame_rate_hz * robot.frame_pitch_mm
    travelled, pose_travelled = (time - start_s) * speed, (pose_time - start_s) * speed

    poses_at = _line if scan.follow == "line" else _along_edge
    flange_from_profiler = pose(robot.flange_from_profiler)
    true = poses_at(recipe, surface, scan, travelled / length) @ flange_from_profiler
    true[:, :3, 3] += _smooth_error(recipe, rng, travelled)
    true[:, :3, 3] += rng.normal(0.0, 1.0, (frames, 3)) * robot.vibration_mm
    position, quaternion = _recorded(recipe, poses_at(recipe, surface, scan, pose_travelled / length), rng)
    return PassMotion(_jittered(time, robot.clock_jitter_s, pose_time, rng), true, pose_time, position, quaternion)


def generator(recipe: Recipe, *key: int, repeat: int = 0) -> np.random.Generator:
    """The random numbers for one purpose, `key`, of the scan that is the `repeat`-th after the first."""
    return np.random.default_rng([recipe.seed, *key, *([repeat] if repeat else [])])


def recorded_hand_eye(recipe: Recipe) -> Float:
    """flange_from_profiler as the recording states it: the true one, off by the recipe's errors (per axis)."""
    robot, rng = recipe.robot, generator(recipe, 2)
    turn = scipy.spatial.transform.Rotation.from_rotvec(
        rng.normal(0.0, 1.0, 3) * robot.hand_eye_error_deg * DEG
    ).as_matrix()
    shift = rng.normal(0.0, 1.0, 3) * robot.hand_eye_error_mm
    true = pose(robot.flange_from_profiler)
    return pose_from(turn @ true[:3, :3], true[:3, 3] + shift)


def profiler_in_edge(recipe: Recipe, scan: Pass, share: Float) -> Float:
    """edge_from_profiler (n, 4, 4) where `share` (n,) of the pass is done.

    The range axis points at the edge from in front, `elevation_deg` above the end face's horizontal normal; the
    laser plane is then turned about it by `oblique_deg`, and the scanner leans along the edge by `lead_deg`.
    """
    scanner, elevation = recipe.scanner, scan.elevation_deg * DEG
    away = np.array([-math.cos(elevation), 0.0, -math.sin(elevation)])
    lateral = np.array([-math.sin(elevation), 0.0, math.cos(elevation)])
    turn = scipy.spatial.transform.Rotation.from_rotvec(
        scan.lead_deg * DEG * lateral
    ) * scipy.spatial.transform.Rotation.from_rotvec(scan.oblique_deg * DEG * away)
    z = away if scanner.z_away else -away
    x = -lateral if scan.upside_down else lateral
    nominal = turn.as_matrix() @ np.stack([x, np.cross(z, x), z], axis=1)

    rotation = (
        nominal
        @ scipy.spatial.transform.Rotation.from_rotvec(np.outer(share, np.array(scan.turn_deg) * DEG)).as_matrix()
    )
    skew = scan.skew_mm[0] + (scan.skew_mm[1] - scan.skew_mm[0]) * share
    aim = np.array([scan.aim_mm[0], 0.0, scan.aim_mm[1]]) + skew[:, None] * nominal[:, 0]
    sign = 1.0 if scanner.z_away else -1.0
    aim_in_profiler = np.array([scanner.x_offset_mm, 0.0, sign * (scanner.standoff_mm - scanner.zero_range_mm)])
    return pose_from(rotation, aim - rotation @ aim_in_profiler)


def _along_edge(recipe: Recipe, surface: raycast.Surface, scan: Pass, share: Float) -> Float:
    """base_from_flange (n, 4, 4) while the scanner keeps its pose relative to the edge."""
    part_from_edge = edge_frames(surface, scan.from_mm + share * (scan.to_mm - scan.from_mm))
    base_from_profiler = pose(recipe.part.base_from_part) @ part_from_edge @ profiler_in_edge(recipe, scan, share)
    return np.asarray(base_from_profiler @ inverse(pose(recipe.robot.flange_from_profiler)))


def _line(recipe: Recipe, surface: raycast.Surface, scan: Pass, share: Float) -> Float:
    """base_from_flange (n, 4, 4) on a straight uniform motion along the chord: position linear, orientation slerp."""
    ends = edge_frames(surface, np.array([scan.from_mm, scan.to_mm]))
    chord = (ends[1, :3, 3] - ends[0, :3, 3]) * np.sign(scan.to_mm - scan.from_mm)
    chord /= np.linalg.norm(chord)
    ends[:, :3, 0], ends[:, :3, 1] = (chord[1], -chord[0], 0.0), chord
    base_from_profiler = pose(recipe.part.base_from_part) @ ends @ profiler_in_edge(recipe, scan, np.array([0.0, 1.0]))
    flange = base_from_profiler @ inverse(pose(recipe.robot.flange_from_profiler))
    turned = (
        scipy.spatial.transform.Rotation.from_matrix(flange[0, :3, :3]).inv()
        * scipy.spatial.transform.Rotation.from_matrix(flange[1, :3, :3])
    ).as_rotvec()
    rotation = flange[0, :3, :3] @ scipy.spatial.transform.Rotation.from_rotvec(np.outer(share, turned)).as_matrix()
    return pose_from(rotation, flange[0, :3, 3] + share[:, None] * (flange[1, :3, 3] - flange[0, :3, 3]))


def _pose_times(scan: Pass, rate_hz: float, time: Float) -> Float:
    """When poses are recorded: at both ends, on the robot's own raster around the pass, or with each frame."""
    if scan.motion == "two_poses":
        return np.array([time[0], time[-1]]) if len(time) > 1 else np.array([time[0], time[0] + 1.0 / rate_hz])
    if scan.motion == "stop_and_go":
        return time.copy()
    first = math.floor(time[0] * rate_hz - 0.3)
    return (np.arange(first, math.ceil(time[-1] * rate_hz) + 2) + 0.3) / rate_hz


def _recorded(recipe: Recipe, base_from_flange: Float, rng: np.random.Generator) -> tuple[Float, Float]:
    """Flange positions and quaternions with the robot's pose noise, each pose by itself."""
    robot, count = recipe.robot, len(base_from_flange)
    position = base_from_flange[:, :3, 3] + rng.normal(0.0, 1.0, (count, 3)) * robot.pose_noise_mm
    noise = scipy.spatial.transform.Rotation.from_rotvec(rng.normal(0.0, 1.0, (count, 3)) * robot.pose_noise_deg * DEG)
    quaternion = (noise * scipy.spatial.transform.Rotation.from_matrix(base_from_flange[:, :3, :3])).as_quat(
        scalar_first=True
    )
    return position, np.asarray(quaternion)


def _smooth_error(recipe: Recipe, rng: np.random.Generator, travelled_mm: Float) -> Float:
    """The robot's smooth error (n, 3) in the base: one sine an axis over the way travelled, in no recorded pose."""
    shortest, longest = recipe.robot.smooth_error_wavelength_mm
    wavelength, phase = rng.uniform(shortest, longest, 3), rng.uniform(0, 2 * math.pi, 3)
    return recipe.robot.smooth_error_mm * np.sin(2 * math.pi * travelled_mm[:, None] / wavelength + phase)


def _jittered(time: Float, jitter_s: float, pose_time: Float, rng: np.random.Generator) -> Float:
    """Recorded times: off by `jitter_s` (one sigma, at most 0.4 of a frame), still rising, within the pose times."""
    if jitter_s == 0.0 or len(time) < 2:
        return time
    limit = 0.4 * (time[1] - time[0])
    return np.clip(time + np.clip(rng.normal(0.0, jitter_s, len(time)), -limit, limit), pose_time[0], pose_time[-1])
