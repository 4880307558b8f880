"""The scan: how the robot carries the scanner, and what it returns of exact ranges, frame by frame, block by block."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import scipy

from workbench.artefacts import Part, Recording, ScanCourse
from workbench.geometry.moves import arc_lengths_mm
from workbench.geometry.poses import inverse, pose_from
from workbench.kernels import kernel
from workbench.recording_file import Frames
from workbench.synthetic import raycast
from workbench.synthetic.recipe import Disturbances, Motion, Noise, Pass, Recipe, Scanner, SphereRecipe
from workbench.synthetic.workpiece import Cut, build_surface, clamp_boxes, edge_frames, pose
from workbench.units import DEG, AnyArray, Bool, Float, Float32, Shaped


@dataclass(frozen=True, slots=True, eq=False)
class Logged:
    """One pass of N frames as it is recorded: K poses."""

    time_s: Shaped[Float, " N"]
    pose_time_s: Shaped[Float, " K"]
    position_mm: Shaped[Float, "K 3"]  # flange in the base
    quaternion_wxyz: Shaped[Float, "K 4"]


@dataclass(frozen=True, slots=True, eq=False)
class PassMotion(Logged):
    """And where its frames are."""

    base_from_profiler: Shaped[Float, "N 4 4"]  # true


def move(recipe: Recipe, surface: raycast.Surface, index: int, start_s: float, repeat: int = 0) -> PassMotion:
    """The motion of pass `index`, which begins at `start_s`. Each `repeat` of a scan draws other errors."""
    scan = recipe.passes[index]
    poses_at = _line if scan.follow == "line" else _along_edge
    whole = _Whole(abs(scan.to_mm - scan.from_mm), recipe.robot.frame_pitch_mm, scan.motion, start_s)
    rng = generator(recipe, 1, index, repeat=repeat)
    return _driven(recipe, lambda share: poses_at(recipe, surface, scan, share), whole, rng)


def follow(recipe: Recipe, course: ScanCourse, index: int, start_s: float, repeat: int = 0) -> PassMotion:
    """The motion of a planned pass, likewise; its poses are logged as a stream."""
    positions = course.base_from_profiler[:, :3, 3]
    along = arc_lengths_mm(positions)
    turns = scipy.spatial.transform.Slerp(
        along, scipy.spatial.transform.Rotation.from_matrix(course.base_from_profiler[:, :3, :3])
    )
    back = inverse(pose(recipe.robot.flange_from_profiler))

    def poses_at(share: Float) -> Float:
        at = share * along[-1]
        inside = np.clip(at, 0.0, along[-1])
        place = np.stack([np.interp(inside, along, positions[:, k]) for k in range(3)], axis=1)
        ends = np.where(at < 0.0, 0, -1)
        way = np.stack([positions[1] - positions[0], positions[-1] - positions[-2]])[ends]
        way /= np.linalg.norm(way, axis=1)[:, None]
        beyond = (at - inside)[:, None] * way  # poses are logged before and after the pass too
        return np.asarray(pose_from(turns(inside).as_matrix(), place + beyond) @ back)

    whole = _Whole(float(along[-1]), course.frame_pitch_mm, "stream", start_s)
    return _driven(recipe, poses_at, whole, generator(recipe, 1, index, repeat=repeat))


class _Whole(NamedTuple):
    """A pass as a whole."""

    length_mm: float
    frame_pitch_mm: float
    motion: Motion
    start_s: float


def _driven(recipe: Recipe, poses_at: Callable[[Float], Float], whole: _Whole, rng: np.random.Generator) -> PassMotion:
    """Along base_from_flange (n, 4, 4) where shares (n,) of the pass are done, with the robot's errors."""
    robot, length = recipe.robot, whole.length_mm
    frames = math.floor(length / whole.frame_pitch_mm + 1e-9) + 1
    time = whole.start_s + np.arange(frames) / robot.frame_rate_hz
    pose_time = _pose_times(whole.motion, robot.pose_rate_hz, time)
    speed = robot.frame_rate_hz * whole.frame_pitch_mm
    travelled, pose_travelled = (time - whole.start_s) * speed, (pose_time - whole.start_s) * speed
    true = poses_at(travelled / length) @ pose(robot.flange_from_profiler)
    true[:, :3, 3] += _smooth_error(recipe, rng, travelled)
    true[:, :3, 3] += rng.normal(0.0, 1.0, (frames, 3)) * robot.vibration_mm
    position, quaternion = _recorded(recipe, poses_at(pose_travelled / length), rng)
    return PassMotion(_jittered(time, robot.clock_jitter_s, pose_time, rng), pose_time, position, quaternion, true)


def generator(recipe: Recipe, *key: int, repeat: int = 0) -> np.random.Generator:
    """The random numbers for one purpose, `key`, of the scan that is the `repeat`-th after the first."""
    return np.random.default_rng([recipe.seed, *key, *([repeat] if repeat else [])])


def recorded_hand_eye(recipe: Recipe, key: int = 2) -> Float:
    """flange_from_profiler as the recording states it: the true one, off by the recipe's errors (per axis)."""
    robot, rng = recipe.robot, generator(recipe, key)
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
    rotvec = (
        scipy.spatial.transform.Rotation.from_matrix(flange[0, :3, :3]).inv()
        * scipy.spatial.transform.Rotation.from_matrix(flange[1, :3, :3])
    ).as_rotvec()
    rotation = flange[0, :3, :3] @ scipy.spatial.transform.Rotation.from_rotvec(np.outer(share, rotvec)).as_matrix()
    return pose_from(rotation, flange[0, :3, 3] + share[:, None] * (flange[1, :3, 3] - flange[0, :3, 3]))


def _pose_times(motion: Motion, rate_hz: float, time: Float) -> Float:
    """When poses are recorded: at both ends, on the robot's own raster around the pass, or with each frame."""
    if motion == "two_poses":
        return np.array([time[0], time[-1]]) if len(time) > 1 else np.array([time[0], time[0] + 1.0 / rate_hz])
    if motion == "stop_and_go":
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
    """The robot's smooth error (n, 3) in the base: one sine per axis over the way travelled, in no recorded pose."""
    shortest, longest = recipe.robot.smooth_error_wavelength_mm
    wavelength, phase = rng.uniform(shortest, longest, 3), rng.uniform(0, 2 * math.pi, 3)
    return recipe.robot.smooth_error_mm * np.sin(2 * math.pi * travelled_mm[:, None] / wavelength + phase)


def _jittered(time: Float, jitter_s: float, pose_time: Float, rng: np.random.Generator) -> Float:
    """Recorded times: off by `jitter_s` (one sigma, at most 0.4 of a frame), still rising, within the pose times."""
    if jitter_s == 0.0 or len(time) < 2:
        return time
    limit = 0.4 * (time[1] - time[0])
    return np.clip(time + np.clip(rng.normal(0.0, jitter_s, len(time)), -limit, limit), pose_time[0], pose_time[-1])


_STREAK_COLUMNS = (4, 30)  # greatest and least extent of a streak, [low, high)
_STREAK_FRAMES = (1, 5)


def disturb(recipe: Recipe | SphereRecipe, ranges: Float, cosines: Float, rng: np.random.Generator) -> Float:
    """Ranges (frames, columns) as returned; NaN where there is no return. `ranges` are exact."""
    what = recipe.disturbances
    mixed = _mix_pixels(ranges, what, rng)
    noisy = mixed + _noise(cosines, recipe.scanner.noise, rng)
    noisy = noisy + _outliers(ranges.shape, what, rng)
    noisy[_dropouts(cosines, what, rng)] = np.nan
    if recipe.scanner.quantum_mm > 0:
        noisy = np.round(noisy / recipe.scanner.quantum_mm) * recipe.scanner.quantum_mm
    return np.asarray(noisy)


def intensities(ranges: Float, cosines: Float, rng: np.random.Generator) -> AnyArray:
    """Intensity (frames, columns) uint16: Lambert's law times speckle; 0 where there is no return."""
    speckle = rng.gamma(16.0, 1 / 16.0, ranges.shape)
    return np.where(np.isnan(ranges), 0.0, np.clip(30000.0 * cosines * speckle, 1, 65535)).astype(np.uint16)


def _noise(cosines: Float, noise: Noise, rng: np.random.Generator) -> Float:
    """Range noise that grows with grazing incidence; first-order autoregressive along the columns where correlated."""
    white = rng.standard_normal(cosines.shape)
    if noise.correlation_columns > 0:
        _correlate(white, math.exp(-1.0 / noise.correlation_columns))
    if noise.grazing_power == 0:
        return white * noise.sd_mm
    lowest = noise.grazing_cap ** (-1.0 / noise.grazing_power)
    return np.asarray(white * (noise.sd_mm * np.maximum(cosines, lowest) ** -noise.grazing_power))


@kernel
def _correlate(white: Float, keep: float) -> None:
    """In place: e[j] = keep e[j-1] + sqrt(1 - keep^2) white[j], of unit variance."""
    fresh = math.sqrt(1.0 - keep * keep)
    for i in range(white.shape[0]):
        for j in range(1, white.shape[1]):
            white[i, j] = keep * white[i, j - 1] + fresh * white[i, j]


def _mix_pixels(ranges: Float, what: Disturbances, rng: np.random.Generator) -> Float:
    """A column whose spot straddles a jump in depth may return a range between the two."""
    step = np.diff(ranges, axis=1)
    rows, columns = np.nonzero(np.abs(step) > what.mixed_pixel_jump_mm)
    chosen = rng.random(len(rows)) < what.mixed_pixel_probability
    rows, columns = rows[chosen], columns[chosen]
    weight, after = rng.uniform(0.05, 0.95, len(rows)), rng.integers(0, 2, len(rows))
    mixed = ranges.copy()
    mixed[rows, columns + after] = ranges[rows, columns] + weight * step[rows, columns]
    return mixed


def _outliers(shape: tuple[int, ...], what: Disturbances, rng: np.random.Generator) -> Float:
    """What outliers add to the ranges: isolated ones uniform within the reach, streaks a ramp with speckle."""
    added = np.zeros(shape)
    flat = added.reshape(-1)
    where = np.flatnonzero(rng.random(flat.size) < what.outlier_share) if what.outlier_share > 0 else np.zeros(0, int)
    flat[where] = rng.uniform(-what.outlier_reach_mm, what.outlier_reach_mm, len(where))
    for rows, columns in _streaks(shape, what.streak_outlier_share, rng):
        size = added[rows, columns].shape
        ends = rng.uniform(-what.outlier_reach_mm, what.outlier_reach_mm) * rng.uniform(0.5, 1.0, 2)
        added[rows, columns] = np.linspace(ends[0], ends[1], size[1]) + rng.normal(0.0, 0.1, size)
    return added


def _dropouts(cosines: Float, what: Disturbances, rng: np.random.Generator) -> Bool:
    """Where returns are lost: at random, the more grazing the likelier, and in streaks."""
    share = what.dropout_share + what.grazing_dropout * (1.0 - cosines) ** 3
    lost = rng.random(cosines.shape) < share
    for rows, columns in _streaks(cosines.shape, what.streak_dropout_share, rng):
        lost[rows, columns] = True
    return np.asarray(lost)


def _streaks(shape: tuple[int, ...], share: float, rng: np.random.Generator) -> list[tuple[slice, slice]]:
    """Runs of columns over one or several frames that cover about `share` of the grid."""
    size = (sum(_STREAK_COLUMNS) - 1) / 2 * (sum(_STREAK_FRAMES) - 1) / 2
    count = rng.poisson(share * shape[0] * shape[1] / size)
    first = rng.integers(0, shape, (count, 2))
    extent = rng.integers((_STREAK_FRAMES[0], _STREAK_COLUMNS[0]), (_STREAK_FRAMES[1], _STREAK_COLUMNS[1]), (count, 2))
    return [(slice(i, i + n), slice(j, j + m)) for (i, j), (n, m) in zip(first, extent, strict=True)]


BLOCK_FRAMES = 256
_PAUSE_S = 2.0  # between passes


@dataclass(frozen=True, slots=True, eq=False)
class Block:
    """Some frames of one pass, as returned."""

    x_mm: Shaped[Float32, "B M"]
    z_mm: Shaped[Float32, "B M"]
    intensity: Shaped[AnyArray, "B M"] | None  # uint16
    faces: Shaped[AnyArray, "B M"]  # uint8, the true face of each ray (`raycast.ROOT`, ...)
    seen_u: Float  # where those frames that see the edge cross it


def plan_motion(
    recipe: Recipe, cut: Cut | None = None, courses: Sequence[ScanCourse] | None = None
) -> list[PassMotion]:
    """The motion of every pass, one after the other in time, past the part less what was cut.

    courses: passes that were planned; None: those of the recipe.
    """
    surface, motions, start = build_surface(recipe.part, recipe.seed), list[PassMotion](), 1.0
    for index in range(len(recipe.passes if courses is None else courses)):
        if courses is None:
            motions.append(move(recipe, surface, index, start, _repeat(cut)))
        else:
            motions.append(follow(recipe, courses[index], index, start, _repeat(cut)))
        start = float(max(motions[-1].time_s[-1], motions[-1].pose_time_s[-1])) + _PAUSE_S
    return motions


def scan_pass(recipe: Recipe, motion: PassMotion, index: int, cut: Cut | None = None) -> Iterator[tuple[int, Block]]:
    """The frames of pass `index` block by block: first frame, block. Random numbers are drawn per block."""
    surface = build_surface(recipe.part, recipe.seed, cut)
    boxes, sensor = clamp_boxes(recipe.part, surface), sensor_of(recipe.scanner)
    table = -np.inf if recipe.part.table_gap_mm is None else -recipe.part.table_gap_mm
    offsets = column_offsets(recipe.scanner)
    profiler_from = inverse(pose(recipe.part.base_from_part))
    for number, first in enumerate(range(0, len(motion.time_s), BLOCK_FRAMES)):
        part_from_profiler = profiler_from @ motion.base_from_profiler[first : first + BLOCK_FRAMES]
        exact, faces, cosines, sight = raycast.cast(surface, boxes, table, sensor, part_from_profiler, offsets)
        rng = generator(recipe, 3, index, number, repeat=_repeat(cut))
        ranges = disturb(recipe, exact, cosines, rng)
        x, z = coordinates(sensor, ranges, offsets)
        seen = (sight[:, 0] >= 2) & (sight[:, 2] < 0.4 * recipe.part.root_mm.lowest)
        if surface.milled or cut is not None:
            seen &= sight[:, 1] >= 2
        grey = intensities(ranges, cosines, rng) if recipe.scanner.intensity else None
        yield first, Block(x, z, grey, faces, sight[seen, 3])


def _repeat(cut: Cut | None) -> int:
    return 0 if cut is None else cut.times


def sensor_of(scanner: Scanner) -> raycast.Sensor:
    """The scanner as the kernels see it."""
    sign = 1.0 if scanner.z_away else -1.0
    return raycast.Sensor(
        sign=sign,
        emitter_x=scanner.x_offset_mm,
        emitter_z=-sign * scanner.zero_range_mm,
        baseline=scanner.baseline_mm,
        near=scanner.near_mm,
        far=scanner.far_mm,
        fan=scanner.beam == "fan" or scanner.sampling == "angular",
        angular=scanner.sampling == "angular",
        cos_min=float(np.cos(np.radians(scanner.max_incidence_deg))),
    )


def column_offsets(scanner: Scanner) -> Float:
    """Lateral position of each column from the emitter (mm), or the tangent of its angle, `pitch_mm` at standoff."""
    offsets = (np.arange(scanner.columns) - (scanner.columns - 1) / 2) * scanner.pitch_mm
    if not scanner.x_rises:
        offsets = -offsets
    return np.asarray(np.tan(offsets / scanner.standoff_mm) if scanner.sampling == "angular" else offsets)


def coordinates(sensor: raycast.Sensor, ranges: Float, offsets: Float) -> tuple[Float32, Float32]:
    """x and z in the profiler frame, mm."""
    z = sensor.emitter_z + sensor.sign * ranges
    lateral = ranges * offsets if sensor.angular else np.broadcast_to(offsets, ranges.shape)
    return (sensor.emitter_x + lateral).astype(np.float32), z.astype(np.float32)


def rays(sensor: raycast.Sensor, offsets: Float) -> tuple[Float, Float, list[Float]]:
    """Origins and directions (M, 3) of the columns' rays in the profiler frame, a mm of range each; who must see (3,).

    A point counts where the camera sees it, and the emitter where its rays are no straight lines from it.
    """
    emitter, lateral = np.array([sensor.emitter_x, 0.0, sensor.emitter_z]), np.zeros((len(offsets), 3))
    lateral[:, 0] = offsets
    ahead, still = np.array([0.0, 0.0, sensor.sign]), np.zeros_like(lateral)
    eyes = [emitter + np.array([0.0, sensor.baseline, 0.0])]
    if sensor.angular:
        return emitter + still, ahead + lateral, eyes
    return emitter + lateral, ahead + still, [*eyes, emitter] if sensor.fan else eyes


def entry(a: Float, b: Float, c: Float, after: float) -> Float:
    """Smallest root beyond `after` of a s^2 + 2 b s + c, where a ray enters a body; infinite for none."""
    with np.errstate(invalid="ignore", divide="ignore"):
        s = (-b - np.sqrt(b * b - a * c)) / a
    return np.where(np.isfinite(s) & (s > after), s, np.inf)


def recorded(
    motions: Sequence[Logged], grids: Frames, hand_eye: Float, part_id: str | None = None, **more: Any
) -> Recording:
    """The recording of these passes; `more`: further fields of it."""
    frames, poses = [len(m.time_s) for m in motions], [len(m.pose_time_s) for m in motions]
    return Recording(
        source="synthetic",
        time_s=np.concatenate([m.time_s for m in motions]),
        x_mm=grids.x_mm,
        z_mm=grids.z_mm,
        pass_index=np.repeat(np.arange(len(motions)), frames),
        robot_time_s=np.concatenate([m.pose_time_s for m in motions]),
        robot_position_mm=np.concatenate([m.position_mm for m in motions]),
        robot_quaternion_wxyz=np.concatenate([m.quaternion_wxyz for m in motions]),
        robot_pass=np.repeat(np.arange(len(motions)), poses),
        flange_from_profiler=hand_eye,
        intensity=grids.intensity,
        part=Part(part_id=part_id, sensor="synthetic", robot="synthetic", simulated=True),
        **more,
    )
