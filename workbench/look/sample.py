"""Which points are shown, and by what they are coloured."""

from __future__ import annotations

import numpy as np

from workbench.look.seen import Shade
from workbench.units import AnyArray, Float, Float32, Int

MOST_POINTS = 300_000
SEED = 0  # the order of the points shown: any first part of them shows the whole


def chosen_of(points_mm: Float) -> Float:
    """At most MOST_POINTS of the points (n, 3), in no order."""
    order = np.random.default_rng(SEED).permutation(len(points_mm))[:MOST_POINTS]
    return np.asarray(points_mm[order])


def places(x_mm: Float32, z_mm: Float32) -> tuple[Int, Int]:
    """Frames and columns of at most MOST_POINTS returns of a grid (N, M), in no order.

    Large grids are drawn from by place, so that no array as large as the grid is made.
    """
    rng = np.random.default_rng(SEED)
    frames, columns = z_mm.shape
    if frames * columns <= 4 * MOST_POINTS:
        frame, column = np.nonzero(np.isfinite(x_mm) & np.isfinite(z_mm))
        order = rng.permutation(len(frame))[:MOST_POINTS]
        return frame[order], column[order]
    frame, column = rng.integers(0, frames, 3 * MOST_POINTS), rng.integers(0, columns, 3 * MOST_POINTS)
    back = np.isfinite(x_mm[frame, column]) & np.isfinite(z_mm[frame, column])
    return frame[back][:MOST_POINTS], column[back][:MOST_POINTS]


def shades_of(points_mm: Float, **more: AnyArray) -> tuple[Shade, ...]:
    """Height in the frame shown, and whatever else differs from point to point."""
    values = {"height z, mm": points_mm[:, 2], **{name.replace("_", " "): one for name, one in more.items()}}
    return tuple(Shade(name, np.asarray(one, float)) for name, one in values.items() if not len(one) or np.ptp(one) > 0)
