"""Organised clouds of profilers: PCD with HEIGHT rows of WIDTH points. The grid is kept: a row is a profile.

x and z are the profiler's, y the way along the scan, the same in all points of a row: so profilers' drivers write them.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from workbench.cloud.read import MM, in_process
from workbench.errors import InputError
from workbench.importing.grid import bounded
from workbench.importing.mapping import Mapping
from workbench.importing.neutral import Imported, ProfileFrames
from workbench.importing.text import head_text
from workbench.units import Float

NAME = "organised cloud of a profiler (PCD)"
METRES_MM = 3.0  # a surface that is smaller in mm is one in m
ALIKE = 1e-3  # mm by which y may vary along a row


def recognises(path: Path, head: bytes, mapping: Mapping) -> bool:
    """Whether it is a PCD file of several rows."""
    return path.suffix.lower() == ".pcd" and grid_of(head)[0] > 1


def grid_of(head: bytes) -> tuple[int, int]:
    """(HEIGHT, WIDTH) of a PCD file's first bytes; (0, 0) where they are not told."""
    told = dict.fromkeys(("HEIGHT", "WIDTH"), 0)
    for line in head_text(head[:4096]).split("\n"):
        words = line.split()
        if len(words) == 2 and words[0] in told and words[1].isascii() and words[1].isdigit() and len(words[1]) < 9:
            told[words[0]] = int(words[1])
        if words[:1] == ["DATA"]:
            break
    return told["HEIGHT"], told["WIDTH"]


def read(path: Path, mapping: Mapping) -> Imported:
    """The profiles, one a row.

    Raises:
        InputError: damaged; another number of points than its grid; rows that no profiler takes.
    """
    with open(path, "rb") as file:
        rows, columns = grid_of(file.read(4096))
    points = in_process(path)  # NaN points stay in their places
    if len(points) != rows * columns:
        raise InputError(str(path), f"expected {rows} x {columns} points, found {len(points)}")
    seen = np.isfinite(points).all(axis=1)
    if not seen.any():
        raise InputError(str(path), "expected points, found none")
    unit = "m" if np.ptp(points[seen], axis=0).max() < METRES_MM else "mm"
    grid = points.reshape(rows, columns, 3) * MM[unit]
    y = _row_values(grid[..., 1], str(path))
    note = f"{NAME}: {rows} rows of {columns}, coordinates in {unit}; a row is a profile, y the way along the scan"
    frames = ProfileFrames(str(path), bounded(grid[..., 0]), bounded(grid[..., 2]), travel_mm=y, length_unit=unit)
    return Imported(profiles=frames, notes=(note,))


def _row_values(y_mm: Float, where: str) -> Float:
    """y of each row; rows without a return by their neighbours."""
    seen = np.isfinite(y_mm)
    low = np.min(y_mm, axis=1, initial=np.inf, where=seen)
    high = np.max(y_mm, axis=1, initial=-np.inf, where=seen)
    some = seen.any(axis=1)
    if (high[some] - low[some] > ALIKE).any():
        raise InputError(where, "y changes along its rows: no profiler's grid; as a cloud it is read by cloud.read")
    at = np.arange(len(y_mm))
    return np.asarray(np.interp(at, at[some], (low[some] + high[some]) / 2))
