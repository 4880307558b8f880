"""Whether all frames of a recording are of one sensor: a column's lateral place is one function of its range."""

from __future__ import annotations

import numpy as np

from workbench.checks.motion import SINGLE
from workbench.checks.sensor import some
from workbench.geometry.medians import row_medians
from workbench.units import AnyArray

FRAMES, COLUMNS, APART = 1000, 64, 8  # that are looked at, evenly; of these, columns between which x is compared
LAG = 8  # part of the frames, over which ranges change by more than noise of them and rounding of x


def lateral_step(x_mm: AnyArray, z_mm: AnyArray) -> tuple[float, int]:
    """The greatest change of the scale of x from frame to frame of a grid (N, M), if it is a single one, and its frame.

    Column j of a triangulating profiler measures along a ray: x = a_j + b_j z, b = 0 where it is rectified. b is the
    median over pairs of frames that lie apart, which no run of others moves. -2: x changes its sign; 0: all are alike.
    A window that follows the part shifts x by more than it scales it; where one frame in ten changes its scale, as of
    resampled places, none is another.
    """
    x, z = (some(some(grid, FRAMES).T, COLUMNS).astype(np.float64) for grid in (x_mm, z_mm))
    x[np.isnan(z)] = np.nan
    wide, by, up = x[APART:] - x[:-APART], np.diff(x), np.diff(z)
    with np.errstate(divide="ignore", invalid="ignore"):
        far = max(x.shape[1] // LAG, 1)
        rise, aside = z[:, far:] - z[:, :-far], x[:, far:] - x[:, :-far]
        by -= row_medians(np.where(rise != 0.0, aside / rise, np.nan))[:, None] * up  # what moves along the ray aside
        share = row_medians(((by[APART:] - by[:-APART]) / wide[:, :-1]).T)
    left, was = (row_medians(np.abs(of).T) for of in (by - share * x[:, :-1], by))
    flips = np.abs(np.diff(row_medians(np.sign(wide).T))) > 1.0  # also where no column returns in both
    change = np.append(0.0, np.where(flips, -2.0, np.where(left < 0.5 * was, share, 0.0)))
    size = np.abs(change)
    k = int(size.argmax())
    return float(change[k] * (size[k] > SINGLE * np.quantile(size, 0.9))), int(some(np.arange(len(x_mm)), FRAMES)[k])
