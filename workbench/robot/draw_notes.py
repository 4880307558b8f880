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
FONT_PX, LETTER_PX = 22, 12.5
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


class Notes:
    """Texts of one view, none on top of another."""

    def __init__(self, plotter: Any, screen: Float, px_mm: float) -> None:
        """`screen`: rows right, up, to the viewer; `px_mm`: of a pixel."""
        self.plotter, self.screen, self.px_mm = plotter, screen, px_mm
        self._taken: list[Float] = []  # left, low, right, high on the screen, mm

    def on(self, place: Float, text: str, colour: str) -> None:
        """A text at a place."""
        self._taken.append(self._box(place, text))
        look = {"font_size": FONT_PX, "text_color": colour, "bold": False, "shape_color": PAPER, "shape_opacity": 0.75}
        self.plotter.add_point_labels(
            place[None], [text], always_visible=True, show_points=False, margin=4, reset_camera=False, **look
        )

    def beside(self, at: Float, aside: Float, text: str, colour: str) -> None:
        """A text beside a place, with a line to it: at (right, up) `aside`, or where there is room around."""
        ways = [at + turned @ self.screen[:2] for turned in _around(aside)]
        free = (place for place in ways if not any(_overlap(self._box(place, text), one) for one in self._taken))
        place = next(free, ways[0])
        line = pv.Line(at, place)
        self.plotter.add_mesh(line, color=colour, line_width=1.0, lighting=False, reset_camera=False)
        self.on(place, text, colour)

    def _box(self, place: Float, text: str) -> Float:
        """About: a text stands to the right of its place and above it."""
        low = self.screen[:2] @ place
        return np.concatenate([low, low + self.px_mm * np.array([LETTER_PX * len(text) + 8, 1.5 * FONT_PX])])


def _around(aside: Float) -> list[Float]:
    """The vector (2,) itself, then turned either way and longer."""
    found = []
    for longer in (1.0, 1.5, 2.0):
        for turn in np.radians([0, 25, -25, 50, -50, 90, -90, 140, -140]):
            c, s = np.cos(turn), np.sin(turn)
            found.append(longer * np.array([[c, -s], [s, c]]) @ aside)
    return found


def _overlap(a: Float, b: Float) -> bool:
    return bool((a[:2] < b[2:]).all() and (b[:2] < a[2:]).all())


def add_frames(notes: Notes, view: CellPicture, names: tuple[str, ...], size: float) -> None:
    """Three arrows and a name for each frame, in front of all bodies."""
    for pose, name in zip(view.base_from_frame, view.frames, strict=True):
        if name not in names:
            continue
        origin = pose[:3, 3] + FORWARD_MM * notes.screen[2]
        for axis, colour in zip(pose[:3, :3].T, AXES, strict=True):
            arrow = pv.Arrow(origin, axis, scale=0.06 * size, shaft_radius=0.03, tip_radius=0.08, tip_length=0.25)
            notes.plotter.add_mesh(arrow, color=colour, lighting=False, reset_camera=False)
        notes.beside(origin, size * np.array(NAMES_AT[name]), name, INK)


def add_gaps(notes: Notes, view: CellPicture, size: float) -> None:
    """The shortest distances, in front of all bodies."""
    for ends in view.gaps_mm:
        points = ends + FORWARD_MM * notes.screen[2]
        notes.plotter.add_mesh(pv.Line(*points), color=HIT, line_width=5.0, lighting=False, reset_camera=False)
        length = np.linalg.norm(ends[1] - ends[0])
        notes.beside(points.mean(axis=0), size * np.array(NAMES_AT["gap"]), f"{length:.1f} mm", HIT)


def add_names(notes: Notes, view: CellPicture, size: Float) -> None:
    """What stands around, named on top of it; not a floor, which is larger than the picture."""
    for index in np.flatnonzero(view.named):
        corners = view.triangles_mm[view.body == index].reshape(-1, 3)
        if (np.ptp(corners, axis=0) > size).any():
            continue
        top = np.append((corners[:, :2].min(axis=0) + corners[:, :2].max(axis=0)) / 2, corners[:, 2].max())
        notes.on(top + FORWARD_MM * notes.screen[2], str(view.names[index]), INK)
