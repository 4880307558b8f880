"""Draws views in space with VTK, offscreen: `python -m workbench.report.render NAME...` in a folder of its own.

Reads `NAME.npz` (the fields of `workbench.report.scene.View`) in the working directory, writes `NAME.png` beside it.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pyvista as pv

from workbench.report.colours import INK
from workbench.report.scene import AXES, View, aspect, extent
from workbench.units import AnyArray, Float


def main(names: list[str]) -> None:
    """Draw each of `names`."""
    for name in names:
        with np.load(f"{name}.npz", allow_pickle=False) as stored:
            view = View(**{key: value[()] for key, value in stored.items()})
        draw(view, Path(f"{name}.png"))


def draw(view: View, path: Path) -> None:
    """One parallel projection at true scale."""
    screen, low, high = extent(view.everything_mm(), view.look, view.axes[2])
    centre, (width, height, depth) = screen.T @ ((low + high) / 2), high - low
    shape = aspect(low, high)
    plotter: Any = pv.Plotter(off_screen=True, window_size=[int(view.width_px), round(view.width_px * shape)])
    plotter.set_background("white")
    _add_points(plotter, view.points_mm, view.colour, size=3.0)
    forward = depth * view.look  # in front of all points: a path runs inside the stock, and must be seen
    _add_points(plotter, view.dots_mm + forward, view.dot_colour, size=6.0)
    _add_lines(plotter, view, forward)
    for corners, colour, name in zip(view.planes_mm, view.plane_colour, view.names, strict=True):
        _add_plane(plotter, corners, colour, str(name))
    if view.axes_length_mm:
        _add_axes(plotter, view.axes, float(view.axes_length_mm))
    plotter.enable_parallel_projection()
    plotter.camera_position = [tuple(centre + view.look * (2.0 * depth + width)), tuple(centre), tuple(view.axes[2])]
    plotter.camera.parallel_scale = 0.53 * max(height, width * shape)
    plotter.reset_camera_clipping_range()
    plotter.screenshot(str(path))
    plotter.close()


def _add_points(plotter: Any, points_mm: Float, colour: AnyArray, size: float) -> None:
    if len(points_mm):
        cloud = pv.PolyData(points_mm.astype(np.float32))
        cloud["colour"] = colour.astype(np.uint8)
        plotter.add_mesh(cloud, scalars="colour", rgb=True, point_size=size, lighting=False, style="points")


def _add_lines(plotter: Any, view: View, forward: Float) -> None:
    if not len(view.lines_mm):
        return
    ends = np.append(view.line_start[1:], len(view.lines_mm))
    cells = [np.r_[end - start, start:end] for start, end in zip(view.line_start, ends, strict=True)]
    lines = pv.PolyData((view.lines_mm + forward).astype(np.float32), lines=np.concatenate(cells))
    lines["colour"] = view.line_colour.astype(np.uint8)
    plotter.add_mesh(lines, scalars="colour", rgb=True, line_width=3.0, lighting=False)


def _add_plane(plotter: Any, corners: Float, colour: AnyArray, name: str) -> None:
    face = pv.PolyData(corners.astype(np.float32), faces=[4, 0, 1, 2, 3])
    shade = [int(c) for c in colour]
    plotter.add_mesh(face, color=shade, opacity=0.16, lighting=False)
    plotter.add_mesh(pv.lines_from_points(corners[[0, 1, 2, 3, 0]]), color=shade, line_width=3.0, lighting=False)
    _add_text(plotter, corners[3] + 0.04 * (corners[3] - corners[0]), name)


def _add_axes(plotter: Any, axes: Float, length: float) -> None:
    for axis, name in zip(axes, AXES, strict=True):
        plotter.add_mesh(pv.lines_from_points(np.array([0 * axis, axis * length])), color=INK, line_width=4.0)
        plotter.add_mesh(
            pv.Cone(center=axis * length, direction=axis, height=length / 6, radius=length / 22),
            color=INK,
            lighting=False,
        )
        _add_text(plotter, axis * length * 1.15, name)


def _add_text(plotter: Any, place: Float, text: str) -> None:
    look = {"font_size": 30, "text_color": INK, "bold": False, "shape": None, "show_points": False}
    plotter.add_point_labels(place[None], [text], always_visible=True, **look)


if __name__ == "__main__":
    main(sys.argv[1:])
