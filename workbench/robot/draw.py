"""Draws cells with VTK, offscreen: `python -m workbench.robot.draw NAME...` in a folder of its own.

Reads `NAME.npz` (the fields of `workbench.robot.picture.CellPicture`), writes `NAME.png` beside it.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pyvista as pv

from workbench.robot.draw_notes import FORWARD_MM, GRID, INK, PAPER, Notes, add_frames, add_gaps, add_grid, add_names
from workbench.robot.picture import CellPicture
from workbench.units import Float

WIDTH_PX, HEIGHT_PX = 2000, 1500
HUGE = 1.6  # a body this many times as large as robot and turntable together is cut off around them
TOOL = ("flange", "cutter", "sensor")  # what the close-up shows
VIEWS: tuple[tuple[str, tuple[float, float, float], tuple[float, float, float]], ...] = (
    ("overview", (0.75, -1.0, 0.55), (0, 0, 1)),
    ("from the side: x to the right, z up", (0, -1, 0), (0, 0, 1)),
    ("from above: x to the right, y up", (0, 0, 1), (0, 1, 0)),
)


def main(names: list[str]) -> None:
    """Draw each of `names`."""
    for name in names:
        with np.load(f"{name}.npz", allow_pickle=False) as stored:
            view = CellPicture(**{key: value[()] for key, value in stored.items()})
        draw(view, Path(f"{name}.png"))


def draw(view: CellPicture, path: Path) -> None:
    """Overview, side, top, and the tool close up, in parallel projection."""
    plotter: Any = pv.Plotter(off_screen=True, shape=(2, 2), window_size=[WIDTH_PX, HEIGHT_PX], border_color=GRID)
    low, high = _bounds(view)
    spacing = _spacing(high - low)
    for i, (name, look, up) in enumerate(VIEWS):
        plotter.subplot(i // 2, i % 2)
        screen = _look(plotter, np.array(look), np.array(up), low, high)
        note = f"{name}; grid {spacing:.0f} mm"
        _scene(plotter, view, low, high, f"{view.caption}\n{note}" if i == 0 else note)
        add_grid(plotter, low, high, spacing, screen[2])
        notes = Notes(plotter, screen, 4 * plotter.camera.parallel_scale / HEIGHT_PX)
        add_frames(notes, view, ("base", "turntable", "cutter"), float((high - low).max()))
        add_gaps(notes, view, float((high - low).max()))
        if i == 0:
            add_names(notes, view, high - low)
    plotter.subplot(1, 1)
    near, far = _tool_bounds(view)
    screen = _look(plotter, np.array(VIEWS[0][1]), np.array(VIEWS[0][2]), near, far)
    _scene(plotter, view, low, high, "tool; axes x vermilion, y green, z blue")
    notes = Notes(plotter, screen, 4 * plotter.camera.parallel_scale / HEIGHT_PX)
    add_frames(notes, view, TOOL, 1.5 * float((far - near).max()))
    add_gaps(notes, view, 1.5 * float((far - near).max()))
    plotter.enable_anti_aliasing("ssaa")
    plotter.screenshot(str(path))
    plotter.close()


def _bounds(view: CellPicture) -> tuple[Float, Float]:
    """Lowest and highest corner of what is to be in view: all bodies and frames but the huge ones."""
    sizes = [
        (corners.min(axis=(0, 1)), corners.max(axis=(0, 1)))
        for corners in (view.triangles_mm[view.body == b] for b in range(len(view.names)))
    ]
    at = view.base_from_frame[:, :3, 3]
    robot = float(np.linalg.norm(np.ptp(at, axis=0))) + 1000.0
    kept = [(low, high) for low, high in sizes if (high - low).max() <= HUGE * robot] or sizes
    low = np.minimum(np.min([low for low, _ in kept], axis=0), at.min(axis=0))
    high = np.maximum(np.max([high for _, high in kept], axis=0), at.max(axis=0))
    return low - 0.03 * (high - low), high + 0.03 * (high - low)


def _tool_bounds(view: CellPicture) -> tuple[Float, Float]:
    """A cube around flange, sensor, cutter and the tool's bodies."""
    is_tool = [name in ("tool", "cutter") for name in view.names]
    at = [pose[:3, 3] for pose, name in zip(view.base_from_frame, view.frames, strict=True) if name in TOOL]
    points = np.vstack([view.triangles_mm[np.array(is_tool)[view.body]].reshape(-1, 3), *at])
    middle, half = (points.min(axis=0) + points.max(axis=0)) / 2, 0.6 * max(float(np.ptp(points, axis=0).max()), 100.0)
    return middle - half, middle + half


def _scene(plotter: Any, view: CellPicture, low: Float, high: Float, caption: str) -> None:
    """All bodies, the huge ones cut off at the bounds."""
    plotter.set_background(PAPER)
    for index, colour in enumerate(view.colours):
        corners = view.triangles_mm[view.body == index].reshape(-1, 3).astype(np.float32)
        faces = np.column_stack([np.full(len(corners) // 3, 3), np.arange(len(corners)).reshape(-1, 3)])
        mesh = pv.PolyData(corners, faces.ravel()).clean()
        if (mesh.points.min(axis=0) < low - 1).any() or (mesh.points.max(axis=0) > high + 1).any():
            mesh = _cut_off(mesh, low, high)
        if mesh.n_cells:
            mesh = mesh.compute_normals(split_vertices=True, feature_angle=30)
            plotter.add_mesh(mesh, color=str(colour), smooth_shading=True, ambient=0.25, reset_camera=False)
            edges = mesh.clean().extract_feature_edges(40)
            if edges.n_cells:
                plotter.add_mesh(edges, color=INK, line_width=1.5, lighting=False, reset_camera=False)
    plotter.add_text(caption, position="upper_left", font_size=13, color=INK)


def _cut_off(mesh: Any, low: Float, high: Float) -> Any:
    """What of a surface lies between two corners."""
    for axis in range(3):
        normal = np.eye(3)[axis]
        mesh = mesh.clip(normal, origin=low, invert=False).clip(normal, origin=high, invert=True)
    return mesh


def _spacing(size: Float) -> float:
    """Of the grid's lines: about ten of them."""
    steps = [1, 2, 5, 10, 20, 50, 100, 200, 500, 1000, 2000, 5000]
    return float(min(steps, key=lambda step: abs(np.log(step * 10 / float(size.max())))))


def _look(plotter: Any, look: Float, up: Float, low: Float, high: Float) -> Float:
    """A parallel projection that shows the box from `low` to `high`; rows right, up, to the viewer of the picture."""
    towards = look / np.linalg.norm(look)
    right = np.cross(up, towards)
    right /= np.linalg.norm(right)
    screen = np.array([right, np.cross(towards, right), towards])
    width, height, _ = np.abs(screen) @ (high - low)
    centre = (low + high) / 2
    plotter.enable_parallel_projection()
    plotter.camera_position = [tuple(centre + 4 * FORWARD_MM * towards), tuple(centre), tuple(up)]
    plotter.camera.parallel_scale = 0.56 * max(height, width * HEIGHT_PX / WIDTH_PX)
    plotter.camera.clipping_range = (FORWARD_MM, 8 * FORWARD_MM)
    return screen


if __name__ == "__main__":
    main(sys.argv[1:])
