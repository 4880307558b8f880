"""Pictures of the robot cell in a posture, for the chapter of postures (Fig. 17c, d). mm, in the base."""

from __future__ import annotations

import io
from collections.abc import Sequence
from typing import Any

import numpy as np

from workbench.api import DEG, Cell, Float, Shaped, Toolpath, cell_triangles, pieces, rotation_from_quaternion
from workbench.plugins.stiffness.law_postures import Found

COLOURS = {"tool": "#4f5d75", "cutter": "#2f3a4f", "turntable": "#7a8b99", "workpiece": "#b59b6a"}  # as view-cell's
ROBOT, AROUND, PATH = "#e8a33d", "#b9c2c9", "#d11f1f"
NAMES = {"tool": "spindle", "cutter": "cutter", "turntable": "turntable", "workpiece": "plate and fixture"}
PLATE = "plate, from the path"
NO_PLATE = "The cell holds no plate: it is drawn as the path has it, 150 mm of its width."
HUGE_MM = 7200.0  # a body that is larger, a floor or an envelope, is left out: it hides the others
CLOSE_UP_MM, BESIDE = 220.0, 1.3  # the close-up shows so much at least, and so many times the path
PLATE_MM, PLATE_STEPS = 150.0, 40  # of the plate: drawn from its edge on; stretches along it
PLATE_BODY = "plate of the path"
BACK, FORTH = ((2, 1), (3, 2), (4, 3)), ((1, 2), (2, 3), (3, 4))  # its ends as triangles, seen from outside
ELEVATION_DEG, AZIMUTH_DEG = 22.0, -60.0  # from where the cell is looked at
DPI, FINER, BORDER = (
    150,
    2,
    8,
)  # of a picture; drawn so much finer and made smaller, or edges are ragged; px left around


def robots_html(cell: Cell, found: Found, toolpath: Toolpath) -> str:
    """Before and after, from the same point of view: the cell, and close to the path."""
    made = found.postures
    at = found.points.loaded[len(found.points.loaded) // 2]
    before = found.cases["as planned"]
    views = [] if before is None else [("As planned", before.joints[at], before.table)]
    views.append(("As chosen", made.joints[at], float(made.turntable[at])))
    drawn = []
    for name, joints, table in views:
        turned = found.points.turned(cell, np.array([table]))[0]
        way = (turned @ found.points.base_from_point[found.points.cutting])[:, :3, 3]
        bodies = cell_triangles(cell, joints, table)
        if not any(body == "workpiece" for body, _ in bodies):
            bodies.append((PLATE_BODY, plate_triangles(toolpath) @ turned[:3, :3].T + turned[:3, 3]))
        size = max(CLOSE_UP_MM, BESIDE * float(np.ptp(way, axis=0).max()))
        colours = colours_of(cell, [body for body, _ in bodies])
        drawn.append((robot_picture(bodies, colours, way), name))
        drawn.append((robot_picture(bodies, colours, way, size), f"{name}, close to the path"))
    note = "" if any(shape.body == "workpiece" for shape in cell.shapes) else pieces.paragraph(NO_PLATE)
    return pieces.panels_html(drawn, pairs=True) + pieces.key_html(key_of(cell)) + note


def colours_of(cell: Cell, bodies: Sequence[str]) -> list[str]:
    """The colour of each body."""
    robot, plate = _robot(cell), {PLATE_BODY: COLOURS["workpiece"]}
    return [{**COLOURS, **plate}.get(body, ROBOT if body in robot else AROUND) for body in bodies]


def key_of(cell: Cell) -> list[tuple[str, str]]:
    """Colours and what they mean, of what stands in the cell."""
    bodies = {shape.body for shape in cell.shapes}
    others = bodies - _robot(cell) - set(COLOURS) - {"envelope", "floor"}
    found = [(ROBOT, "robot"), *((COLOURS[body], name) for body, name in NAMES.items() if body in bodies)]
    found += [] if "workpiece" in bodies else [(COLOURS["workpiece"], PLATE)]
    return [*found, *([(AROUND, ", ".join(sorted(others)))] if others else []), (PATH, "path")]


def _robot(cell: Cell) -> set[str]:
    return {shape.body for shape in cell.shapes if 0 <= shape.link <= 6 and shape.body not in COLOURS}


def plate_triangles(toolpath: Toolpath) -> Shaped[Float, "t 3 3"]:
    """The finished plate along the final layer, counter-clockwise from outside; PLATE_MM of its surfaces."""
    final, bevel = toolpath.layers[-1], toolpath.bevel_deg * DEG
    use = np.flatnonzero(final.cutting)
    use = use[np.unique(np.linspace(0, len(use) - 1, min(PLATE_STEPS, len(use))).astype(int))]
    x, _, z = np.moveaxis(rotation_from_quaternion(final.quaternion_wxyz[use]), 2, 0)
    outwards = np.sin(bevel) * z - np.cos(bevel) * x
    across = -np.cos(bevel) * z - np.sin(bevel) * x  # from the lower to the upper side
    half = final.width_mm[use, None] / 2
    upper, root = final.position_mm[use] - half * z, final.position_mm[use] + half * z
    lower = root - toolpath.root_mm * across
    outline = np.stack([upper - PLATE_MM * outwards, upper, root, lower, lower - PLATE_MM * outwards], axis=1)
    work = np.eye(4) if toolpath.base_from_workobject is None else toolpath.base_from_workobject
    outline = outline @ work[:3, :3].T + work[:3, 3]
    a, b = outline[:-1], outline[1:]
    a_next, b_next = (np.roll(one, -1, axis=1) for one in (a, b))
    skin = np.concatenate([np.stack([a, b_next, b], axis=2), np.stack([a, a_next, b_next], axis=2)]).reshape(-1, 3, 3)
    fans = [outline[end][[0, *pair]] for end, pairs in ((0, BACK), (-1, FORTH)) for pair in pairs]
    return np.concatenate([skin, fans])


def seen(triangles: Float) -> Float:
    """Those that face the viewer: matplotlib sorts whole triangles by depth, and thin bodies shine through."""
    normal = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    azimuth, elevation = AZIMUTH_DEG * DEG, ELEVATION_DEG * DEG
    level = np.cos(elevation)
    return np.asarray(triangles[normal @ [level * np.cos(azimuth), level * np.sin(azimuth), np.sin(elevation)] > 0])


def robot_picture(
    bodies: Sequence[tuple[str, Float]], colours: Sequence[str], path_mm: Float, close_up_mm: float | None = None
) -> bytes:
    """A PNG of bodies (name, triangles), cut to what it shows; the path (n, 3) is drawn through everything.

    What is huge is left out. `close_up_mm`: of the surroundings of the path's middle only.
    """
    from matplotlib.figure import Figure
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

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
