"""Collision shapes: what they are and where. Lengths in mm."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from workbench.errors import InputError
from workbench.storage import regular_file
from workbench.units import AnyArray, Float, Shaped

ON_BASE, ON_TURNTABLE = -1, 7  # values of `Shape.link` for what is no part of the robot


@dataclass(frozen=True, slots=True, eq=False)
class Shape:
    """A rigid shape on a body of the cell.

    `pose` is where it is with all joints at zero: in the base, or for ON_TURNTABLE in the turntable's own frame.
    """

    body: str  # name of what it belongs to; shapes of one body may touch
    link: int  # 0 to 6: hangs on that link of the robot, whose base is 0; else ON_BASE or ON_TURNTABLE
    kind: str  # box (x, y, z), sphere (radius), capsule and cylinder (radius, length along z without caps), mesh
    size_mm: tuple[float, ...]
    pose: Shaped[Float, "4 4"]
    vertices_mm: Shaped[Float, "v 3"] | None = None  # of a mesh, in the shape's frame
    triangles: Shaped[AnyArray, "t 3"] | None = None

    @property
    def sphere(self) -> tuple[Float, float]:
        """Middle (3,), where `pose` is, and radius of a sphere around it, mm."""
        if self.vertices_mm is not None:
            low, high = self.vertices_mm.min(axis=0), self.vertices_mm.max(axis=0)
            return self.pose[:3, :3] @ (low + high) / 2 + self.pose[:3, 3], float(np.linalg.norm(high - low) / 2)
        size = np.array(self.size_mm)
        if self.kind == "box":
            radius = np.linalg.norm(size) / 2
        elif self.kind == "cylinder":
            radius = np.hypot(size[0], size[1] / 2)
        else:
            radius = size[0] + size[1:].sum() / 2
        return self.pose[:3, 3], float(radius)


def named_file(path: Path, where: str, what: str) -> None:
    """Refuse a file that the cell names at `where` and that is not there, or is none."""
    try:
        regular_file(path)
    except InputError as error:
        raise InputError(where, f"the {what} '{path}': {error.expected}") from None


def read_mesh(path: Path, where: str) -> tuple[Float, AnyArray]:
    """Vertices (v, 3), in the file's own unit, and triangles (t, 3) of an STL, OBJ or PLY file.

    Raises:
        InputError: no such file, or no triangles in it.
    """
    import open3d

    named_file(path, where, "mesh")
    with open3d.utility.VerbosityContextManager(open3d.utility.VerbosityLevel.Error):
        mesh = open3d.io.read_triangle_mesh(path)
    if not len(mesh.triangles):
        raise InputError(where, f"the mesh '{path}' holds no triangles: expected an STL, OBJ or PLY file")
    return np.array(mesh.vertices), np.array(mesh.triangles)
