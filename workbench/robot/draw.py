"""Draws cells with VTK, offscreen: `python -m workbench.robot.draw NAME...` in a folder of its own.

Reads `NAME.npz` (the fields of `workbench.robot.picture.CellPicture`), writes `NAME.png` beside it.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pyvista as pv

from workbench.robot.picture import HIT, CellPicture
from workbench.units import Float

INK, PAPER, GRID = "#1b1f24", "#ffffff", "#a4adb8"
AXES = ("#d55e00", "#009e73", "#0072b2")  # x, y, z
FORWARD_MM = 2e4  # what lies this far in front is drawn over all bodies; a parallel projection leaves its place
FONT_PX, LETTER_PX = 22, 12.5
CAPTION_PX = 80  # three lines at the top of a view
WIDTH_PX, HEIGHT_PX = 2000, 1500
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
    """Texts of one view, none on top of another, and none beyond its edges."""

    def __init__(self, plotter: Any, screen: Float) -> None:
        """`screen`: rows right, up, to the viewer."""
        self.plotter, self.screen = plotter, screen
        half = plotter.camera.parallel_scale  # mm, of the view's height
        self.px_mm = 2 * half / (HEIGHT_PX / 2)  # two views stand on top of each other
        middle = screen[:2] @ np.array(plotter.camera.focal_point)
        size = half * np.array([WIDTH_PX / HEIGHT_PX, 1.0])
        self._edges = np.concatenate([middle - size, middle + size - [0, CAPTION_PX * self.px_mm]])
        self._taken: list[Float] = []  # left, low, right, high on the screen, mm

    def shows(self, places: Float) -> bool:
        """Whether any of the places (n, 3) lies in the view."""
        at = places @ self.screen[:2].T
        return bool(((at >= self._edges[:2]) & (at <= self._edges[2:])).all(axis=1).any())

    def on(self, place: Float, text: str, colour: str) -> None:
        """A text at a place, or as near as the view's edges let it."""
        place = self._kept(place, text)
        self._taken.append(self._box(place, text))
        look = {"font_size": FONT_PX, "text_color": colour, "bold": False, "shape_color": PAPER, "shape_opacity": 0.75}
        self.plotter.add_point_labels(
            place[None], [text], always_visible=True, show_points=False, margin=4, reset_camera=False, **look
        )

    def beside(self, at: Float, aside: Float, text: str, colour: str) -> None:
        """A text beside a place, with a line to it: at (right, up) `aside`, or where there is room around."""
        ways = [self._kept(at + turned @ self.screen[:2], text) for turned in _around(aside)]
        free = (place for place in ways if not any(_overlap(self._box(place, text), one) for one in self._taken))
        place = next(free, ways[0])
        line = pv.Line(at, place)
        self.plotter.add_mesh(line, color=colour, line_width=1.0, lighting=False, reset_camera=False)
        self.on(place, text, colour)

    def _kept(self, place: Float, text: str) -> Float:
        """The place, moved across the screen until its text lies in the view."""
        box = self._box(place, text)
        out = np.maximum(self._edges[:2] - box[:2], 0) - np.maximum(box[2:] - self._edges[2:], 0)
        return np.asarray(place + out @ self.screen[:2])

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
        if not notes.shows(points):
            continue
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
        notes = Notes(plotter, screen)
        add_frames(notes, view, ("base", "turntable", "cutter"), float((high - low).max()))
        add_gaps(notes, view, float((high - low).max()))
        if i == 0:
            add_names(notes, view, high - low)
    plotter.subplot(1, 1)
    near, far = _tool_bounds(view)
    screen = _look(plotter, np.array(VIEWS[0][1]), np.array(VIEWS[0][2]), near, far)
    _scene(plotter, view, low, high, "tool; axes x vermilion, y green, z blue")
    notes = Notes(plotter, screen)
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
