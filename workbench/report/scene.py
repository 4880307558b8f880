"""What a view in space shows: coloured points, dots and lines, and outlined planes, in parallel projection."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from workbench.units import AnyArray, Float, Int, Shaped

ROOM_ABOVE = 0.03  # of a picture's width, for the numbers of the planes
AXES = ("t", "n", "m")  # the rows of View.axes


def _none(*shape: int) -> Float:
    return np.zeros(shape)


@dataclass(frozen=True, slots=True, eq=False)
class View:
    """One picture, in mm from a local origin, axes of the base. Colours: uint8 red, green, blue.

    Lines are one array of points, each line from one of `line_start` to the next.
    """

    points_mm: Shaped[Float, "n 3"]
    colour: Shaped[AnyArray, "n 3"]
    axes: Shaped[Float, "3 3"]  # rows t, n, m at the origin
    look: Shaped[Float, " 3"]  # unit, towards the viewer
    axes_length_mm: float = 0.0  # 0: not drawn
    dots_mm: Shaped[Float, "d 3"] = field(default_factory=lambda: _none(0, 3))  # larger than the points
    dot_colour: Shaped[AnyArray, "d 3"] = field(default_factory=lambda: _none(0, 3))
    lines_mm: Shaped[Float, "p 3"] = field(default_factory=lambda: _none(0, 3))
    line_colour: Shaped[AnyArray, "p 3"] = field(default_factory=lambda: _none(0, 3))
    line_start: Shaped[Int, " l"] = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    planes_mm: Shaped[Float, "k 4 3"] = field(
        default_factory=lambda: _none(0, 4, 3)
    )  # lower inner, outer, upper outer, inner
    plane_colour: Shaped[AnyArray, "k 3"] = field(default_factory=lambda: _none(0, 3))
    names: tuple[str, ...] = ()  # (k,) of the planes
    width_px: int = 1600

    def lines(self) -> list[tuple[Float, AnyArray]]:
        """Each line's points and their colours."""
        inner = self.line_start[1:]
        found = zip(np.split(self.lines_mm, inner), np.split(self.line_colour, inner), strict=True)
        return [(points, colour) for points, colour in found if len(points) > 1]

    def everything_mm(self) -> Float:
        """(q, 3) all that must be inside the picture."""
        return np.vstack([self.points_mm, self.dots_mm, self.lines_mm, self.planes_mm.reshape(-1, 3)])


def joined(view: View, lines_mm: list[Float], colours: list[AnyArray]) -> View:
    """The view with lines (each (p, 3) points with their (p, 3) colours)."""
    if not lines_mm:
        return view
    start = np.cumsum([0, *(len(line) for line in lines_mm[:-1])])
    return replace(view, lines_mm=np.vstack(lines_mm), line_colour=np.vstack(colours), line_start=start)


def towards(axes: Float, look: tuple[float, float, float]) -> Float:
    """Unit vector towards the viewer, given along the rows of `axes`."""
    direction: Float = axes.T @ (np.array(look) / np.linalg.norm(look))
    return direction


def extent(points_mm: Float, look: Float, up: Float) -> tuple[Float, Float, Float]:
    """Rows right, up, to the viewer (3, 3) of a picture, and the lowest and highest corner of what is in it (3,)."""
    right = np.cross(up, look)
    right /= np.linalg.norm(right)
    screen = np.array([right, np.cross(look, right), look])
    seen = screen @ points_mm.T
    low, high = seen.min(axis=1), seen.max(axis=1)
    return screen, low, high + np.array([0.0, ROOM_ABOVE * (high[0] - low[0]), 0.0])


def aspect(low: Float, high: Float) -> float:
    """Height of a picture over its width, within what a page can hold."""
    return float(min(0.6, max(0.28, (high[1] - low[1]) / (high[0] - low[0]))))
