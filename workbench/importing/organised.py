"""Clouds of profilers: PCD with HEIGHT rows of WIDTH points, PCD and PLY whose points stand profile after profile.

x and z are the profiler's, y the way along the scan, the same in all points of a row: so profilers' drivers write them.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from workbench.cloud.read import MM, Unit, grid_of, in_process
from workbench.errors import InputError
from workbench.importing.mapping import Mapping
from workbench.importing.neutral import Imported, ProfileFrames, bounded, gridded
from workbench.units import Float, Float32

NAME = "cloud of a profiler (PCD, PLY)"
METRES_MM = 3.0  # a surface that is smaller in mm is one in m
ALIKE = 1e-3  # mm by which y may vary along a row
FEWEST_A_ROW = 10  # points, in the mean
AS_A_CLOUD = (
    "It is a cloud, and nothing of it goes into a recording: workbench run pipelines/inspect_cloud.json "
    "--input cloud=FILE, with --input unit=m where it is in metres (docs/clouds.md)"
)


def recognises(path: Path, head: bytes, mapping: Mapping) -> bool:
    """Whether it is a PCD or PLY file: only its points tell whether a profiler made it."""
    return path.suffix.lower() in (".pcd", ".ply")


def read(path: Path, mapping: Mapping) -> Imported:
    """The profiles, one a row.

    Raises:
        InputError: damaged; another number of points than its grid; rows that no profiler takes.
    """
    rows, columns = grid_of(path)
    points = in_process(path)  # NaN points stay in their places
    if rows > 1 and len(points) != rows * columns:
        raise InputError(str(path), f"expected {rows} x {columns} points, found {len(points)}")
    seen = np.isfinite(points).all(axis=1)
    if not seen.any():
        raise InputError(str(path), "expected points, found none")
    unit: Unit = "m" if np.ptp(points[seen], axis=0).max() < METRES_MM else "mm"
    points = points * MM[unit]
    if rows > 1:
        grid = points.reshape(rows, columns, 3)
        x_mm, z_mm, y_mm, more = bounded(grid[..., 0]), bounded(grid[..., 2]), _row_values(grid[..., 1], path), ""
    else:
        x_mm, z_mm, y_mm, more = _by_runs(points[seen], path)
    told = f"{len(x_mm)} rows of {x_mm.shape[1]}, coordinates in {unit}; a row is a profile, y the way along the scan"
    notes = (f"{NAME}: {told}", *filter(None, [more]))
    return Imported(profiles=ProfileFrames(str(path), x_mm, z_mm, travel_mm=y_mm, length_unit=unit), notes=notes)


def _by_runs(points_mm: Float, path: Path) -> tuple[Float32, Float32, Float, str]:
    """x, z (N, M), y (N,) and a note: a profile ends where y changes; within it x goes one way."""
    first = np.append(True, np.abs(np.diff(points_mm[:, 1])) > ALIKE)
    starts = np.flatnonzero(first)
    step = np.diff(points_mm[:, 0])[~first[1:]]
    if len(starts) < 2 or len(points_mm) < FEWEST_A_ROW * len(starts) or not ((step > 0).all() or (step < 0).all()):
        raise _no_grid(path)
    grid = gridded(points_mm[:, 0], points_mm[:, 2], first, str(path))
    return grid.x_mm, grid.z_mm, points_mm[starts, 1], grid.note


def _no_grid(path: Path) -> InputError:
    return InputError(str(path), f"y changes along its rows: no profiler's grid. {AS_A_CLOUD}")


def _row_values(y_mm: Float, path: Path) -> Float:
    """y of each row; rows without a return by their neighbours."""
    seen = np.isfinite(y_mm)
    low = np.min(y_mm, axis=1, initial=np.inf, where=seen)
    high = np.max(y_mm, axis=1, initial=-np.inf, where=seen)
    some = seen.any(axis=1)
    if (high[some] - low[some] > ALIKE).any():
        raise _no_grid(path)
    at = np.arange(len(y_mm))
    return np.asarray(np.interp(at, at[some], (low[some] + high[some]) / 2))
