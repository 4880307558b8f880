"""A cloud without a grid cut across its edge into profiles, so that it can be measured like a scanner's own grid.

Points are laid out along a course: arc length, and place in the section plane. Slices of equal thickness are the frames
of the new grid, strips of equal width its columns; of the points of a cell one stands for it, as a profiler's pixel has
one return.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from workbench.geometry.blocks import as_input
from workbench.geometry.curves import Curve
from workbench.kernels import kernel
from workbench.units import Float, Float32, Int, Shaped

FRONT_MM = 0.5  # points of a cell this near to its foremost one are of the surface that is seen there
MARGIN = 20  # empty columns on each side: no field of view ends a slice
MOST_COLUMNS = 4000


@dataclass(frozen=True, slots=True, eq=False)
class Laid:
    """n points laid out along a course: each in its own section plane, so that a curved edge becomes straight."""

    course: Curve
    s: Shaped[Float, " n"]  # arc length, mm
    place: Shaped[Float, "n 2"]  # along the course's (a, b), mm


def lay_out(points_mm: Float, course: Curve, s: Float) -> Laid:
    """Lay points (n, 3) out along the course; s (n,): about where they lie along it."""
    s = course.project(points_mm, s)
    _, a, b = course.frame(s)
    off = points_mm - course.position(s)
    return Laid(course, s, np.stack([np.einsum("ij,ij->i", off, axis) for axis in (a, b)], axis=1))


def seen_from(laid: Laid, view: Float, at_mm: Float) -> tuple[Float, Float]:
    """x and z axes (2, 2) in the course's (a, b), z along the view; and x and z of all points (2, n), mm.

    view (3,): direction of sight, away from the observer, in the middle of arc lengths at_mm (N,).
    """
    _, a, b = laid.course.frame(np.array([np.median(at_mm)]))
    turn = float(np.arctan2(b[0] @ view, a[0] @ view))
    axes = np.array([[-np.sin(turn), np.cos(turn)], [np.cos(turn), np.sin(turn)]])
    return axes, axes @ laid.place.T


def cut(laid: Laid, view: Float, at_mm: Float, thickness_mm: float, width_mm: float) -> tuple[Float32, Float32, Float]:
    """Slices of a thickness around arc lengths at_mm (N,), rising and at least a thickness apart, as profiles.

    view (3,): direction of sight, away from the observer, at the middle of the course.

    Returns x and z (N, M), mm, NaN in empty cells, and base_from_profiler (N, 4, 4), y along the course, z along the
    view.
    """
    axes, (x, z) = seen_from(laid, view, at_mm)
    width_mm = max(width_mm, float(np.ptp(x)) / MOST_COLUMNS)
    first = float(x.min()) - MARGIN * width_mm
    columns = int(np.ptp(x) / width_mm) + 1 + 2 * MARGIN
    frame = np.searchsorted(at_mm - 0.5 * thickness_mm, laid.s, side="right") - 1
    frame[laid.s > at_mm[frame] + 0.5 * thickness_mm] = -1
    column = ((x - first) / width_mm).astype(np.int64)
    off_middle = np.abs((x - first) / width_mm - column - 0.5)
    chosen = _chosen(frame, column, as_input(z), off_middle, at_mm.size, columns)
    grid = [np.where(chosen >= 0, value[chosen], np.nan).astype(np.float32) for value in (x, z)]
    return grid[0], grid[1], _poses(laid.course, at_mm, axes)


def _poses(course: Curve, at: Float, axes: Float) -> Float:
    """base_from_profiler (N, 4, 4): origin on the course, y along it; rows of `axes`: x and z in its (a, b)."""
    t, a, b = course.frame(at)
    pose = np.tile(np.eye(4), (at.size, 1, 1))
    pose[:, :3, 0] = axes[0, 0] * a + axes[0, 1] * b
    pose[:, :3, 1] = t
    pose[:, :3, 2] = axes[1, 0] * a + axes[1, 1] * b
    pose[:, :3, 3] = course.position(at)
    return pose


@kernel
def _chosen(frame: Int, column: Int, z: Float, off_middle: Float, frames: int, columns: int) -> Int:
    """The point that stands for each cell (frames, columns), -1: none. In front, and nearest to the cell's middle."""
    front = np.full((frames, columns), np.inf)
    for i in range(frame.size):
        if frame[i] >= 0:
            front[frame[i], column[i]] = min(front[frame[i], column[i]], z[i])
    chosen, nearest = np.full((frames, columns), -1, np.int64), np.full((frames, columns), np.inf)
    for i in range(frame.size):
        k, j = frame[i], column[i]
        if k >= 0 and off_middle[i] < nearest[k, j] and z[i] <= front[k, j] + FRONT_MM:
            chosen[k, j], nearest[k, j] = i, off_middle[i]
    return chosen
