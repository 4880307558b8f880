"""Pictures of the robot cell in a posture, for the chapter of postures (Fig. 17c, d). mm, in the base."""

from __future__ import annotations

from typing import Any

import numpy as np

from workbench.api import Cell, Float, cell_triangles, pieces

COLOURS = {"tool": "#c8553d", "turntable": "#7a8b99", "workpiece": "#b59b6a"}
ROBOT, AROUND = "#e8a33d", "#b9c2c9"


def robot_picture(
    cell: Cell, joints: Float, turntable: float, path_mm: Float, middle_mm: Float, size_mm: float
) -> bytes:
    """A PNG of the cell; the path (n, 3) is drawn through everything. The floor is left out: it hides nothing."""
    from matplotlib.figure import Figure
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    robot = {shape.body for shape in cell.shapes if 0 <= shape.link <= 6 and shape.body != "tool"}
    figure = Figure(figsize=(4.6, 4.2))
    axes: Any = figure.add_axes((0, 0, 1, 1), projection="3d")
    faces, colours = [], []
    for body, triangles in cell_triangles(cell, joints, turntable):
        if np.ptp(triangles.reshape(-1, 3), axis=0).max() > 2 * size_mm:
            continue
        faces.append(triangles)
        colour = COLOURS.get(body, ROBOT if body in robot else AROUND)
        colours += [colour] * len(triangles)
    axes.add_collection3d(Poly3DCollection(np.concatenate(faces), facecolors=colours, shade=True, linewidths=0))
    axes.plot(*path_mm.T, color="#1b4965", lw=2.5, zorder=1e6)
    for name, at in zip(("xlim", "ylim", "zlim"), middle_mm, strict=True):
        getattr(axes, f"set_{name}")(at - size_mm / 2, at + size_mm / 2)
    axes.set_box_aspect((1, 1, 1), zoom=1.5)
    axes.view_init(elev=22, azim=-60)
    axes.set_axis_off()
    return pieces.png(figure)
