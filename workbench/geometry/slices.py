"""A cloud without a grid cut across its edge into profiles, so that it can be measured like a scanner's own grid.

Points are laid out along a course: arc length, and place in the section plane. Slices of equal thickness are the frames
of the new grid, strips of equal width its columns; of the points of a cell one stands for it, as a profiler's pixel has
one return.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit

from workbench.geometry.blocks import as_input
from workbench.geometry.curves import Curve
from workbench.units import Bool, Float, Float32, Int

FRONT_MM = 0.5  # points of a cell this near to its foremost one are of the surface that is seen there


@dataclass(frozen=True, slots=True, eq=False)
class Laid:
    """n points laid out along a course, as seen in direction `view`."""

    s: Float  # (n,) arc length, mm
    x: Float  # (n,) mm across the view, in the section plane
    z: Float  # (n,) mm along the view
    turn: float  # of the view in the course's frame (a, b), rad


@dataclass(frozen=True, slots=True, eq=False)
class Slices:
    """Frames (N) by columns (M) of laid-out points."""

    x_mm: Float32  # (N, M) NaN in empty cells
    z_mm: Float32  # (N, M)
    keep: Bool  # (N, M)
    base_from_profiler: Float  # (N, 4, 4)
    s: Float  # (N,) arc length of the slices' middles


def lay_out(points_mm: Float, course: Curve, s: Float, view: Float) -> Laid:
    """Lay points (n, 3) out along the course: each in its own section plane, so that a curved edge becomes straight.

    s (n,): about where the points lie along it. view (3,): direction of sight, away from the observer.
    """
    s = course.project(points_mm, s)
    _, a, b = course.frame(s)
    off = points_mm - course.position(s)
    u, v = np.einsum("ij,ij->i", off, a), np.einsum("ij,ij->i", off, b)
    _, a0, b0 = course.frame(np.array([np.median(s)]))
    turn = float(np.arctan2(b0[0] @ view, a0[0] @ view))
    return Laid(s, u * np.sin(turn) - v * np.cos(turn), u * np.cos(turn) + v * np.sin(turn), turn)


def cut(laid: Laid, course: Curve, at_mm: Float, thickness_mm: float, width_mm: float) -> Slices:
    """Slices of a thickness around arc lengths at_mm (N,), rising and at least a thickness apart."""
    first = float(laid.x.min())
    columns = int((float(laid.x.max()) - first) / width_mm) + 1
    frame = np.searchsorted(at_mm - 0.5 * thickness_mm, laid.s, side="right") - 1
    frame[(frame >= 0) & (laid.s > at_mm[frame] + 0.5 * thickness_mm)] = -1
    chosen = _chosen(as_input(frame), as_input(laid.x), as_input(laid.z), first, width_mm, at_mm.size, columns)
    keep = chosen >= 0
    return Slices(*(np.where(keep, value[chosen], np.nan).astype(np.float32) for value in (laid.x, laid.z)), keep,
                  _poses(course, at_mm, laid.turn), at_mm)  # fmt: skip


def _poses(course: Curve, at: Float, turn: float) -> Float:
    """base_from_profiler (N, 4, 4): origin on the course, y along it, z along the view."""
    t, a, b = course.frame(at)
    pose = np.tile(np.eye(4), (at.size, 1, 1))
    pose[:, :3, 0] = np.sin(turn) * a - np.cos(turn) * b
    pose[:, :3, 1] = t
    pose[:, :3, 2] = np.cos(turn) * a + np.sin(turn) * b
    pose[:, :3, 3] = course.position(at)
    return pose


@njit(cache=True, nogil=True)
def _chosen(frame: Int, x: Float, z: Float, first: float, width: float, frames: int, columns: int) -> Int:
    """The point that stands for each cell (frames, columns), -1 for none: in front, and nearest to the cell's middle."""
    front = np.full((frames, columns), np.inf)
    for i in range(frame.size):
        if frame[i] >= 0:
            j = int((x[i] - first) / width)
            front[frame[i], j] = min(front[frame[i], j], z[i])
    chosen, nearest = np.full((frames, columns), -1, np.int64), np.full((frames, columns), np.inf)
    for i in range(frame.size):
        if frame[i] >= 0:
            j = int((x[i] - first) / width)
            off = abs(x[i] - first - (j + 0.5) * width)
            if off < nearest[frame[i], j] and z[i] <= front[frame[i], j] + FRONT_MM:
                chosen[frame[i], j], nearest[frame[i], j] = i, off
    return chosen
