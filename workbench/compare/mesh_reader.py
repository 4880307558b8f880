"""Vertices and triangles of a mesh: run as a process of its own by `compare.mesh`, since damaged files crash Open3D.

`python -P mesh_reader.py FILE OUT.npz`
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

from workbench.children import library

MEMORY, MEMORY_A_BYTE = 8 * 2**30, 64


def main() -> int:
    """Read FILE, write its vertices (n, 3) and triangles (k, 3) to OUT.npz."""
    file, out = sys.argv[1:]
    _confine(Path(file).stat().st_size)
    o3d = library("open3d")

    read = o3d.io.read_triangle_mesh(Path(file))
    np.savez(out, points=np.asarray(read.vertices, float), triangles=np.asarray(read.triangles, np.int64))
    return 0


def _confine(size: int) -> None:
    """No core file, and no more memory than a mesh of so many bytes can ask for."""
    try:
        import resource
    except ImportError:  # not on this system
        return
    for what, most in ((resource.RLIMIT_CORE, 0), (resource.RLIMIT_AS, MEMORY + MEMORY_A_BYTE * size)):
        _, hard = resource.getrlimit(what)
        resource.setrlimit(what, (most if hard == resource.RLIM_INFINITY else min(most, hard), hard))


if __name__ == "__main__":
    sys.exit(main())
