"""The planned bevel face as a strip of triangles."""

from __future__ import annotations

import numpy as np

from workbench.units import Bool, Float, Int


def finished_bevel(position_mm: Float, axes: Float, width_mm: Float, cutting: Bool) -> tuple[Float, Int]:
    """Vertices (2 k, 3) and triangles of the face between the two edges of the last layer's bevel face.

    `position_mm` (k, 3) lies at mid-width; `axes` (k, 3, 3) are x (into the material), y (feed), z (from shank to tip,
    in the face) as columns; `width_mm` (k,). Triangles run counter-clockwise from outside, where both ends cut.
    """
    half = 0.5 * width_mm[:, None] * axes[:, :, 2]
    points = np.stack([position_mm - half, position_mm + half], axis=1).reshape(-1, 3)
    first = np.flatnonzero(cutting[:-1] & cutting[1:] & (width_mm[:-1] > 0) & (width_mm[1:] > 0))
    a, b, c, d = 2 * first, 2 * first + 1, 2 * first + 2, 2 * first + 3
    triangles = np.concatenate([np.column_stack([a, b, c]), np.column_stack([b, d, c])]).astype(np.int64)
    used, renumbered = np.unique(triangles, return_inverse=True)
    return points[used], renumbered.reshape(-1, 3).astype(np.int64)
