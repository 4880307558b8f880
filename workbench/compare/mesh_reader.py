"""Vertices and triangles of a mesh: run as a process of its own by `compare.mesh`, since damaged files crash Open3D.

`python -P mesh_reader.py FILE OUT.npz`
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

from workbench.children import confine, library


def main() -> int:
    """Read FILE, write its vertices (n, 3) and triangles (k, 3) to OUT.npz."""
    file, out = sys.argv[1:]
    confine(Path(file).stat().st_size)
    o3d = library("open3d")

    read = o3d.io.read_triangle_mesh(Path(file))
    np.savez(out, points=np.asarray(read.vertices, float), triangles=np.asarray(read.triangles, np.int64))
    return 0


if __name__ == "__main__":
    sys.exit(main())
