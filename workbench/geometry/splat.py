"""Pictures of clouds: every point a disc on the screen, the nearest one in front, lit by the depths about it.

A compiled kernel a core fills a depth buffer of its own. A buffer holds depth and number of the point in one 64-bit
word, so that keeping the nearer point is one comparison and merging the buffers is a maximum. No OpenGL is needed.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import partial, reduce
from typing import NamedTuple

import numpy as np

from workbench.geometry.blocks import as_input, cores, in_order
from workbench.kernels import kernel
from workbench.units import AnyArray, Float, Float32, Shaped

FINER = 2  # a pixel is drawn as so many times so many, so that outlines are smooth
COARSER, FEW = 8.0, 200_000  # pixels and points in which the spacing of the points is looked for
COVER = 1.7  # a disc's diameter over the spacing: closes the surface
SMALLEST_PX, LARGEST_PX = 1.0 / FINER, 12.0
STEEPEST, DEAD, STRENGTH, DARKEST = 4.0, 0.7, 0.22, 0.35  # of the lighting; slopes in pixels a pixel
REACH, FARTHEST = 2.5, 8  # its neighbours: so many discs away, pixels at most


@dataclass(frozen=True, slots=True, eq=False)
class Camera:
    """How space is seen: in parallel projection, or in perspective from a viewer at a distance from `centre_mm`."""

    screen: Shaped[Float, "3 3"]  # rows right, up, towards the viewer; orthonormal
    centre_mm: Shaped[Float, " 3"]  # what is seen in the middle of the picture
    scale_px_mm: float  # pixels a mm, at the distance of the centre
    width_px: int
    height_px: int
    distance_mm: float = math.inf  # of the viewer from the centre; infinite: parallel projection

    def project(self, points_mm: Float) -> Float:
        """(n, 3) column and row, pixels from the upper left corner, and mm towards the viewer from the centre."""
        seen = (points_mm - self.centre_mm) @ self.screen.T
        scale = self.scale_px_mm / (1.0 - seen[:, 2] / self.distance_mm)
        column, row = self.width_px / 2.0 + scale * seen[:, 0], self.height_px / 2.0 - scale * seen[:, 1]
        return np.column_stack([column, row, seen[:, 2]])

    def finer(self, times: float) -> Camera:
        """The same picture with so many times as many pixels each way."""
        width, height = (max(1, round(times * size)) for size in (self.width_px, self.height_px))
        return replace(self, scale_px_mm=self.scale_px_mm * times, width_px=width, height_px=height)


class Projection(NamedTuple):
    """A camera as the kernel takes it: lengths in pixels."""

    screen: Shaped[Float, "3 3"]  # turns mm into pixels
    centre: Shaped[Float, " 3"]  # mm
    shape: Shaped[AnyArray, " 2"]  # width and height
    closeness: float  # 1 / distance
    depths: Shaped[Float, " 2"]  # between which all points lie


class Picture(NamedTuple):
    """A drawn cloud: H x W pixels, the first row the uppermost."""

    rgb: Shaped[AnyArray, "H W 3"]  # uint8, on white
    # the nearest point there, mm towards the viewer from the camera's centre; NaN: none
    near_mm: Shaped[Float32, "H W"]


def draw_cloud(
    points_mm: Shaped[AnyArray, "n 3"], colour: Shaped[AnyArray, "n 3"], camera: Camera, size_px: float | None = None
) -> Picture:
    """The points as lit discs; those in perspective are the larger the nearer they are.

    Args:
        points_mm: (n, 3) float32 or float64, near the origin where float32; points with NaN are left out.
        colour: (n, 3) uint8 red, green, blue.
        camera: in the frame of the points.
        size_px: diameter of a disc at the centre's distance; None: so large that the surfaces close.

    Returns:
        The picture; plane faces keep the colours of their points however they are inclined.
    """
    if points_mm.ndim != 2 or points_mm.shape[1] != 3 or colour.shape != points_mm.shape:
        raise ValueError("points_mm and colour are (n, 3)")
    fine = camera.finer(FINER)
    size = spacing_px(points_mm, camera) * COVER if size_px is None else size_px
    size = FINER * min(LARGEST_PX, max(SMALLEST_PX, size))
    return _lit(_nearest(points_mm, fine, size), as_input(colour), fine, _depth_range(points_mm, camera), size)


def spacing_px(points_mm: AnyArray, camera: Camera) -> float:
    """How far the points are from each other on the screen: the area that they cover, shared out among them."""
    few, cell_px, found = points_mm[:: max(1, len(points_mm) // FEW)], COARSER / 2, math.inf
    while found > 0.6 * cell_px and cell_px < 2 * LARGEST_PX:  # cells as fine as the points are close enough to fill
        cell_px *= 2
        covered = np.count_nonzero(_nearest(few, camera.finer(1.0 / cell_px), 1.0))
        found = math.sqrt(covered / max(1, len(points_mm))) * cell_px
    return found


def _nearest(points_mm: AnyArray, camera: Camera, size_px: float) -> AnyArray:
    """(H, W) uint64: depth, the nearer the larger, in the upper half; number of the point + 1 in the lower; 0: none."""
    low, high = _depth_range(points_mm, camera)
    view = Projection(
        camera.screen * camera.scale_px_mm,
        camera.centre_mm,
        np.array([camera.width_px, camera.height_px]),
        1.0 / (camera.scale_px_mm * camera.distance_mm),
        np.array([low, high]) * camera.scale_px_mm,
    )
    work = partial(_splat, as_input(points_mm), view, size_px)
    step = max(1, -(-len(points_mm) // cores()))
    return reduce(
        _merged,
        in_order(work, len(points_mm), step),
        np.zeros((camera.height_px, camera.width_px), np.uint64),
    )


def _merged(one: AnyArray, other: AnyArray) -> AnyArray:
    return np.maximum(one, other, out=other)


def _depth_range(points_mm: AnyArray, camera: Camera) -> tuple[float, float]:
    """Depths that all points lie between, mm towards the viewer: of the corners of the box about them."""
    box = np.array(_box(as_input(points_mm)))
    if not np.isfinite(box).all():
        return -1.0, 1.0
    ends = (box - camera.centre_mm) * camera.screen[2]
    return float(ends.min(axis=0).sum()) - 1.0, float(ends.max(axis=0).sum()) + 1.0


@kernel
def _box(points: AnyArray) -> tuple[tuple[float, float, float], tuple[float, float, float]]:
    low, high = np.full(3, np.inf), np.full(3, -np.inf)
    for i in range(points.shape[0]):
        for k in range(3):
            value = np.float64(points[i, k])
            if math.isfinite(value):
                low[k], high[k] = min(low[k], value), max(high[k], value)
    return (low[0], low[1], low[2]), (high[0], high[1], high[2])


@kernel
def _splat(points: AnyArray, view: Projection, size: float, first: int, last: int) -> AnyArray:
    """Points [first, last) as discs of `size` pixels."""
    screen, centre, closeness, depths = view.screen, view.centre, view.closeness, view.depths
    width, height = view.shape[0], view.shape[1]
    nearest = np.zeros((height, width), np.uint64)
    steps = 4294967040.0 / (depths[1] - depths[0])
    a, b, c = screen[0], screen[1], screen[2]
    for i in range(first, last):
        x, y, z = points[i, 0] - centre[0], points[i, 1] - centre[1], points[i, 2] - centre[2]
        depth = c[0] * x + c[1] * y + c[2] * z
        larger = 1.0 - depth * closeness
        if not larger > 0.0:  # behind the viewer, or NaN
            continue
        larger = 1.0 / larger
        u = 0.5 * width + larger * (a[0] * x + a[1] * y + a[2] * z)
        v = 0.5 * height - larger * (b[0] * x + b[1] * y + b[2] * z)
        r = 0.5 * size * larger
        if u < -r or v < -r or u >= width + r or v >= height + r:
            continue
        word = (np.uint64((depth - depths[0]) * steps) << np.uint64(32)) | np.uint64(i + 1)
        if r <= 0.75:  # one pixel
            row, column = int(v), int(u)
            if 0 <= u < width and 0 <= v < height and word > nearest[row, column]:
                nearest[row, column] = word
            continue
        for row in range(max(0, int(v - r)), min(height, int(v + r) + 1)):
            off = row + 0.5 - v
            half = r * r - off * off
            if half < 0.0:
                continue
            half = math.sqrt(half)
            for column in range(max(0, int(u - half + 0.5)), min(width, int(u + half + 0.5))):
                if word > nearest[row, column]:
                    nearest[row, column] = word
    return nearest


def _lit(nearest: AnyArray, colour: AnyArray, fine: Camera, depths_mm: tuple[float, float], size_px: float) -> Picture:
    """The colours of the nearest points, darkened where their neighbours stand before them, on the camera's pixels."""
    reach = min(
        FARTHEST * FINER, round(math.ceil(REACH * size_px))
    )  # a few discs: these are flat, surfaces need not be
    height, width = fine.height_px // FINER, fine.width_px // FINER
    picture = Picture(np.empty((height, width, 3), np.uint8), np.empty((height, width), np.float32))
    work = partial(_shade, nearest, colour, picture, np.array(depths_mm), fine.scale_px_mm, reach)
    list(in_order(work, height, max(1, -(-height // (4 * cores())))))
    return picture


@kernel
def _shade(
    nearest: AnyArray,
    colour: AnyArray,
    picture: Picture,
    depths: Float,
    scale: float,
    reach: int,
    first: int,
    last: int,
) -> None:
    """Fill rows [first, last) of the picture, each pixel the mean of its finer ones, white where there is no point.

    After eye-dome lighting (Boucheny 2009): dark where both neighbours across a pixel, taken together, stand before it.
    """
    rgb, near = picture.rgb, picture.near_mm
    span = depths[1] - depths[0]
    to_mm = span / 4294967040.0
    for row in range(first, last):
        for column in range(rgb.shape[1]):
            total_0, total_1, total_2, front = 0.0, 0.0, 0.0, np.uint64(0)
            for k in range(FINER * FINER):
                i, j = FINER * row + k // FINER, FINER * column + k % FINER
                word = nearest[i, j]
                if word == 0:
                    total_0, total_1, total_2 = total_0 + 255.0, total_1 + 255.0, total_2 + 255.0
                    continue
                front = max(front, word)
                light = _light(nearest, i, j, to_mm * scale / reach, reach)
                point = np.int64(word & np.uint64(0xFFFFFFFF)) - 1
                total_0 += light * colour[point, 0]
                total_1 += light * colour[point, 1]
                total_2 += light * colour[point, 2]
            share = 1.0 / (FINER * FINER)
            rgb[row, column, 0] = np.uint8(total_0 * share + 0.5)
            rgb[row, column, 1] = np.uint8(total_1 * share + 0.5)
            rgb[row, column, 2] = np.uint8(total_2 * share + 0.5)
            near[row, column] = np.nan if front == 0 else depths[0] + to_mm * np.float64(front >> np.uint64(32))


@kernel
def _light(nearest: AnyArray, i: int, j: int, slope: float, reach: int) -> float:
    """How bright a pixel is, 0 to 1; `slope` turns steps of depth into pixels over the pixels between neighbours."""
    here = np.float64(nearest[i, j] >> np.uint64(32))
    dark = 0.0
    for k in range(4):
        di, dj = reach * (0 if k == 0 else 1), reach * (1 if k == 0 or k == 2 else 0 if k == 1 else -1)
        one = _before(nearest, i + di, j + dj, here, slope)
        other = _before(nearest, i - di, j - dj, here, slope)
        dark += min(3.0, max(0.0, one + other - DEAD)) + 0.06 * (max(one, 0.0) + max(other, 0.0))
    return DARKEST + (1.0 - DARKEST) * math.exp(-STRENGTH * dark)


@kernel
def _before(nearest: AnyArray, i: int, j: int, here: float, slope: float) -> float:
    """By how much a neighbour stands before a pixel; where there is none it lies far behind."""
    i, j = min(max(i, 0), nearest.shape[0] - 1), min(max(j, 0), nearest.shape[1] - 1)
    if nearest[i, j] == 0:
        return -STEEPEST
    return min(STEEPEST, max(-STEEPEST, (np.float64(nearest[i, j] >> np.uint64(32)) - here) * slope))
