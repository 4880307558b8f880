"""A view in space as a picture: the points by `geometry.splat`, lines, planes and words over them by pillow."""

from __future__ import annotations

import io
from collections.abc import Mapping
from functools import cache
from itertools import pairwise

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from workbench.geometry.splat import Camera, draw_cloud
from workbench.report.colours import INK
from workbench.report.scene import AXES, View, aspect, extent
from workbench.units import AnyArray, Bool, Float, Float32

FINER = 2  # lines are drawn so many times as large, then made smaller: smooth
LINE_PX, WORD_PX, DOT_PX, HEAD_PX = 3 * FINER, 23 * FINER, 3.0 * FINER, 12 * FINER  # width, height, radius, length
COLOURS = 256  # of the picture
NEAREST, QUICKLY = Image.Resampling.NEAREST, Image.Quantize.FASTOCTREE
TINT = 0.13  # opacity of a plane
MARGIN = 0.06  # of the picture, left free around what is in it
FAINT = 0.25  # opacity of an outline behind the part
STEP_PX, GAP_PX, NOISE_MM = 3.0, 7, 0.2  # an outline is looked at this often for what hides it; and how closely


def pictures(views: Mapping[str, View]) -> dict[str, bytes]:
    """PNG of each view."""
    return {name: picture(view) for name, view in views.items()}


def picture(view: View) -> bytes:
    """PNG of a view in parallel projection, at true scale. Paths and dots run inside the stock: drawn before it."""
    camera = camera_of(view)
    cloud = draw_cloud(view.points_mm, view.colour.astype(np.uint8), camera)
    near = _widened(np.nan_to_num(cloud.near_mm, nan=-np.inf), GAP_PX)  # gaps between points hide as well
    image = Image.fromarray(cloud.rgb).resize((FINER * camera.width_px, FINER * camera.height_px), NEAREST)
    draw = ImageDraw.Draw(image, "RGBA")
    for line, colour in view.lines():
        _draw_line(draw, camera.project(line), colour[1:])
    for (x, y, _), shade in zip(FINER * camera.project(view.dots_mm), view.dot_colour, strict=True):
        draw.ellipse((x - DOT_PX, y - DOT_PX, x + DOT_PX, y + DOT_PX), fill=_shade(shade))
    for corners, colour, name in zip(view.planes_mm, view.plane_colour, view.names, strict=True):
        _draw_plane(draw, camera, near, corners, colour, name)
    if view.axes_length_mm:
        _draw_axes(draw, camera, view.axes * view.axes_length_mm)
    out = io.BytesIO()
    image.reduce(FINER).quantize(COLOURS, QUICKLY, dither=Image.Dither.NONE).save(out, format="png", compress_level=4)
    return out.getvalue()


def _widened(values: Float32, size_px: int) -> Float32:
    """The greatest value in a square of `size_px`, odd, about each pixel."""
    for _ in range(2):
        found = values.copy()
        for k in range(1, size_px // 2 + 1):
            np.maximum(found[k:], values[:-k], out=found[k:])
            np.maximum(found[:-k], values[k:], out=found[:-k])
        values = found.T
    return values


def camera_of(view: View) -> Camera:
    """The camera that has all of a view in its picture."""
    screen, low, high = extent(view.everything_mm(), view.look, view.axes[2])
    width, shape = int(view.width_px), aspect(low, high)
    height = round(width * shape)
    across, up, _ = high - low
    scale = (1.0 - MARGIN) * min(width / across, height / up)
    return Camera(screen, screen.T @ ((low + high) / 2), scale, width, height)


def _draw_line(draw: ImageDraw.ImageDraw, seen: Float, colour: AnyArray) -> None:
    """A line of pixels (k, 3), a colour (k - 1, 3) for each of its segments."""
    at = FINER * seen[:, :2]
    changes = np.flatnonzero((np.diff(colour.astype(int), axis=0) != 0).any(axis=1)) + 1
    for piece in np.split(np.arange(len(colour)), changes):
        ends = at[piece[0] : piece[-1] + 2]
        draw.line([*map(tuple, ends.tolist())], fill=_shade(colour[piece[0]]), width=LINE_PX, joint="curve")


def _draw_plane(
    draw: ImageDraw.ImageDraw, camera: Camera, near: Float32, corners: Float, colour: AnyArray, name: str
) -> None:
    """A plane's outline, faint where the part hides it, with a tint and its name."""
    seen = camera.project(corners[[0, 1, 2, 3, 0]])
    draw.polygon([*map(tuple, (FINER * seen[:4, :2]).tolist())], fill=_shade(colour, TINT))
    for start, end in pairwise(seen):
        steps = max(2, round(np.hypot(*(end - start)[:2]) / STEP_PX))
        way = start + np.linspace(0.0, 1.0, steps)[:, None] * (end - start)
        behind = _hidden((way[:-1] + way[1:]) / 2.0, near)
        for run in np.split(np.arange(len(behind)), np.flatnonzero(np.diff(behind)) + 1):
            ends = FINER * way[[run[0], run[-1] + 1], :2]
            shade = _shade(colour, FAINT if behind[run[0]] else 1.0)
            draw.line([*map(tuple, ends.tolist())], fill=shade, width=LINE_PX)
    x, y, _ = FINER * camera.project((corners[3] + 0.04 * (corners[3] - corners[0]))[None])[0]
    draw.text((x, y), name, font=_font(), fill=INK, anchor="mb")


def _hidden(seen: Float, near_mm: Float32) -> Bool:
    """(k,) whether places (column, row, near) lie behind the cloud."""
    height, width = near_mm.shape
    column, row = (np.clip(seen[:, k].astype(int), 0, size - 1) for k, size in ((0, width), (1, height)))
    return np.asarray(near_mm[row, column] > seen[:, 2] + NOISE_MM)


def _draw_axes(draw: ImageDraw.ImageDraw, camera: Camera, ends_mm: Float) -> None:
    """t, n, m as arrows from the view's origin."""
    start = FINER * camera.project(np.zeros((1, 3)))[0, :2]
    for end, name in zip(FINER * camera.project(ends_mm)[:, :2], AXES, strict=True):
        along = (end - start) / max(1e-9, float(np.hypot(*(end - start))))
        across = np.array([-along[1], along[0]])
        draw.line([tuple(start), tuple(end - HEAD_PX / 2 * along)], fill=INK, width=LINE_PX)
        head = (end, end - HEAD_PX * along + HEAD_PX / 3 * across, end - HEAD_PX * along - HEAD_PX / 3 * across)
        draw.polygon([tuple(corner) for corner in head], fill=INK)
        draw.text(tuple(start + 1.15 * (end - start)), name, font=_font(), fill=INK, anchor="mm")


def _shade(colour: AnyArray, opacity: float = 1.0) -> tuple[int, ...]:
    return (*map(int, colour), round(255 * opacity))


@cache
def _font() -> ImageFont.ImageFont | ImageFont.FreeTypeFont:
    return ImageFont.load_default(WORD_PX)  # comes with pillow: the same everywhere
