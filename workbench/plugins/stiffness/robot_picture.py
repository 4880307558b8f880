"""The robot cell as triangles, for pictures of postures (Fig. 17c, d). mm, in the base."""

from __future__ import annotations

import io
from typing import Any

import numpy as np

from workbench.api import Cell, Float, motions, turntable_pose

ROUND = 16  # sides of a round body
COLOURS = {"tool": "#c8553d", "turntable": "#7a8b99", "workpiece": "#b59b6a"}
ROBOT, AROUND = "#e8a33d", "#b9c2c9"


def cell_triangles(cell: Cell, joints: Float, turntable: float) -> list[tuple[str, Float]]:
    """Body and triangles (t, 3, 3) of every shape at joint angles (6,) and a turntable angle, rad."""
    moved, turned = motions(cell.chain, joints), turntable_pose(cell, turntable)
    found = []
    for shape in cell.shapes:
        pose = (turned if shape.link == 7 else moved[max(shape.link, 0)]) @ shape.pose
        found.append((shape.body, _triangles(shape) @ pose[:3, :3].T + pose[:3, 3]))
    return found


def robot_picture(cell: Cell, joints: Float, turntable: float, path_mm: Float, middle_mm: Float,
                  size_mm: float) -> bytes:  # fmt: skip
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
    drawing = io.BytesIO()
    figure.savefig(drawing, format="png", dpi=110, metadata={"Software": None})
    return drawing.getvalue()


def _triangles(shape: Any) -> Float:
    """Triangles (t, 3, 3) of a shape in its own frame."""
    if shape.kind == "mesh":
        return np.asarray(shape.vertices_mm[shape.triangles])
    if shape.kind == "box":
        half = np.array(shape.size_mm) / 2
        ring = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * half[:2]
        return _skin(np.array([np.column_stack([ring * s, np.full(4, z)]) for s, z in
                               ((0, -half[2]), (1, -half[2]), (1, half[2]), (0, half[2]))]))  # fmt: skip
    radius = shape.size_mm[0]
    length = shape.size_mm[1] if len(shape.size_mm) > 1 else 0.0
    if shape.kind == "cylinder":
        outline = np.array([[0, -length / 2], [radius, -length / 2], [radius, length / 2], [0, length / 2]])
    else:
        bow = np.linspace(0, np.pi / 2, 6)
        cap = np.column_stack([radius * np.sin(bow), length / 2 + radius * np.cos(bow)])
        outline = np.vstack([cap * (1, -1), cap[::-1]])
    angles = np.linspace(0, 2 * np.pi, ROUND, endpoint=False)
    circle = np.column_stack([np.cos(angles), np.sin(angles)])
    return _skin(np.array([np.column_stack([r * circle, np.full(ROUND, z)]) for r, z in outline]))


def _skin(rings: Float) -> Float:
    """Triangles between rings (r, k, 3) one above the other."""
    a, b = rings[:-1], rings[1:]
    a_next, b_next = np.roll(a, -1, axis=1), np.roll(b, -1, axis=1)
    return np.concatenate([np.stack(corners, axis=2).reshape(-1, 3, 3) for corners in ((a, a_next, b_next),
                                                                                       (a, b_next, b))])  # fmt: skip
