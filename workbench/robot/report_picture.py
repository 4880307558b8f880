"""A posture of the robot in its cell, as a picture of a report."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from PIL import ImageOps

from workbench.robot.cell import Cell
from workbench.robot.drawing import AROUND, COLOURS, CUBE, RED, ROBOT, Sheet, clearest, colour_of, is_huge, looking, png
from workbench.units import DEG, Float

NAMES = {"tool": "spindle", "cutter": "cutter", "turntable": "turntable", "workpiece": "plate and fixture"}
ELEVATION, AZIMUTH = 22.0 * DEG, -60.0 * DEG  # from where the cell is looked at
LOOK: Sequence[float] = (np.cos(ELEVATION) * np.cos(AZIMUTH), np.cos(ELEVATION) * np.sin(AZIMUTH), np.sin(ELEVATION))
SIZE_PX, LINE_PX, PALE = (690, 630), 4.0, 5


def posture_picture(
    cell: Cell,
    bodies: Sequence[tuple[str, Float]],
    path_mm: Float,
    close_up_mm: float | None = None,
    fan_mm: Sequence[Float] = (),
) -> bytes:
    """A PNG of bodies (name, triangles of `cell_triangles`), cut to what it shows; lines are drawn through all.

    What is huge is left out. A close-up is seen from where bodies hide least of these lines.

    Args:
        cell: whose bodies they are; `workpiece` may also be a plate that it does not hold.
        bodies: as they stand in one posture, mm, in the base.
        path_mm: (n, 3) in the base.
        close_up_mm: width of the surroundings of the path's middle that are shown; None: everything.
        fan_mm: rays (n, 3) of a laser, in the base.

    Example:
        >>> import numpy as np
        >>> from workbench.robot import cell, cell_triangles, posture_picture
        >>> made = cell(cell="data/robot/cell.json")
        >>> bodies = cell_triangles(made, np.zeros(6), 0.0)
        >>> posture_picture(made, bodies, np.array([[1500.0, 0.0, 800.0], [1600.0, 0.0, 800.0]]))[1:4]
        b'PNG'
    """
    shown = [(one, colour_of(cell, body)) for body, one in bodies if not is_huge(one)]
    points = np.concatenate([path_mm, *(one.reshape(-1, 3) for one, _ in shown)])
    look = LOOK
    if close_up_mm is not None:
        middle = (path_mm.min(axis=0) + path_mm.max(axis=0)) / 2
        near = [np.abs(one - middle).max(axis=2).min(axis=1) < 0.75 * close_up_mm for one, _ in shown]
        shown = [(one[which], tint) for (one, tint), which in zip(shown, near, strict=True)]
        points, look = middle + close_up_mm / 2 * CUBE, clearest([one for one, _ in shown], path_mm, fan_mm)
    sheet = Sheet(looking(look, (0, 0, 1), points, SIZE_PX), shown)
    for ray in fan_mm:
        sheet.line(ray, RED, 0.25 * LINE_PX)
    sheet.line(path_mm, RED, LINE_PX)
    picture = sheet.smaller()
    return png(picture.crop(ImageOps.invert(picture).point(lambda value: 255 * (value > PALE)).getbbox()))


def posture_key(cell: Cell) -> list[tuple[str, str]]:
    """Colours of `posture_picture` and what they mean, of what stands in the cell.

    Example:
        >>> from workbench.robot import cell, posture_key
        >>> [name for _, name in posture_key(cell(cell="data/robot/cell.json"))][:2]
        ['robot', 'spindle']
    """
    bodies = {shape.body for shape in cell.shapes}
    others = {body for body in bodies if colour_of(cell, body) == AROUND} - {"envelope", "floor"}
    found = [(ROBOT, "robot"), *((COLOURS[body], name) for body, name in NAMES.items() if body in bodies)]
    found += [] if "workpiece" in bodies else [(COLOURS["workpiece"], "plate, from the path")]
    return [*found, *([(AROUND, ", ".join(sorted(others)))] if others else []), (RED, "path")]
