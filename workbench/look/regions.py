"""A height map measured as an image, by scikit-image: smooth regions, their holes and outlines.

Regions are connected pixels without a step (`measure.label`); small gaps in them are filled (`morphology`); a region's
plane is fitted robustly; circles and sides are found by `measure.ransac` and fitted to what agrees. At a step an
outline is the contour of the heights midway between its two sides (`measure.find_contours`), at sub-pixel places where
the sensor's spot blends them; where nothing came back beyond, it lies half a pixel beside the last height. No height is
ever filled in: only gaps of the region's mask are closed, and they count in no area, plane or number of pixels.
"""

from __future__ import annotations

import importlib
import math
from typing import Any, NamedTuple

import numpy as np

from workbench.units import Bool, Float

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


def told(regions: tuple[Region, ...]) -> list[str]:
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
