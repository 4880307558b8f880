"""What is written into the pictures of `workbench.robot.draw`: grid, frames, distances, names."""

from __future__ import annotations

from typing import Any

import numpy as np
import pyvista as pv

from workbench.robot.picture import HIT, CellPicture
from workbench.units import Float

INK, PAPER, GRID = "#1b1f24", "#ffffff", "#a4adb8"
AXES = ("#d55e00", "#009e73", "#0072b2")  # x, y, z
FORWARD_MM = 2e4  # what lies this far in front is drawn over all bodies; a parallel projection leaves its place
ABOVE_MM = 2.0  # the grid above the floor, or else they flicker
NAMES_AT = {
    "base": (-0.06, -0.05),
    "turntable": (-0.14, -0.1),
    "cutter": (-0.06, 0.1),
    "flange": (0.1, 0.1),
    "sensor": (0.14, 0.02),
    "gap": (-0.05, -0.13),
}


def add_grid(plotter: Any, low: Float, high: Float, spacing: float, look: Float) -> None:
    """Lines at whole multiples of the spacing, in the base's x-y plane or, seen from the side, behind everything."""
    across = 1 if look[2] == 0 else 2
    level = high[1] if across == 1 else np.clip(0.0, low[2], high[2]) + ABOVE_MM
    first, second = (axis for axis in range(3) if axis != across)
    for along, other in ((first, second), (second, first)):
        for at in np.arange(np.ceil(low[other] / spacing), high[other] / spacing) * spacing:
            ends = np.full((2, 3), level)
            ends[:, other], ends[:, along] = at, (low[along], high[along])
            plotter.add_mesh(pv.Line(*ends), color=GRID, line_width=1.0, lighting=False, reset_camera=False)


def add_frames(plotter: Any, view: CellPicture, names: tuple[str, ...], screen: Float, size: float) -> None:
    """Three arrows and a name for each frame, in front of all bodies."""
    for pose, name in zip(view.base_from_frame, view.frames, strict=True):
        if name not in names:
            continue
        origin = pose[:3, 3] + FORWARD_MM * screen[2]
        for axis, colour in zip(pose[:3, :3].T, AXES, strict=True):
            arrow = pv.Arrow(origin, axis, scale=0.06 * size, shaft_radius=0.03, tip_radius=0.08, tip_length=0.25)
            plotter.add_mesh(arrow, color=colour, lighting=False, reset_camera=False)
        _add_note(plotter, origin, size * (np.array(NAMES_AT[name]) @ screen[:2]), name, INK)


def add_gaps(plotter: Any, view: CellPicture, screen: Float, size: float) -> None:
    """The shortest distances, in front of all bodies."""
    for ends in view.gaps_mm:
        points = ends + FORWARD_MM * screen[2]
        plotter.add_mesh(pv.Line(*points), color=HIT, line_width=5.0, lighting=False, reset_camera=False)
        length = np.linalg.norm(ends[1] - ends[0])
        _add_note(
            plotter, points.mean(axis=0), size * (np.array(NAMES_AT["gap"]) @ screen[:2]), f"{length:.1f} mm", HIT
        )


def add_names(plotter: Any, view: CellPicture, screen: Float, size: Float) -> None:
    """What stands around, named on top of it; not a floor, which is larger than the picture."""
    for index in np.flatnonzero(view.named):
        corners = view.triangles_mm[view.body == index].reshape(-1, 3)
        if (np.ptp(corners, axis=0) > size).any():
            continue
        top = np.append((corners[:, :2].min(axis=0) + corners[:, :2].max(axis=0)) / 2, corners[:, 2].max())
        _add_text(plotter, top + FORWARD_MM * screen[2], str(view.names[index]), INK)


def _add_note(plotter: Any, at: Float, aside: Float, text: str, colour: str) -> None:
    """A text beside a place, with a line to it."""
    plotter.add_mesh(pv.Line(at, at + aside), color=colour, line_width=1.0, lighting=False, reset_camera=False)
    _add_text(plotter, at + aside, text, colour)


def _add_text(plotter: Any, place: Float, text: str, colour: str) -> None:
    look = {"font_size": 22, "text_color": colour, "bold": False, "shape_color": PAPER, "shape_opacity": 0.75}
    plotter.add_point_labels(
        place[None], [text], always_visible=True, show_points=False, margin=4, reset_camera=False, **look
    )
