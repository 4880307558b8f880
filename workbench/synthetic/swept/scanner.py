"""The scanner: how the robot carries it, and what laser and camera see of the part, column by column."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
import scipy

from workbench.geometry.poses import inverse, pose_from, rotation_from_rpy
from workbench.synthetic.recipe import Placement
from workbench.synthetic.swept.mesh import OTHER, Hits, Mesh, Relief
from workbench.synthetic.swept.recipe import AnyRecipe, SweptScanner, Way
from workbench.synthetic.swept.sweep import Curve
from workbench.units import DEG, AnyArray, Bool, Float, Shaped

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


SUBRAYS = 9  # odd: half of a footprint is filled just where its middle is
JUMP_MM = 0.15  # neighbours further apart may be two sides of an edge: their footprint is looked at ray by ray
LEAST_COSINE = 0.2  # a texture's height is divided by the cosine of the incidence, but not below


@dataclass(frozen=True, slots=True, eq=False)
class Profiles:
    """What frames see before noise: (n, M), or all returns in a row."""

    range_mm: Shaped[Float, "*n"]  # from the laser; NaN: nothing
    cosine: Shaped[Float, "*n"]
    fill: Shaped[Float, "*n"]  # share of the footprint that the return comes from
    face: Shaped[AnyArray, "*n"]  # uint8
    s: Shaped[Float, "*n"]
    share: Shaped[Float, "*n"]  # across the face


Spoil = Callable[[Hits, Float, Float, np.random.Generator], Float]  # hits, points (k, 3), ways (k, 3) -> what is added


@dataclass(frozen=True, slots=True, eq=False)
class View:
    """The part before the scanner."""

    mesh: Mesh
    scanner: SweptScanner
    texture: Mapping[int, Relief]  # by face
    spoil: Spoil  # what ghosts and reflections add to the ranges
    rng: np.random.Generator


def see(view: View, pose: Float) -> Profiles:
    """The profiles of n frames with poses part_from_profiler (n, 4, 4)."""
    frames, columns = len(pose), view.scanner.columns
    index = np.repeat(np.arange(frames), columns)
    centre = _look(view, pose, index, np.tile(np.arange(columns, dtype=float), frames))
    grid = {name: getattr(centre, name).reshape(frames, columns) for name in Profiles.__slots__}
    if view.scanner.footprint > 0:
        _pixels_at_edges(view, grid, pose)
    return Profiles(**grid)


def _look(view: View, pose: Float, index: AnyArray, column: Float) -> Profiles:
    """Rays by frame `index` (k,) and fractional `column` (k,)."""
    scanner, mesh = view.scanner, view.mesh
    start, way = _lines(scanner, column)
    rotation, translation = pose[:, :3, :3], pose[:, :3, 3]
    start, way = _turned(rotation, start, index) + translation[index], _turned(rotation, way, index)
    hits = mesh.cast(start, way)
    found = np.isfinite(hits.reach) & (hits.reach <= scanner.far_mm - scanner.near_mm)
    found &= hits.cosine > np.cos(np.radians(scanner.max_incidence_deg))
    point = start + np.where(found, hits.reach, 0.0)[:, None] * way
    laser, camera = translation + rotation @ _eyes(scanner), translation + rotation @ _camera(scanner)
    lit = mesh.open_way(point[found], laser[index[found]])
    lit[lit] = mesh.open_way(point[found][lit], camera[index[found][lit]])
    found[found] = lit
    reach = np.where(found, hits.reach + scanner.near_mm, np.nan)
    reach -= _relief(hits, view.texture) / np.maximum(hits.cosine, LEAST_COSINE)
    reach += view.spoil(hits, point, way, view.rng)
    face = np.where(found, hits.face, OTHER).astype(np.uint8)
    return Profiles(reach, hits.cosine, found.astype(float), face, hits.s, hits.share)


def column_places(scanner: SweptScanner, column: Float, range_mm: Float) -> Float:
    """x (mm) of what lies at a range on the line of a (fractional) column."""
    at_standoff = (column - (scanner.columns - 1) / 2) * scanner.pitch_mm * (1.0 if scanner.x_rises else -1.0)
    if scanner.apex_mm is None:
        return np.asarray(at_standoff + 0.0 * range_mm)
    return np.asarray(at_standoff * (range_mm + scanner.apex_mm) / (scanner.standoff_mm + scanner.apex_mm))


def _lines(scanner: SweptScanner, column: Float) -> tuple[Float, Float]:
    """Starts (k, 3) at the near range and ways (k, 3) per mm of range, profiler frame."""
    sign = 1.0 if scanner.z_away else -1.0
    near, far = (column_places(scanner, column, np.asarray(r)) for r in (scanner.near_mm, scanner.near_mm + 1.0))
    zero = np.zeros_like(column)
    start = np.stack([near, zero, sign * (scanner.near_mm - scanner.zero_range_mm) + zero], axis=1)
    return start, np.stack([far - near, zero, sign + zero], axis=1)


def _eyes(scanner: SweptScanner) -> Float:
    """The laser (3,), profiler frame."""
    return np.array([0.0, 0.0, -(1.0 if scanner.z_away else -1.0) * scanner.zero_range_mm])


def _camera(scanner: SweptScanner) -> Float:
    offset = np.array([0.0, scanner.baseline_mm, 0.0])
    return np.asarray(_eyes(scanner) + offset)


def _turned(rotation: Float, vector: Float, index: AnyArray) -> Float:
    return np.asarray(np.matmul(rotation[index], vector[:, :, None])[..., 0])


def _relief(hits: Hits, texture: Mapping[int, Relief]) -> Float:
    height = np.zeros(len(hits.s))
    for face, relief in texture.items():
        on = hits.face == face
        height[on] = relief.at(hits.s[on], hits.across_mm[on])
    return height


def _pixels_at_edges(view: View, grid: dict[str, AnyArray], pose: Float) -> None:
    """Columns that may see an edge, in place: several rays over the footprint, their fill, mean, or mixture."""
    scanner = view.scanner
    frame, column = np.nonzero(_at_edges(grid["range_mm"]))
    if not len(frame):
        return
    offsets = ((np.arange(SUBRAYS) + 0.5) / SUBRAYS - 0.5) * scanner.footprint
    rays = _look(view, pose, np.repeat(frame, SUBRAYS), (column[:, None] + offsets).ravel())
    ranges = rays.range_mm.reshape(-1, SUBRAYS)
    order = np.argsort(ranges, axis=1)  # NaN last
    ranges = np.take_along_axis(ranges, order, axis=1)
    seen = np.isfinite(ranges).sum(axis=1)
    gaps = np.where(np.isfinite(np.diff(ranges, axis=1)), np.diff(ranges, axis=1), 0.0)
    cut = gaps.argmax(axis=1) + 1  # the nearer side has so many rays
    two = gaps.max(axis=1) > JUMP_MM
    near = np.where(two, cut, seen)
    keep_far = two & (seen - near > near)
    mixed = two & (view.rng.random(len(seen)) < scanner.mixed_share)
    first = np.where(keep_far & ~mixed, near, 0)
    last = np.where(two & ~mixed & ~keep_far, near, seen)
    place = np.arange(SUBRAYS)
    chosen = (place >= first[:, None]) & (place < last[:, None])
    count = chosen.sum(axis=1)
    fill = count / SUBRAYS
    good = (fill >= scanner.least_fill) & (count > 0)

    def mean(values: AnyArray) -> Float:
        ordered = np.take_along_axis(values.reshape(-1, SUBRAYS), order, axis=1)
        return np.asarray(np.where(chosen, ordered, 0.0).sum(axis=1) / np.maximum(count, 1))

    first_chosen = np.take_along_axis(order, np.minimum(first, SUBRAYS - 1)[:, None], axis=1)[:, 0]
    face = rays.face.reshape(-1, SUBRAYS)[np.arange(len(seen)), first_chosen]
    grid["range_mm"][frame, column] = np.where(good, mean(np.nan_to_num(rays.range_mm)), np.nan)
    grid["cosine"][frame, column] = mean(rays.cosine)
    grid["fill"][frame, column] = np.where(good, fill, 0.0)
    grid["face"][frame, column] = np.where(good & ~mixed, face, OTHER)
    grid["s"][frame, column], grid["share"][frame, column] = mean(rays.s), mean(rays.share)


def _at_edges(ranges: Float) -> Bool:
    """Columns beside a jump or beside the end of returns."""
    step = np.diff(ranges, axis=1)
    there = np.isfinite(ranges)
    jump = (there[:, 1:] != there[:, :-1]) | (np.abs(np.nan_to_num(step)) > JUMP_MM)
    at = np.zeros(ranges.shape, dtype=bool)
    at[:, 1:] |= jump
    at[:, :-1] |= jump
    return at
