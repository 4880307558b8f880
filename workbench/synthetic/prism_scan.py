"""Scanning a straight weld groove, and its truth."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from workbench.artefacts import Recording
from workbench.geometry.poses import inverse, mapped
from workbench.recording_file import Frames
from workbench.synthetic.groove_truth import GrooveSizes, GrooveTruth
from workbench.synthetic.raycast import Sensor
from workbench.synthetic.recipe import SQUARE, Course, Mound, PrismGroove, PrismRecipe
from workbench.synthetic.scan import (
    column_offsets,
    coordinates,
    disturb,
    entry,
    generator,
    intensities,
    plan_motion,
    rays,
    recorded,
    recorded_hand_eye,
    sensor_of,
)
from workbench.synthetic.workpiece import pose, seen_near
from workbench.units import DEG, AnyArray, Bool, Float, Shaped

BLOCK_FRAMES = 32
STATION_MM = 0.25


def simulate_prism(recipe: PrismRecipe) -> tuple[Recording, GrooveTruth]:
    """The recording of a straight groove, and its truth. The same recipe gives the same numbers."""
    plate, sensor, offsets = recipe.on_plate(), sensor_of(recipe.scanner), column_offsets(recipe.scanner)
    part_from_base = inverse(pose(recipe.groove.base_from_part))
    motions, blocks, seen = plan_motion(plate), list[tuple[AnyArray, ...]](), list[Float]()
    for index, motion in enumerate(motions):
        here = []
        for number, first in enumerate(range(0, len(motion.time_s), BLOCK_FRAMES)):
            poses = part_from_base @ motion.base_from_profiler[first : first + BLOCK_FRAMES]
            exact, cosines, what, x_part = cast(recipe.groove, sensor, poses, offsets)
            rng = generator(plate, 3, index, number)
            ranges = disturb(plate, exact, cosines, rng)
            light = [intensities(ranges, cosines, rng)] if recipe.scanner.intensity else []
            blocks.append((*coordinates(sensor, ranges, offsets), *light))
            here.append(_seen_x(recipe.groove, what, x_part))
        seen.append(np.concatenate(here))
    x, z, *grey = (np.concatenate(grids) for grids in zip(*blocks, strict=True))
    grids = Frames(x, z, grey[0] if grey else None)
    return recorded(motions, grids, recorded_hand_eye(plate), recipe.part_id), prism_truth(recipe, seen)


def cast(groove: PrismGroove, sensor: Sensor, pose_of: Float, offsets: Float) -> tuple[Float, Float, Float, Float]:
    """Range of every ray (n, M; NaN: no return), cos(incidence), what it meets, x of the part there."""
    shape = (len(pose_of), len(offsets))
    origin, way, eyes = rays(sensor, offsets)
    turn, shift = pose_of[:, :3, :3], pose_of[:, None, :3, 3]
    start = (np.einsum("nij,mj->nmi", turn, origin) + shift).reshape(-1, 3)
    direction = np.einsum("nij,mj->nmi", turn, way).reshape(-1, 3)
    reach, cosine, what = enter(groove, start, direction, 0.0)
    good = (reach > sensor.near) & (reach < sensor.far) & (cosine >= sensor.cos_min)
    point = start + np.where(good, reach, 0.0)[:, None] * direction
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
    zero = np.zeros(len(x))
    return GrooveTruth(
        closed=False,
        arc_length_mm=x,
        position_mm=mapped(base, np.stack([x, zero, zero], axis=1)),
        tangent=np.tile(base[:3, 0], (len(x), 1)),
        seen=seen_near(x, seen_x, recipe.robot.frame_pitch_mm),
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
    raised, none = groove.misalignment_mm.at(x, groove.length_mm), np.full(len(x), np.nan)
    has_face = groove.type not in ("I", "V", "HV")
    face = groove.root_face_mm.at(x, groove.length_mm) if has_face else none
    two = groove.type in ("V", "Y", "X", "U")
    corners = {f"left_{name}": getattr(left, name) for name in ("upper", "root", "lower")}
    for name in ("root", "lower", "upper"):
        place = getattr(right, name)
        corners[f"right_{name}"] = np.stack([-place[:, 0], place[:, 1] + raised], axis=1)
    return GrooveSizes(
        gap_mm=groove.gap_mm.at(x, groove.length_mm),
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


# Rays against a straight weld groove: exact crossings with the lines and arcs of the section where they meet it.
#
# In the section a = -y counts from the left plate to the right one, b = z. Where the section changes along the
# groove, the section at a ray's own x is found by iteration; it converges by the slope of the change, to below 1e-9
# mm.

_ROUNDS = 4  # of the iteration for x
_SLACK = 1e-9  # of a line's length, so that no ray slips through a corner
Hit = tuple[Float, Float, Float | int]  # t (k,), infinite: none; cosine (k,); what
NOTHING, LEFT, RIGHT, LEFT_TOP, RIGHT_TOP, OTHER = range(6)  # what a ray meets: bevels and faces, surfaces, the rest


@dataclass(frozen=True, slots=True, eq=False)
class Plate:
    """A plate's section at k places, drawn as the left one; a plate without a bevel has all on one line."""

    far: Shaped[Float, "k 2 2"]  # ends of the lower and of the upper surface
    foot: Shaped[Float, "k 2"]  # where the lower surface ends
    lower: Shaped[Float, "k 2"]  # lower edge of the root face
    root: Shaped[Float, "k 2"]  # upper edge of the root face
    bend: Shaped[Float, "k 2"]  # where the bevel's straight flank begins
    upper: Shaped[Float, "k 2"]
    centre: Shaped[Float, "k 2"]  # of the fillet; NaN: none
    bevel: Shaped[Float, " k"]  # rad, NaN: none


def plate_at(groove: PrismGroove, side: str, x: Float) -> Plate:
    """The section of the `left` or `right` plate at x (k,)."""

    def at(course: Course) -> Float:
        return course.at(x, groove.length_mm)

    def point(a: Float, b: Float) -> Float:
        return np.stack([a + 0 * x, b + 0 * x], axis=-1)

    top, edge, none = at(groove.thickness_mm), -at(groove.gap_mm) / 2, np.full((*x.shape, 2), np.nan)
    far = np.stack([point(edge - groove.plate_width_mm, 0 * x), point(edge - groove.plate_width_mm, top)], axis=-2)
    if side in SQUARE.get(groove.type, ()):
        low, high = point(edge, 0 * x), point(edge, top)
        return Plate(far, low, low, high, high, high, none, none[..., 0])
    below = groove.under_mm if groove.type in ("X", "K") else 0.0
    face = 0 * x if groove.type in ("V", "HV") else at(groove.root_face_mm)
    bevel = at(groove.bevel_left_deg if side == "left" else groove.bevel_right_deg) * DEG
    foot = point(edge - below * math.tan(groove.under_deg * DEG), 0 * x)
    lower, root = point(edge, below + 0 * x), point(edge, below + face)
    bend, centre = root, none
    if groove.type in ("U", "J"):
        centre = root + np.array([0.0, groove.radius_mm])
        bend = centre - groove.radius_mm * np.stack([np.cos(bevel), np.sin(bevel)], axis=-1)
    rise = top - bend[..., 1]
    upper = point(bend[..., 0] - rise * np.tan(bevel), top)
    return Plate(far, foot, lower, root, bend, upper, centre, bevel)


def enter(groove: PrismGroove, origin: Float, way: Float, after: float) -> tuple[Float, Float, Float]:
    """Where rays origin + t way (k, 3) first meet the groove at t > after: t (inf: nowhere), cosine, what (k,)."""
    o, w = origin[:, [1, 2]] * (-1, 1), way[:, [1, 2]] * (-1, 1)
    level = groove.thickness_mm.start / 2
    reach = np.maximum((level - o[:, 1]) / np.where(w[:, 1] == 0, -1.0, w[:, 1]), 0.0)
    cosine, what = np.zeros(len(o)), np.zeros(len(o))
    found = np.full(len(o), np.inf)
    for _ in range(_ROUNDS):
        x = np.clip(origin[:, 0] + np.where(np.isfinite(reach), reach, 0.0) * way[:, 0], 0.0, groove.length_mm)
        found, cosine, what = _section_hit(groove, x, o, w, after)
        reach = np.where(np.isfinite(found), found, reach)
    at = origin[:, 0] + np.where(np.isfinite(found), found, 0.0) * way[:, 0]
    found[(at < 0) | (at > groove.length_mm)] = np.inf
    length = np.linalg.norm(way, axis=1)
    met: list[Hit] = [(found, cosine * np.linalg.norm(w, axis=1) / length, what)]
    if groove.background_mm is not None:
        with np.errstate(divide="ignore", invalid="ignore"):
            back = (-groove.background_mm - o[:, 1]) / w[:, 1]
        met.append((np.where(back > after, back, np.inf), np.abs(w[:, 1]) / length, OTHER))
    met += [_mound_hit(mound, origin, way, after) for mound in groove.mounds]
    found, cosine, what = _nearest(met)
    return found, cosine, np.where(np.isfinite(found), what, NOTHING)


def _nearest(met: Sequence[Hit]) -> tuple[Float, Float, Float]:
    """Of what rays meet the nearest: t, cosine, what (k,)."""
    t, cosine, what = (np.stack([np.broadcast_to(one[i], one[0].shape) for one in met]) for i in range(3))
    best = np.argmin(t, axis=0)[None]
    found, cosine, what = (np.take_along_axis(values, best, axis=0)[0] for values in (t, cosine, what))
    return found, cosine, what


def _section_hit(groove: PrismGroove, x: Float, o: Float, w: Float, after: float) -> tuple[Float, Float, Float]:
    """First crossings of lines o + t w (k, 2) with the section at x (k,)."""
    met: list[Hit] = []
    for side, flank, surface in (("left", LEFT, LEFT_TOP), ("right", RIGHT, RIGHT_TOP)):
        plate, mirror = plate_at(groove, side, x), np.array([1.0, 1.0] if side == "left" else [-1.0, 1.0])
        raised = np.zeros((len(x), 2))
        if side == "right":
            raised[:, 1] = groove.misalignment_mm.at(x, groove.length_mm)
        start, go = (o - raised) * mirror, w * mirror
        lines = [
            (plate.far[:, 0], plate.foot, OTHER),
            (plate.foot, plate.lower, OTHER),
            (plate.lower, plate.root, flank),
            (plate.bend, plate.upper, flank),
            (plate.upper, plate.far[:, 1], surface),
        ]
        met += [(*_line_hit(start, go, first, last, after), name) for first, last, name in lines]
        if np.isfinite(plate.centre).any():
            met.append((*_arc_hit(start, go, plate, groove.radius_mm, after), flank))
    return _nearest(met)


def _line_hit(o: Float, w: Float, first: Float, last: Float, after: float) -> tuple[Float, Float]:
    along, off = last - first, first - o
    length = np.linalg.norm(along, axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        det = w[:, 0] * along[:, 1] - w[:, 1] * along[:, 0]
        t = (off[:, 0] * along[:, 1] - off[:, 1] * along[:, 0]) / det
        share = (off[:, 0] * w[:, 1] - off[:, 1] * w[:, 0]) / det
        cosine = np.abs(det) / (length * np.linalg.norm(w, axis=1))
    hit = (length > 0) & (t > after) & (share >= -_SLACK) & (share <= 1 + _SLACK)
    return np.where(hit, t, np.inf), np.where(hit, cosine, 0.0)


def _arc_hit(o: Float, w: Float, plate: Plate, radius: float, after: float) -> tuple[Float, Float]:
    """With the fillet: the quarter from straight below its centre to the bevel's flank; the plate lies outside."""
    off = o - plate.centre
    a, half, c = (w * w).sum(axis=1), (off * w).sum(axis=1), (off * off).sum(axis=1) - radius**2
    root = np.sqrt(np.maximum(half**2 - a * c, 0.0))
    met: list[Hit] = []
    for sign in (-1.0, 1.0):
        t = (-half + sign * root) / a
        at = off + t[:, None] * w
        turn = np.arctan2(-at[:, 0], -at[:, 1])
        hit = (half**2 > a * c) & (t > after) & (turn >= -_SLACK) & (turn <= math.pi / 2 - plate.bevel + _SLACK)
        met.append((np.where(hit, t, np.inf), np.abs((at * w).sum(axis=1)) / (radius * np.sqrt(a)), 0))
    return _nearest(met)[:2]


def _mound_hit(mound: Mound, origin: Float, way: Float, after: float) -> Hit:
    half_mm = np.array(mound.half_mm)
    off, w = (origin - (mound.at_mm, 0.0, mound.z_mm)) / half_mm, way / half_mm
    t = entry((w * w).sum(axis=1), (off * w).sum(axis=1), (off * off).sum(axis=1) - 1.0, after)
    normal = (off + np.where(np.isfinite(t), t, 0.0)[:, None] * w) / half_mm
    slope = np.abs((normal * way).sum(axis=1)) / (np.linalg.norm(normal, axis=1) * np.linalg.norm(way, axis=1))
    return t, slope, OTHER


def sees(groove: PrismGroove, point: Float, target: Float) -> Bool:
    """Whether nothing stands between surface points (k, 3) and `target` (k, 3)."""
    way = target - point
    away = 1e-4 / np.linalg.norm(way, axis=1, keepdims=True)
    return np.asarray(enter(groove, point + away * way, way, 0.0)[0] > 1.0)
