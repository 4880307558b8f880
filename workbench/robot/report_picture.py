"""A posture of the robot in its cell, as a picture of a report."""

from __future__ import annotations

import io
from collections.abc import Sequence
from typing import Any

import numpy as np

from workbench.robot.cell import Cell
from workbench.units import DEG, Float

COLOURS = {"tool": "#4f5d75", "cutter": "#2f3a4f", "turntable": "#7a8b99", "workpiece": "#b59b6a"}  # as view-cell's
ROBOT, AROUND, PATH = "#e8a33d", "#b9c2c9", "#d11f1f"
NAMES = {"tool": "spindle", "cutter": "cutter", "turntable": "turntable", "workpiece": "plate and fixture"}
HUGE_MM = 7200.0  # a body that is larger, a floor or an envelope, is left out: it hides the others
ELEVATION_DEG, AZIMUTH_DEG = 22.0, -60.0  # from where the cell is looked at
# Of a picture; drawn so much finer and made smaller, or edges are ragged; px left around.
DPI, FINER, BORDER = 150, 2, 8


def posture_picture(
    cell: Cell, bodies: Sequence[tuple[str, Float]], path_mm: Float, close_up_mm: float | None = None
) -> bytes:
    """A PNG of bodies (name, triangles of `cell_triangles`), cut to what it shows; the path is drawn through all.

    What is huge is left out.

    Args:
        cell: whose bodies they are; `workpiece` may also be a plate that it does not hold.
        bodies: as they stand in one posture, mm, in the base.
        path_mm: (n, 3) in the base.
        close_up_mm: width of the surroundings of the path's middle that are shown; None: everything.

    Example:
        >>> import numpy as np
        >>> from workbench.robot import cell, cell_triangles, posture_picture
        >>> made = cell(cell="data/robot/cell.json")
        >>> bodies = cell_triangles(made, np.zeros(6), 0.0)
        >>> posture_picture(made, bodies, np.array([[1500.0, 0.0, 800.0], [1600.0, 0.0, 800.0]]))[1:4]
        b'PNG'
    """
    from matplotlib.figure import Figure
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    colours = _colours_of(cell, [body for body, _ in bodies])
    shown = [
        (seen(triangles), colour)
        for (_, triangles), colour in zip(bodies, colours, strict=True)
        if np.ptp(triangles.reshape(-1, 3), axis=0).max() <= HUGE_MM
    ]
    low, high = path_mm.min(axis=0), path_mm.max(axis=0)
    if close_up_mm is not None:
        middle = (low + high) / 2
        near = [np.abs(triangles - middle).max(axis=2).min(axis=1) < 0.75 * close_up_mm for triangles, _ in shown]
        shown = [(triangles[one], colour) for (triangles, colour), one in zip(shown, near, strict=True)]
        low, high = middle - close_up_mm / 2, middle + close_up_mm / 2
    elif shown:
        corners = np.concatenate([path_mm, *(triangles.reshape(-1, 3) for triangles, _ in shown)])
        low, high = corners.min(axis=0), corners.max(axis=0)
    figure = Figure(figsize=(4.6, 4.2))
    axes: Any = figure.add_axes((0, 0, 1, 1), projection="3d", proj_type="ortho")
    faces = [triangles for triangles, _ in shown if len(triangles)]
    if faces:  # a cell may give no bodies: nothing of it is checked then, and the program says so
        tints = [colour for triangles, colour in shown for _ in triangles]
        drawn = Poly3DCollection(np.concatenate(faces), facecolors=tints, shade=True, linewidths=0, antialiased=False)
        axes.add_collection3d(drawn)
    axes.plot(*path_mm.T, color=PATH, lw=2.2, zorder=1e6)
    for name, a, b in zip("xyz", low, high, strict=True):
        getattr(axes, f"set_{name}lim")(a, b)
    axes.set_box_aspect(np.maximum(high - low, 1.0), zoom=1.3 if close_up_mm is None else 1.5)
    axes.view_init(elev=ELEVATION_DEG, azim=AZIMUTH_DEG)
    axes.set_axis_off()
    return _cut_to_content(figure)


def posture_key(cell: Cell) -> list[tuple[str, str]]:
    """Colours of `posture_picture` and what they mean, of what stands in the cell.

    Example:
        >>> from workbench.robot import cell, posture_key
        >>> [name for _, name in posture_key(cell(cell="data/robot/cell.json"))][:2]
        ['robot', 'spindle']
    """
    bodies = {shape.body for shape in cell.shapes}
    others = bodies - _robot(cell) - set(COLOURS) - {"envelope", "floor"}
    found = [(ROBOT, "robot"), *((COLOURS[body], name) for body, name in NAMES.items() if body in bodies)]
    found += [] if "workpiece" in bodies else [(COLOURS["workpiece"], "plate, from the path")]
    return [*found, *([(AROUND, ", ".join(sorted(others)))] if others else []), (PATH, "path")]


def _colours_of(cell: Cell, bodies: Sequence[str]) -> list[str]:
    """The colour of each body."""
    robot = _robot(cell)
    return [COLOURS.get(body, ROBOT if body in robot else AROUND) for body in bodies]


def _robot(cell: Cell) -> set[str]:
    return {shape.body for shape in cell.shapes if 0 <= shape.link <= 6 and shape.body not in COLOURS}


def seen(triangles: Float) -> Float:
    """Those that face the viewer: matplotlib sorts whole triangles by depth, and thin bodies shine through."""
    normal = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    azimuth, elevation = AZIMUTH_DEG * DEG, ELEVATION_DEG * DEG
    level = np.cos(elevation)
    return np.asarray(triangles[normal @ [level * np.cos(azimuth), level * np.sin(azimuth), np.sin(elevation)] > 0])


def _cut_to_content(figure: Any) -> bytes:
    """The figure as PNG without the paper around what is drawn."""
    from PIL import Image

    drawn, made = io.BytesIO(), io.BytesIO()
    figure.savefig(drawn, format="png", dpi=FINER * DPI)
    picture = Image.open(drawn).convert("RGB")
    inked = np.argwhere((np.asarray(picture) < 250).any(axis=2))
    if len(inked):
        (top, left), (bottom, right) = inked.min(axis=0) - BORDER, inked.max(axis=0) + BORDER
        picture = picture.crop((max(left, 0), max(top, 0), min(right, picture.width), min(bottom, picture.height)))
    picture.resize((picture.width // FINER, picture.height // FINER), Image.Resampling.LANCZOS).save(made, "PNG")
    return made.getvalue()
