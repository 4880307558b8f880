"""The workpiece as a body to run into: a mesh, or a scanned cloud by the cubes that hold its points. mm."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from workbench.errors import InputError
from workbench.robot.shapes import named_file
from workbench.units import AnyArray, Float

CLOUDS = (".pcd", ".xyz", ".pts")  # hold points only; a PLY file may hold either
MOST_CUBES = 200_000
LEAST_MM = 5.0  # a smaller workpiece is one in metres


def read_workpiece(path: Path, where: str, voxel_mm: float) -> tuple[Float, AnyArray]:
    """Vertices (v, 3) and triangles (t, 3) of a mesh (STL, OBJ, PLY), or of a cloud's cubes (PLY, PCD, XYZ, PTS).

    Raises:
        InputError: no such file, nothing in it, too many cubes, or so small that it must be in metres.
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
    size = float(np.ptp(points, axis=0).max())
    if size < LEAST_MM:
        raise InputError(where, f"expected millimetres, '{path}' is {size:.3g} large: is it in metres?")
    return (points, triangles) if len(triangles) else cubes(points, voxel_mm, where)


def cubes(points_mm: Float, edge_mm: float, where: str) -> tuple[Float, AnyArray]:
    """Vertices and triangles of all cubes of a grid that hold points (n, 3), walls between them included.

    No point is outside; what the scan has not seen is not there.
    """
    index = np.floor(points_mm / edge_mm)
    if np.abs(index).max() > 2**20:
        raise InputError(where, f"expected a voxel_mm above {edge_mm:g} for a cloud so far from its origin")
    held = np.unique(index.astype(np.int64), axis=0)
    if len(held) > MOST_CUBES:
        raise InputError(where, f"expected at most {MOST_CUBES} cubes of {edge_mm:g} mm (voxel_mm), found {len(held)}")
    walls = []
    for axis in range(3):
        u, v = np.eye(3, dtype=np.int64)[[(axis + 1) % 3, (axis + 2) % 3]]
        corner = np.unique(np.vstack([held, held + np.eye(3, dtype=np.int64)[axis]]), axis=0)
        walls.append(np.stack([corner, corner + u, corner + u + v, corner + v], axis=1))
    corners, which = np.unique(np.concatenate(walls).reshape(-1, 3), axis=0, return_inverse=True)
    quads = which.reshape(-1, 4)
    return corners * edge_mm, np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
