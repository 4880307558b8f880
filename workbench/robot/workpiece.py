"""The workpiece as a body to run into: a mesh, or a scanned cloud by boxes that hold its points. mm."""

from __future__ import annotations

import itertools
from pathlib import Path

import numpy as np

from workbench.errors import InputError
from workbench.robot.shapes import Shape, named_file
from workbench.units import AnyArray, Float

Cell = tuple[int, ...]  # of the grid
CLOUDS = (".pcd", ".xyz", ".pts")  # hold points only; a PLY file may hold either
MOST_CUBES, MOST_BOXES = 20_000, 250
LEAST_MM = 5.0  # a smaller body is one in metres


def read_workpiece(path: Path, where: str) -> tuple[Float, AnyArray]:
    """Vertices (v, 3) and triangles (t, 3) of a mesh (STL, OBJ, PLY), or points and none of a cloud.

    Raises:
        InputError: no such file, nothing in it, or so small that it must be in metres.
    """
    import open3d

    named_file(path, where, "mesh or cloud")
    with open3d.utility.VerbosityContextManager(open3d.utility.VerbosityLevel.Error):
        if path.suffix.lower() in CLOUDS:
            points, triangles = np.array(open3d.io.read_point_cloud(path).points), np.empty((0, 3), np.int64)
        else:
            mesh = open3d.io.read_triangle_mesh(path)
            points, triangles = np.array(mesh.vertices), np.array(mesh.triangles)
    if not len(points) or not np.isfinite(points).all():
        raise InputError(where, f"expected a mesh or a cloud of finite points, '{path}' holds none")
    check_size(points, path, where)
    return points, triangles


def check_size(points: Float, path: Path, where: str) -> None:
    """Refuse a body whose file (v, 3) is so small that it must be in metres."""
    size = float(np.ptp(points, axis=0).max())
    if size < LEAST_MM:
        raise InputError(where, f"expected millimetres, '{path}' is {size:.3g} large: is it in metres?")


def boxes(points_mm: Float, edge_mm: float, where: str) -> tuple[Float, Float]:
    """Middles (b, 3) and edge lengths (b, 3) of boxes that hold all points (n, 3): cubes of a grid, joined greedily.

    No point is outside; what the scan has not seen is not there. The grid is made coarser until MOST_BOXES suffice.
    """
    index = np.floor(points_mm / edge_mm)
    if np.abs(index).max() > 2**20:
        raise InputError(where, f"expected a voxel_mm above {edge_mm:g} for a cloud so far from its origin")
    held = np.unique(index.astype(np.int64), axis=0)
    found = _joined(held) if len(held) <= MOST_CUBES else []
    if not 0 < len(found) <= MOST_BOXES:
        return boxes(points_mm, 1.5 * edge_mm, where)
    low, high = (np.array(corner, float) * edge_mm for corner in zip(*found, strict=True))
    return (low + high) / 2, high - low


def scanned(points_mm: Float, voxel_mm: float, link: int, pose: Float, where: str) -> list[Shape]:
    """A scan's points (n, 3) as shapes of the body `workpiece`; `pose` of their frame, `link` as in `Shape`."""
    found = []
    for middle, size in zip(*boxes(points_mm, voxel_mm, where), strict=True):
        at = pose.copy()
        at[:3, 3] += pose[:3, :3] @ middle
        found.append(Shape("workpiece", link, "box", tuple(size.tolist()), at))
    return found


def _joined(held: AnyArray) -> list[tuple[Cell, Cell]]:
    """Lowest and highest corners of boxes: runs along x, as many alike in y, then in z."""
    open_ = set(map(tuple, held.tolist()))
    found: list[tuple[Cell, Cell]] = []
    for x, y, z in sorted(open_):
        if (x, y, z) not in open_:
            continue
        high = [x + 1, y + 1, z + 1]
        for axis in range(3):
            while _slab(x, y, z, high, axis) <= open_:
                high[axis] += 1
        open_ -= set(itertools.product(range(x, high[0]), range(y, high[1]), range(z, high[2])))
        found.append(((x, y, z), (high[0], high[1], high[2])))
    return found


def _slab(x: int, y: int, z: int, high: list[int], axis: int) -> set[Cell]:
    """The cubes that a box would gain at its high end along an axis."""
    spans = [range(x, high[0]), range(y, high[1]), range(z, high[2])]
    spans[axis] = range(high[axis], high[axis] + 1)
    return set(itertools.product(*spans))
