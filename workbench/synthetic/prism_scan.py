"""Scanning a straight groove of the first simulator, and its truth."""

from __future__ import annotations

import numpy as np

from workbench.artefacts import Part, Recording
from workbench.geometry.poses import inverse
from workbench.synthetic.motion import generator, move, recorded_hand_eye
from workbench.synthetic.prism import LEFT, LEFT_TOP, RIGHT, RIGHT_TOP, course_at, enter, plate_at, sees
from workbench.synthetic.prism_recipe import SQUARE, PrismGroove, PrismRecipe
from workbench.synthetic.raycast import Sensor
from workbench.synthetic.returns import disturb, intensities
from workbench.synthetic.scan import column_offsets, sensor_of
from workbench.synthetic.surface import build_surface, pose
from workbench.synthetic.swept.groove import GrooveSizes
from workbench.synthetic.swept.truth import GrooveTruth
from workbench.units import DEG, Float

BLOCK_FRAMES = 32
STATION_MM = 0.25
_PAUSE_S = 2.0


def simulate_prism(recipe: PrismRecipe) -> tuple[Recording, GrooveTruth]:
    """The recording of a straight groove, and its truth. The same recipe gives the same numbers."""
    plate = recipe.on_plate()
    surface, sensor, offsets = (
        build_surface(plate.part, plate.seed),
        sensor_of(recipe.scanner),
        column_offsets(recipe.scanner),
    )
    part_from_base = inverse(pose(recipe.groove.base_from_part))
    motions, xs, zs, light, seen, start = [], [], [], [], [], 1.0
    for index in range(len(recipe.passes)):
        motion = move(plate, surface, index, start)
        start = float(max(motion.time_s[-1], motion.pose_time_s[-1])) + _PAUSE_S
        motions.append(motion)
        here = []
        for number, first in enumerate(range(0, len(motion.time_s), BLOCK_FRAMES)):
            poses = part_from_base @ motion.base_from_profiler[first : first + BLOCK_FRAMES]
            exact, cosines, what, x_part = cast(recipe.groove, sensor, poses, offsets)
            rng = generator(plate, 3, index, number)
            ranges = disturb(plate, exact, cosines, rng)
            if recipe.scanner.intensity:
                light.append(intensities(ranges, cosines, rng))
            lateral = ranges * offsets if sensor.angular else np.broadcast_to(offsets, ranges.shape)
            xs.append((sensor.emitter_x + lateral).astype(np.float32))
            zs.append((sensor.emitter_z + sensor.sign * ranges).astype(np.float32))
            here.append(_seen_x(recipe.groove, what, x_part))
        seen.append(np.concatenate(here))
    counts, poses_of = [len(m.time_s) for m in motions], [len(m.pose_time_s) for m in motions]
    recording = Recording(
        source="synthetic",
        time_s=np.concatenate([m.time_s for m in motions]),
        x_mm=np.concatenate(xs),
        z_mm=np.concatenate(zs),
        pass_index=np.repeat(np.arange(len(counts)), counts),
        robot_time_s=np.concatenate([m.pose_time_s for m in motions]),
        robot_position_mm=np.concatenate([m.position_mm for m in motions]),
        robot_quaternion_wxyz=np.concatenate([m.quaternion_wxyz for m in motions]),
        robot_pass=np.repeat(np.arange(len(poses_of)), poses_of),
        flange_from_profiler=recorded_hand_eye(plate),
        intensity=np.concatenate(light) if light else None,
        part=Part(part_id=recipe.part_id, sensor="synthetic", robot="synthetic", simulated=True),
    )
    return recording, prism_truth(recipe, seen)


def cast(groove: PrismGroove, sensor: Sensor, pose_of: Float, offsets: Float) -> tuple[Float, Float, Float, Float]:
    """Range of every ray (n, M; NaN: no return), cos(incidence), what it meets, x of the part there."""
    shape = (len(pose_of), len(offsets))
    emitter = np.array([sensor.emitter_x, 0.0, sensor.emitter_z])
    lateral = np.zeros((len(offsets), 3))
    lateral[:, 0] = offsets
    ahead = np.array([0.0, 0.0, sensor.sign])
    origin = emitter + (0.0 * lateral if sensor.angular else lateral)
    way = ahead + (lateral if sensor.angular else 0.0 * lateral)
    turn, shift = pose_of[:, :3, :3], pose_of[:, None, :3, 3]
    start = (np.einsum("nij,mj->nmi", turn, origin) + shift).reshape(-1, 3)
    direction = np.einsum("nij,mj->nmi", turn, way).reshape(-1, 3)
    reach, cosine, what = enter(groove, start, direction, 0.0)
    good = (reach > sensor.near) & (reach < sensor.far) & (cosine >= sensor.cos_min)
    point = start + np.where(good, reach, 0.0)[:, None] * direction
    eyes = [emitter + np.array([0.0, sensor.baseline, 0.0])]
    if sensor.fan and not sensor.angular:
        eyes.append(emitter)
    for eye in eyes:
        target = np.repeat(turn @ eye + pose_of[:, :3, 3], len(offsets), axis=0)
        good[good] = sees(groove, point[good], target[good])
    return (
        np.where(good, reach, np.nan).reshape(shape),
        np.where(good, cosine, 0.0).reshape(shape),
        np.where(good, what, 0).reshape(shape),
        point[:, 0].reshape(shape),
    )


def _seen_x(groove: PrismGroove, what: Float, x: Float) -> Float:
    """Where those frames see the groove that return from both upper surfaces and all bevels."""
    square = SQUARE.get(groove.type, ())
    needed = [LEFT_TOP, RIGHT_TOP]
    needed += [name for name, side in ((LEFT, "left"), (RIGHT, "right")) if side not in square]
    enough = np.all([(what == name).sum(axis=1) >= 2 for name in needed], axis=0)
    used = np.isin(what, needed)
    return np.asarray((np.where(used, x, 0.0).sum(axis=1) / np.maximum(used.sum(axis=1), 1))[enough])


def prism_truth(recipe: PrismRecipe, seen_x: list[Float]) -> GrooveTruth:
    """The truth of a groove: sizes as the recipe states them, corners as the section has them."""
    groove = recipe.groove
    x = np.linspace(0.0, groove.length_mm, round(groove.length_mm / STATION_MM) + 1)
    base = pose(groove.base_from_part)
    seen = np.zeros(len(x), dtype=bool)
    for at in seen_x:
        at = np.concatenate([[-np.inf], np.sort(at), [np.inf]])
        after = np.searchsorted(at, x)
        seen |= np.minimum(x - at[after - 1], at[after] - x) <= 0.75 * recipe.robot.frame_pitch_mm + 1e-9
    zero = np.zeros(len(x))
    return GrooveTruth(
        closed=False,
        arc_length_mm=x,
        position_mm=np.stack([x, zero, zero], axis=1) @ base[:3, :3].T + base[:3, 3],
        tangent=np.tile(base[:3, 0], (len(x), 1)),
        seen=seen,
        spine_mm=x,
        recipe=recipe,
        simulator="analytic",
        type=groove.type,
        normal=np.tile(-base[:3, 1], (len(x), 1)),
        across=np.tile(base[:3, 2], (len(x), 1)),
        sizes=_sizes(groove, x),
        base_from_part=base,
        flange_from_profiler=pose(recipe.robot.flange_from_profiler),
    )


def _sizes(groove: PrismGroove, x: Float) -> GrooveSizes:
    left, right = plate_at(groove, "left", x), plate_at(groove, "right", x)
    raised, none = course_at(groove.misalignment_mm, x, groove.length_mm), np.full(len(x), np.nan)
    has_face = groove.type not in ("I", "V", "HV")
    face = course_at(groove.root_face_mm, x, groove.length_mm) if has_face else none
    two = groove.type in ("V", "Y", "X", "U")
    corners = {f"left_{name}": getattr(left, name) for name in ("upper", "root", "lower")}
    for name in ("root", "lower", "upper"):
        place = getattr(right, name)
        corners[f"right_{name}"] = np.stack([-place[:, 0], place[:, 1] + raised], axis=1)
    return GrooveSizes(
        gap_mm=course_at(groove.gap_mm, x, groove.length_mm),
        root_face_left_mm=face,
        root_face_right_mm=face if two else none,
        bevel_left_deg=left.bevel / DEG,
        bevel_right_deg=right.bevel / DEG,
        included_deg=(left.bevel + (right.bevel if two else 0.0)) / DEG,
        depth_mm=none if groove.type == "I" else left.upper[:, 1] - left.root[:, 1],
        width_mm=corners["right_upper"][:, 0] - corners["left_upper"][:, 0],
        misalignment_mm=raised,
        root_radius_mm=np.full(len(x), groove.radius_mm) if groove.type in ("U", "J") else none,
        corners=corners,
    )
