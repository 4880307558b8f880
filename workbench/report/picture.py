"""A view in space as a picture: the points by `geometry.splat`, lines, planes and words over them by matplotlib."""

from __future__ import annotations

import io
from collections.abc import Mapping
from itertools import pairwise

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from PIL import Image
from scipy.ndimage import maximum_filter

from workbench.geometry.splat import Camera, draw_cloud
from workbench.report.colours import INK
from workbench.report.figures import styled
from workbench.report.scene import AXES, View, aspect, extent
from workbench.units import AnyArray, Bool, Float, Float32

DPI, LINE_PT, WORD_PT, DOT_PT = 150, 1.4, 11.0, 2.9
CLOUD_COLOURS, COLOURS = 48, 256  # of the cloud; and of the picture, with what is drawn over it
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
    near = maximum_filter(np.nan_to_num(cloud.near_mm, nan=-np.inf), GAP_PX)  # gaps between points hide as well
    with styled():
        figure = Figure(figsize=(camera.width_px / DPI, camera.height_px / DPI), dpi=DPI)
        axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
        axes.imshow(
            _in_few_colours(Image.fromarray(cloud.rgb), CLOUD_COLOURS).convert("RGB"),
            extent=(0, camera.width_px, camera.height_px, 0),
            interpolation="nearest",
        )
        axes.set(xlim=(0, camera.width_px), ylim=(camera.height_px, 0))
        axes.set_axis_off()
        for line, colour in view.lines():
            _draw_line(axes, camera.project(line), colour[1:] / 255.0)
        dots = camera.project(view.dots_mm)
        axes.scatter(dots[:, 0], dots[:, 1], s=DOT_PT**2, c=view.dot_colour / 255.0, linewidths=0, zorder=3)
        for corners, colour, name in zip(view.planes_mm, view.plane_colour / 255.0, view.names, strict=True):
            _draw_plane(axes, camera, near, corners, colour, name)
        if view.axes_length_mm:
            _draw_axes(axes, camera, view.axes * view.axes_length_mm)
        return png(figure)


def png(figure: Figure) -> bytes:
    """The figure as PNG with a palette: a third of the size."""
    raw, out = io.BytesIO(), io.BytesIO()
    figure.savefig(raw, format="rgba")
    width, height = figure.canvas.get_width_height()
    image = Image.frombuffer("RGBA", (width, height), raw.getvalue(), "raw", "RGBA", 0, 1).convert("RGB")
    _in_few_colours(image, COLOURS).save(out, format="png")
    return out.getvalue()


def _in_few_colours(image: Image.Image, count: int) -> Image.Image:
    return image.quantize(count, dither=Image.Dither.NONE)


def camera_of(view: View) -> Camera:
    """The camera that has all of a view in its picture."""
    screen, low, high = extent(view.everything_mm(), view.look, view.axes[2])
    width, shape = int(view.width_px), aspect(low, high)
    height = round(width * shape)
    across, up, _ = high - low
    scale = (1.0 - MARGIN) * min(width / across, height / up)
    return Camera(screen, screen.T @ ((low + high) / 2), scale, width, height)


def _draw_line(axes: Axes, seen: Float, colour: AnyArray) -> None:
    """A line of pixels (k, 3), a colour (k - 1, 3) for each of its segments."""
    segments = np.stack([seen[:-1, :2], seen[1:, :2]], axis=1)
    axes.add_collection(LineCollection(list(segments), colors=colour, linewidths=LINE_PT, capstyle="round"))


def _draw_plane(axes: Axes, camera: Camera, near: Float32, corners: Float, colour: AnyArray, name: str) -> None:
    """A plane's outline, faint where the part hides it, with a tint and its name."""
    seen = camera.project(corners[[0, 1, 2, 3, 0]])
    axes.fill(seen[:, 0], seen[:, 1], facecolor=(*colour, 0.13), edgecolor="none", zorder=2.5)
    for start, end in pairwise(seen):
        steps = max(2, round(np.hypot(*(end - start)[:2]) / STEP_PX))
        way = start + np.linspace(0.0, 1.0, steps)[:, None] * (end - start)
        behind = _hidden((way[:-1] + way[1:]) / 2.0, near)
        for run in np.split(np.arange(len(behind)), np.flatnonzero(np.diff(behind)) + 1):
            ends = way[[run[0], run[-1] + 1]]
            opacity = FAINT if behind[run[0]] else 1.0
            axes.plot(
                ends[:, 0], ends[:, 1], color=(*colour, opacity), linewidth=LINE_PT, zorder=4, solid_capstyle="butt"
            )
    place = camera.project((corners[3] + 0.04 * (corners[3] - corners[0]))[None])[0]
    axes.annotate(
        name, place[:2], (0, 2), textcoords="offset points", color=INK, fontsize=WORD_PT, ha="center", zorder=5
    )


def _hidden(seen: Float, near_mm: Float32) -> Bool:
    """(k,) whether places (column, row, near) lie behind the cloud."""
    height, width = near_mm.shape
    column, row = (np.clip(seen[:, k].astype(int), 0, size - 1) for k, size in ((0, width), (1, height)))
    return np.asarray(near_mm[row, column] > seen[:, 2] + NOISE_MM)


def _draw_axes(axes: Axes, camera: Camera, ends_mm: Float) -> None:
    """t, n, m as arrows from the view's origin."""
    start, ends = camera.project(np.zeros((1, 3)))[0], camera.project(ends_mm)
    arrow = {"arrowstyle": "-|>", "color": INK, "shrinkA": 0, "shrinkB": 0, "linewidth": LINE_PT}
    for end, name in zip(ends, AXES, strict=True):
        axes.annotate("", end[:2], start[:2], arrowprops=arrow, zorder=6)
        place = start + 1.15 * (end - start)
        axes.annotate(name, place[:2], color=INK, fontsize=WORD_PT, ha="center", va="center", zorder=6)
