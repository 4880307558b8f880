"""A cloud as an organised one: by the grid of its file, or its scan lines, where the order of its points shows them."""

from __future__ import annotations

import numpy as np

from workbench.artefacts import Cloud, PointSet
from workbench.geometry.blocks import evenly
from workbench.geometry.chains import noise_sigma
from workbench.geometry.outliers import reject_outliers
from workbench.geometry.scan_grid import lines_of_rows, scan_grid, scan_lines
from workbench.units import Float, Float32, Int

SAMPLE_FRAMES, LEAST_POINTS = 60, 12  # what the noise is judged from; of a frame
STRAIGHTER = 5.0  # than columns: rows of points that are no profiles
NOISE_SIGMAS, LEAST_TOLERANCE_MM, JUMP_MM, WINDOW_FRAMES = 9.0, 0.06, 1.0, 5  # as `cloud.denoise` has them


def recovered_grid(points: PointSet) -> Cloud | None:
    """The scanner's own grid, as the file has it; else by the order of the points, and None where that shows none."""
    mm, row, column = points.points_mm, points.row, points.column
    lines = None
    if row is not None and column is not None:
        if _bend(mm, row) < _bend(mm, column) / STRAIGHTER:  # a file with its rows along the edge
            order = np.argsort(column, kind="stable")
            mm, row, column = mm[order], column[order], row[order]
        lines = lines_of_rows(mm, row)
    if lines is None:
        mm, column = points.points_mm, None
        lines = scan_lines(mm)
    if lines is None:
        return None
    grid = scan_grid(mm, lines, column)
    if grid is None:
        return None
    return organised(points, grid.x_mm, grid.z_mm, grid.base_from_profiler, lines.pass_index)


def _bend(points_mm: Float, line: Int) -> float:
    """How far lines of points are from straight: the second of a line's principal spreads over the first, the median.

    line (n,): the number of each point's, of which some are looked at.
    """
    on = np.flatnonzero(np.isin(line, evenly(int(line.max()) + 1, SAMPLE_FRAMES)))
    on = on[np.argsort(line[on], kind="stable")]
    rows = np.split(points_mm[on], np.flatnonzero(np.diff(line[on])) + 1)
    spreads = [np.linalg.svd(one - one.mean(axis=0), compute_uv=False) for one in rows if len(one) > LEAST_POINTS]
    return float(np.median([one[1] / one[0] for one in spreads])) if spreads else 0.0


def organised(points: PointSet, x_mm: Float32, z_mm: Float32, base_from_profiler: Float, pass_index: Int) -> Cloud:
    """Profiles (N, M) as an organised cloud, the stray returns rejected."""
    keep, frames = np.isfinite(x_mm), len(x_mm)
    sample = evenly(frames, SAMPLE_FRAMES)
    noise = [noise_sigma(z_mm[i][keep[i]].astype(np.float64)) for i in sample if keep[i].sum() > LEAST_POINTS]
    tolerance = max(LEAST_TOLERANCE_MM, NOISE_SIGMAS * float(np.median(noise)) if noise else 0.0)
    keep, isolated, streaks = reject_outliers(z_mm, keep, pass_index, tolerance, WINDOW_FRAMES, JUMP_MM)
    return Cloud(
        x_mm,
        z_mm,
        keep,
        base_from_profiler,
        np.arange(frames, dtype=np.float64),
        pass_index,
        source=points.source,
        part=points.part,
        rejected={"isolated returns": isolated, "short streaks": streaks},
    )
