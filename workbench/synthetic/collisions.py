"""Whether the cutter runs into a clamp or the table: what a real cell would not forgive."""

from __future__ import annotations

import numpy as np

from workbench.units import Float

_GRID_MM = 1.0  # clamps are looked at so finely; a cutter of radius R overlaps by 1 mm^2 / (8 R) more at most


def clamp_overlap(box: Float, centre: Float, axis: Float, radius_mm: Float, tip_mm: float) -> Float:
    """How deep (k,) the surface of a clamp, `box` (10,) as for `raycast.enter_box`, lies inside the cutter; 0: not.

    The cutter's axis runs through `centre` (k, 3) along `axis` (k, 3), as far as `tip_mm` beyond it.
    """
    points = _surface_points(box)
    middle, extent = points.mean(axis=0), float(np.ptp(points, axis=0).max())
    overlap = np.zeros(len(centre))
    to_middle = middle - centre
    aside = to_middle - np.sum(to_middle * axis, axis=1)[:, None] * axis
    near = np.flatnonzero(np.linalg.norm(aside, axis=1) < extent + radius_mm)
    for k in near:
        offset = points - centre[k]
        along = offset @ axis[k]
        distance = np.sqrt(np.maximum(np.sum(offset**2, axis=1) - along**2, 0.0))
        overlap[k] = np.max(np.where(along < tip_mm, radius_mm[k] - distance, 0.0), initial=0.0)
    return overlap


def table_overlap(table_z_mm: float, centre: Float, axis: Float, radius_mm: Float, tip_mm: float) -> Float:
    """How deep (k,) the cutter's tip is in a table at height `table_z_mm`; 0: not."""
    tip_z = centre[:, 2] + tip_mm * axis[:, 2]
    lowest = tip_z - radius_mm * np.sqrt(np.maximum(1.0 - axis[:, 2] ** 2, 0.0))
    return np.asarray(np.maximum(table_z_mm - lowest, 0.0))


def _surface_points(box: Float) -> Float:
    """Points (p, 3) on a grid over a box's faces, its edges and corners among them."""
    low, high = box[4::2], box[5::2]
    ticks = [np.linspace(a, b, max(2, int(np.ceil((b - a) / _GRID_MM)) + 1)) for a, b in zip(low, high, strict=True)]
    grid = np.stack(np.meshgrid(*ticks, indexing="ij"), axis=-1).reshape(-1, 3)
    on_face = np.any((grid == low) | (grid == high), axis=1)
    along, outward, up = grid[on_face].T
    tangent = np.array([box[2], box[3], 0.0])
    aside = np.array([box[3], -box[2], 0.0])
    return np.asarray(
        np.array([box[0], box[1], 0.0])
        + along[:, None] * tangent
        + outward[:, None] * aside
        + up[:, None] * np.array([0.0, 0.0, 1.0])
    )
