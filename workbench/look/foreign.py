"""Profiles, poses or height maps of other people's files, before they are imported.

Regions are connected pixels without a step (`measure.label`); small gaps in them are filled (`morphology`); a region's
plane is fitted robustly; circles and sides are found by `measure.ransac` and fitted to what agrees. At a step an
outline is the contour of the heights midway between its two sides (`measure.find_contours`), at sub-pixel places where
the sensor's spot blends them; where nothing came back beyond, it lies half a pixel beside the last height. No height is
ever filled in: only gaps of the region's mask are closed, and they count in no area, plane or number of pixels.
"""

from __future__ import annotations

import importlib
import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from workbench.geometry.poses import pose_from, rotation_from_quaternion
from workbench.importing import tracker
from workbench.importing.command import grid_told
from workbench.importing.joints import NO_ROBOT
from workbench.importing.neutral import Imported, JointStream, TrackerReadings
from workbench.importing.text import Form
from workbench.look.recorded import BASE_AXES_MM, SCANNERS, WAY, axes_of, lines_of
from workbench.look.seen import Seen, box, even_grid, measured, shades_of, stacked, told_profile
from workbench.units import DEG, Bool, Float

STEP_PITCHES = 1.0  # height from pixel to pixel, in pitches: more is a step between regions
LEAST_SHARE, MOST_REGIONS = 0.01, 6
GAP_PIXELS = 16  # of a gap that is filled
LEAST_CIRCLE, LEAST_SIDE = 24, 30  # points of an outline that make one
NEAR_PITCHES = 0.35  # how far points of an outline may lie off the circle or side
AGREE = 0.8  # share of a hole's outline that must lie on its circle
DENSE = 0.7  # share of a side that must be outline
MOST_SIDES, SEED = 4, 0
CLEAR, REACH = 2, 5  # pixels off a region's mask: from where to where the other side of a step is looked for
BESIDE = 0.5  # share of the pixels there that must have a height


def _skimage(module: str) -> Any:
    """A module of scikit-image, whose annotations are partial; loaded when there is an image."""
    return importlib.import_module(f"skimage.{module}")


class Circle(NamedTuple):
    """A round hole or rim, in the plane of x and y."""

    x_mm: float
    y_mm: float
    diameter_mm: float
    rms_mm: float
    share: float  # of the outline that lies on it


class Side(NamedTuple):
    """A straight side of a region, in the plane of x and y."""

    start_mm: tuple[float, float]
    end_mm: tuple[float, float]
    length_mm: float
    angle_deg: float  # to the x axis
    rms_mm: float


class Region(NamedTuple):
    """A smooth part of the surface."""

    pixels: int
    area_mm2: float
    tilt_x_deg: float  # of its plane, along x
    tilt_y_deg: float  # along the scan
    rms_mm: float  # of the heights off the plane, strays aside
    holes: tuple[Circle, ...]
    sides: tuple[Side, ...]


def regions_of(x_mm: Float, y_mm: Float, z_mm: Float) -> tuple[Region, ...]:
    """The largest regions of a height map: x (M,) and y (N,) evenly spaced, z (N, M) with NaN."""
    pitch = (abs(float(np.median(np.diff(y_mm)))), abs(float(np.median(np.diff(x_mm)))))
    smooth = _without_steps(z_mm, max(pitch))
    numbers = _skimage("measure").label(smooth, connectivity=1)
    found = sorted(_skimage("measure").regionprops(numbers), key=lambda one: -one.area)[:MOST_REGIONS]
    made = []
    for one in found:
        if one.area < LEAST_SHARE * z_mm.size:
            continue
        mask = _skimage("morphology").remove_small_holes(numbers == one.label, max_size=GAP_PIXELS)
        slopes, off_mm, rms = _plane(x_mm, y_mm, z_mm, numbers == one.label)
        tilt_x, tilt_y = (math.degrees(math.atan(slope)) for slope in slopes)
        holes, sides = _outlines(mask, off_mm, x_mm, y_mm, pitch)
        made.append(Region(int(one.area), float(one.area) * pitch[0] * pitch[1], tilt_x, tilt_y, rms, holes, sides))
    return tuple(made)


def _without_steps(z_mm: Float, pitch_mm: float) -> Bool:
    """Pixels that have a height and no step to a neighbour."""
    smooth = np.isfinite(z_mm)
    for axis in (0, 1):
        with np.errstate(invalid="ignore"):
            step = np.abs(np.diff(z_mm, axis=axis)) > STEP_PITCHES * pitch_mm
        ahead, behind = [slice(None), slice(None)], [slice(None), slice(None)]
        ahead[axis], behind[axis] = slice(1, None), slice(None, -1)
        smooth[tuple(ahead)] &= ~step
        smooth[tuple(behind)] &= ~step
    return np.asarray(_skimage("morphology").opening(smooth, _skimage("morphology").disk(1)))


def _plane(x_mm: Float, y_mm: Float, z_mm: Float, mask: Bool) -> tuple[Float, Float, float]:
    """Slopes (2,) of the robust plane along x and y, all heights (N, M) off it, and the RMS of the region's."""
    row, column = np.nonzero(mask)
    rows = np.stack([x_mm[column], y_mm[row], np.ones(len(row))], axis=1)
    z, use = z_mm[row, column], np.ones(len(row), bool)
    plane: Float = np.zeros(3)
    for _ in range(4):
        plane = np.asarray(np.linalg.lstsq(rows[use], z[use], rcond=None)[0], np.float64)
        off = np.abs(z - rows @ plane)
        use = off <= 4.0 * 1.4826 * max(float(np.median(off)), 1e-9)
    rms = float(np.sqrt(np.mean((z - rows @ plane)[use] ** 2)))
    return plane[:2], z_mm - (plane[0] * x_mm + plane[1] * y_mm[:, None] + plane[2]), rms


def _outlines(
    mask: Bool, off_mm: Float, x_mm: Float, y_mm: Float, pitch: tuple[float, float]
) -> tuple[tuple[Circle, ...], tuple[Side, ...]]:
    """Round holes, and straight sides of the outer outline."""
    padded = np.pad(mask.astype(float), 1)
    pixels = [line - 1.0 for line in _skimage("measure").find_contours(padded, 0.5)]
    pixels.sort(key=lambda line: -abs(_area(line)))
    lines = [_in_mm(_at_step(line, mask, off_mm, max(pitch)), x_mm, y_mm) for line in pixels]
    if not lines:
        return (), ()
    near = NEAR_PITCHES * max(pitch) * math.sqrt(2.0)
    circles = [
        circle for line in lines[1:] if len(line) >= LEAST_CIRCLE and (circle := _circle(line, near)) is not None
    ]
    return tuple(circles), _sides(lines[0], near)


def _at_step(line: Float, mask: Bool, off_mm: Float, pitch_mm: float) -> Float:
    """An outline, where it is a step the contour of the heights midway between its sides: (n, 2) row and column.

    Args:
        line: (n, 2) row and column of the mask's outline.
        mask: (N, M) the region.
        off_mm: (N, M) heights off the region's plane.
        pitch_mm: of the pixels.
    """
    first = np.maximum(np.floor(line.min(axis=0)).astype(int) - 2 * REACH, 0)
    last = np.ceil(line.max(axis=0)).astype(int) + 2 * REACH + 1
    part = (slice(first[0], last[0]), slice(first[1], last[1]))
    own, off = mask[part], off_mm[part]
    at, morphology = np.zeros(own.shape, bool), _skimage("morphology")
    row, column = np.clip(np.round(line - first).astype(int), 0, np.array(own.shape) - 1).T
    at[row, column] = True
    near = morphology.dilation(at, morphology.disk(REACH))
    beyond = near & ~morphology.dilation(own, morphology.disk(CLEAR))
    there = beyond & np.isfinite(off)
    if there.sum() <= BESIDE * beyond.sum():
        return line
    height = float(np.median(off[there]))
    if abs(height) <= STEP_PITCHES * pitch_mm:
        return line
    found = _skimage("measure").find_contours(off, height / 2.0, mask=near & np.isfinite(off))
    long = [one for one in found if len(one) >= LEAST_CIRCLE] or found
    if not long:
        return line
    contour = np.concatenate(long)
    told = np.zeros(own.shape, bool)
    told[tuple(np.round(contour).astype(int).T)] = True
    rest = ~morphology.dilation(told, morphology.disk(REACH))[row, column]  # no step there: a border of the map, a loss
    return np.concatenate([contour + first, line[rest]])


def _in_mm(line: Float, x_mm: Float, y_mm: Float) -> Float:
    """(n, 2) x and y of places (row, column), fractions between pixels."""
    rows, columns = np.arange(len(y_mm)), np.arange(len(x_mm))
    return np.stack([np.interp(line[:, 1], columns, x_mm), np.interp(line[:, 0], rows, y_mm)], axis=1)


def _area(line: Float) -> float:
    x, y = line.T
    return 0.5 * float(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)))


def _circle(line: Float, near_mm: float) -> Circle | None:
    """The circle through most of a closed outline; None where it is not round."""
    measure = _skimage("measure")
    model, inside = measure.ransac(line, measure.CircleModel, 3, near_mm, max_trials=200, rng=SEED)
    if model is None or inside is None or inside.mean() < AGREE:
        return None
    fitted: Any = measure.CircleModel.from_estimate(line[inside])
    if not fitted:
        return None
    off = fitted.residuals(line[inside])
    (x, y), radius = fitted.center, fitted.radius
    return Circle(float(x), float(y), 2.0 * float(radius), float(np.sqrt(np.mean(off**2))), float(inside.mean()))


def _sides(line: Float, near_mm: float) -> tuple[Side, ...]:
    """The longest straight sides of an outline, one after another."""
    measure, sides = _skimage("measure"), list[Side]()
    spacing = float(np.median(np.linalg.norm(np.diff(line, axis=0), axis=1)))
    while len(line) >= LEAST_SIDE and len(sides) < MOST_SIDES:
        model, inside = measure.ransac(line, measure.LineModelND, 2, near_mm, max_trials=500, rng=SEED)
        if model is None or inside is None or inside.sum() < LEAST_SIDE:
            break
        fitted: Any = measure.LineModelND.from_estimate(line[inside])
        along = (line[inside] - fitted.origin) @ fitted.direction
        ends = fitted.origin + np.outer([along.min(), along.max()], fitted.direction)
        angle = math.degrees(math.atan2(*(ends[1] - ends[0])[::-1])) % 180.0
        rms = float(np.sqrt(np.mean(fitted.residuals(line[inside]) ** 2)))
        start, end = ((float(x), float(y)) for x, y in ends)
        if inside.sum() * spacing < DENSE * float(np.ptp(along)):  # places of a curve that a line happens to cross
            break
        sides.append(Side(start, end, float(np.ptp(along)), angle, rms))
        line = line[~inside]
    return tuple(sides)


def told_regions(regions: tuple[Region, ...]) -> list[str]:
    """The regions as text."""
    rows = [
        f"regions: {len(regions)} smooth one(s), largest first; they end midway up a step, or beside the last height"
    ]
    for k, one in enumerate(regions, 1):
        rows.append(
            f"  region {k}: {one.pixels} pixels, {one.area_mm2:.1f} mm2, tilt {one.tilt_x_deg:+.2f} deg along x, "
            f"{one.tilt_y_deg:+.2f} deg along the scan, rms {one.rms_mm:.4f} mm off its plane"
        )
        rows += [
            f"    hole: diameter {c.diameter_mm:.3f} mm at x {c.x_mm:.3f}, y {c.y_mm:.3f} mm, rms {c.rms_mm:.3f} mm"
            for c in one.holes
        ]
        rows += [
            f"    side: {s.length_mm:.2f} mm long, {s.angle_deg:.2f} deg to x, rms {s.rms_mm:.3f} mm" for s in one.sides
        ]
    return rows


MOST_COLUMNS = 24  # that are told
TO_IMPORT = "to bring it in: workbench import FILE --out part.h5, then workbench look part.h5 (docs/importing.md)"
IMPORT_HINT = "to bring it in: workbench import --draft FILE POSES --out map.json (docs/importing.md)"


def frames_alone(found: Imported, source: str) -> Seen:
    """Profiles in their own frame; a single one is measured."""
    frames = found.profiles
    assert frames is not None
    count = len(frames.z_mm)
    seen = np.isfinite(frames.x_mm) & np.isfinite(frames.z_mm)
    lines = [*found.notes, *grid_told(frames.x_mm, frames.z_mm)]
    if frames.travel_mm is not None:
        t = frames.travel_mm
        lines.append(f"travel: {t[0]:.6g} to {t[-1]:.6g} mm, {abs(t[-1] - t[0]) / max(1, count - 1):.4g} mm a frame")
    if frames.time_s is not None:
        lines.append(f"times: {frames.time_s[0]:.9g} to {frames.time_s[-1]:.9g} s on the profiler's clock")
    if even_grid(frames.x_mm, frames.travel_mm):
        assert frames.travel_mm is not None
        x_mm = np.nanmedian(frames.x_mm[:: max(1, count // 100)], axis=0)
        lines += told_regions(regions_of(x_mm.astype(float), frames.travel_mm, frames.z_mm.astype(float)))
    shown = stacked(frames.x_mm, frames.z_mm, frames.travel_mm)
    profile = measured(frames.x_mm[0], frames.z_mm[0]) if count == 1 else None
    hints = ["no poses: nothing is known of where it lies in the base", IMPORT_HINT]
    if found.poses is not None:
        hints = [
            f"{len(found.poses.position_mm)} poses stand in it too: as a recording it is seen in the base",
            TO_IMPORT,
        ]
    if seen.sum() > 2 and np.ptp(frames.z_mm[seen]) == 0.0:
        hints.insert(0, f"z is {frames.z_mm[seen][0]:g} throughout: these are no ranges")
    y = "y is the way along the scan" if frames.travel_mm is not None else "y counts frames"
    return Seen(
        source,
        frames.sensor or "profiles",
        f"the profiler's frame; {y}",
        tuple([*lines, *(told_profile(profile) if profile else [])]),
        shown.points_mm,
        shown.shades,
        profile=profile,
        hints=tuple(hints),
    )


def numbers_alone(form: Form, source: str) -> Seen:
    """A table of numbers that is neither profiles nor poses nor a cloud: its columns, and what could be made of it."""
    names = list(form.header) or [f"column {k}" for k in range(form.rows.shape[1])]
    lines = [f"rows: {len(form.rows)}, columns: {len(names)}"]
    for name, values in list(zip(names, form.rows.T, strict=True))[:MOST_COLUMNS]:
        kept = values[np.isfinite(values)]
        told = f"{kept.min():.6g} to {kept.max():.6g}, {len(np.unique(kept))} different" if len(kept) else "empty"
        lines.append(f"  {name}: {told}")
    if len(names) > MOST_COLUMNS:
        lines.append(f"  and {len(names) - MOST_COLUMNS} more")
    hint = (
        "a recording needs x and z of points, or x, y, z and an orientation, or joints: name the columns in a "
        "mapping (docs/importing.md); a gauge study with a row a trial: stage compare.study (docs/comparison.md)"
    )
    frame, nothing = "no frame: columns as they stand", np.zeros((0, 3))
    return Seen(source, "table of numbers", frame, tuple(lines), nothing, (), hints=(hint,))


def joints_alone(joints: JointStream, notes: Sequence[str], source: str) -> Seen:
    """A robot's postures, of which no URDF tells the poses: the range of each joint."""
    unit = joints.angle_unit
    values = joints.position / (DEG if unit == "deg" else 1.0)
    count = f"postures: {len(values)}, joints: {len(joints.names)}"
    if joints.time_s is not None:
        count += f", times {joints.time_s[0]:.9g} to {joints.time_s[-1]:.9g} s on the robot's clock"
    ranges = [
        f"  joint {k} (column {name}): {one.min():.6g} to {one.max():.6g} {unit}, {len(np.unique(one))} different"
        for k, (name, one) in enumerate(zip(joints.names, values.T, strict=True), 1)
    ]
    lines, nothing = (*notes, count, *ranges), np.zeros((0, 3))
    return Seen(source, "joint angles of a robot", "no frame", lines, nothing, (), hints=(NO_ROBOT, IMPORT_HINT))


def tracker_alone(found: TrackerReadings, source: str) -> Seen:
    """Places that a laser tracker saw: the mean of each position, or every reading."""
    places = found.place_mm
    if found.number is not None:
        places = np.array([places[rows].mean(axis=0) for _, rows in tracker.groups_of(found)])
    lines = (
        *tracker.told(found),
        f"{'means of the positions' if found.number is not None else 'places'}: {box(places)}",
    )
    shades = shades_of(places)
    return Seen(source, tracker.NAME, "the tracker's frame", lines, places, shades, hints=(tracker.INTO_A_TABLE,))


def poses_alone(found: Imported, source: str) -> Seen:
    """The way of a robot, without profiles."""
    poses = found.poses
    assert poses is not None
    pose = pose_from(rotation_from_quaternion(poses.quaternion_wxyz), poses.position_mm)
    way = np.linalg.norm(np.diff(poses.position_mm, axis=0), axis=1)
    lines = [
        *found.notes,
        f"poses: {len(pose)}, way {way.sum():.6g} mm, largest step {way.max(initial=0.0):.4g} mm",
        f"flange: {box(poses.position_mm)}",
    ]
    some = np.unique(np.linspace(0, len(pose) - 1, SCANNERS).astype(int))
    size = max(50.0, float(np.ptp(poses.position_mm, axis=0).max()))
    return Seen(
        source,
        "robot poses",
        "the robot's base",
        tuple(lines),
        np.zeros((0, 3)),
        (),
        strokes=(
            lines_of("robot's way (flange)", [poses.position_mm], WAY),
            axes_of("flange poses (x red, y green, z blue)", pose[some], size / 12.0),
            axes_of("base axes (x red, y green, z blue)", np.eye(4)[None], BASE_AXES_MM),
        ),
        hints=(IMPORT_HINT,),
    )
