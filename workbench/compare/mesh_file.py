"""A mesh out of a file: read by Open3D in a process of its own, then checked."""

from __future__ import annotations

import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

from workbench.compare import mesh_reader
from workbench.errors import InputError
from workbench.units import Float, Int

MESHES = (".stl", ".ply", ".obj")
MOST_BYTES = 2**31
MOST = 1e7  # size of a coordinate
SECONDS, BYTES_A_SECOND = 60, 1_000_000


def read_mesh(path: Path) -> tuple[Float, Int]:
    """Vertices (n, 3) in the file's unit and triangles (k, 3).

    Raises:
        InputError: unreadable, damaged, no triangles, not finite.
    """
    if path.suffix.lower() not in MESHES:
        raise InputError(str(path), f"expected a mesh as {', '.join(MESHES)}")
    try:
        size = path.stat().st_size
    except OSError as error:
        raise InputError(str(path), f"cannot be read: {error.strerror}") from None
    if not 0 < size <= MOST_BYTES:
        raise InputError(str(path), f"expected 1 to {MOST_BYTES} bytes, found {size}")
    points, triangles = _in_process(path, SECONDS + size / BYTES_A_SECOND)
    if not len(triangles) or not len(points):
        raise InputError(str(path), "expected a mesh with triangles, found none")
    if triangles.min() < 0 or triangles.max() >= len(points):
        raise InputError(str(path), "expected triangles between its own vertices")
    if not (np.abs(points) <= MOST).all():
        raise InputError(str(path), f"expected finite coordinates within {MOST:g}")
    if not _area(points, triangles) > 0:
        raise InputError(str(path), "expected triangles with an area, found none")
    return points, triangles


def _area(points: Float, triangles: Int) -> float:
    a, b, c = (points[triangles[:, k]] for k in range(3))
    return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum())


def _in_process(path: Path, seconds: float) -> tuple[Float, Int]:
    with tempfile.TemporaryDirectory(prefix="workbench-mesh-") as folder:
        out = Path(folder) / "mesh.npz"
        command = [sys.executable, "-P", mesh_reader.__file__, str(path.absolute()), str(out)]
        try:
            child = subprocess.run(
                command, stdin=subprocess.DEVNULL, capture_output=True, check=False, cwd=folder, timeout=seconds
            )
        except subprocess.TimeoutExpired:
            raise InputError(str(path), f"expected a whole mesh: not read within {seconds:.0f} s") from None
        if child.returncode or not out.exists():
            raise InputError(str(path), f"expected a complete {path.suffix[1:].upper()} file: its reader crashed")
        with np.load(out) as found:
            return np.asarray(found["points"], float), np.asarray(found["triangles"], np.int64)
