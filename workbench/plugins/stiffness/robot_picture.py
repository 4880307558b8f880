"""Pictures of the robot cell in a posture, for the chapter of postures (Fig. 17c, d). mm, in the base."""

from __future__ import annotations

from typing import Any

import numpy as np

from workbench.api import Cell, Float, cell_triangles, pieces

COLOURS = {"tool": "#4f5d75", "cutter": "#2f3a4f", "turntable": "#7a8b99", "workpiece": "#b59b6a"}  # as view-cell's
ROBOT, AROUND, PATH = "#e8a33d", "#b9c2c9", "#d11f1f"
NAMES = {"tool": "spindle", "cutter": "cutter", "turntable": "turntable", "workpiece": "plate and fixture"}
HUGE_MM = 7200.0  # a body that is larger, a floor or an envelope, is left out: it hides the others


def key_of(cell: Cell) -> list[tuple[str, str]]:
    """Colours and what they mean, of what stands in the cell."""
    bodies = {shape.body for shape in cell.shapes}
    others = bodies - _robot(cell) - set(COLOURS) - {"envelope", "floor"}
    found = [(ROBOT, "robot"), *((COLOURS[body], name) for body, name in NAMES.items() if body in bodies)]
    return [*found, *([(AROUND, ", ".join(sorted(others)))] if others else []), (PATH, "path")]


def _robot(cell: Cell) -> set[str]:
    return {shape.body for shape in cell.shapes if 0 <= shape.link <= 6 and shape.body not in COLOURS}


def robot_picture(
    cell: Cell, joints: Float, turntable: float, path_mm: Float, middle_mm: Float, size_mm: float
) -> bytes:
    """A PNG of the cell; the path (n, 3) is drawn through everything. What is huge is left out."""
    from matplotlib.figure import Figure
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    robot = _robot(cell)
    figure = Figure(figsize=(4.6, 4.2))
    axes: Any = figure.add_axes((0, 0, 1, 1), projection="3d")
    faces, colours = [], []
    made = cell_triangles(cell, joints, turntable)
    huge = {body for body, triangles in made if np.ptp(triangles.reshape(-1, 3), axis=0).max() > HUGE_MM}
    for body, triangles in made:
        away = np.abs(triangles - middle_mm).max(axis=2).min(axis=1)  # of each triangle's nearest corner
        triangles = triangles[away < 0.75 * size_mm]
        if not len(triangles) or body in huge:
            continue
        faces.append(triangles)
        colour = COLOURS.get(body, ROBOT if body in robot else AROUND)
        colours += [colour] * len(triangles)
    axes.add_collection3d(Poly3DCollection(np.concatenate(faces), facecolors=colours, shade=True, linewidths=0))
    axes.plot(*path_mm.T, color=PATH, lw=1.4, zorder=1e6)
    for name, at in zip(("xlim", "ylim", "zlim"), middle_mm, strict=True):
        getattr(axes, f"set_{name}")(at - size_mm / 2, at + size_mm / 2)
    axes.set_box_aspect((1, 1, 1), zoom=1.5)
    axes.view_init(elev=22, azim=-60)
    axes.set_axis_off()
    return pieces.png(figure)
