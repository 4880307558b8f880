"""Processor seconds of alike calls on the sample recording; medians of five."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import open3d as o3d

from workbench.artefacts import PointSet
from workbench.cloud import denoise
from workbench.edge import segment
from workbench.scan import fuse, read

RECORDING = Path(__file__).parents[2] / "data" / "synthetic" / "milled_edge.h5"
REPEATS = 5


def seconds(call: Callable[[], Any]) -> float:
    """Processor time, of all threads."""
    call()
    taken = []
    for _ in range(REPEATS):
        begin = time.process_time()
        call()
        taken.append(time.process_time() - begin)
    return statistics.median(taken)


def main() -> None:
    cloud = fuse(read(recording=RECORDING))
    clean = denoise(cloud)
    legacy = cloud.to_open3d().to_legacy()
    points = PointSet(cloud.points_mm)
    rows = [
        ("statistical outliers removed", lambda: legacy.remove_statistical_outlier(20, 2.0), lambda: denoise(cloud)),
        (
            "faces found",
            lambda: legacy.segment_plane(0.05, 3, 1000),
            lambda: segment(clean),
        ),
        (
            "to Open3D",
            lambda: o3d.geometry.PointCloud(o3d.utility.Vector3dVector(np.ascontiguousarray(points.points_mm))),
            lambda: clean.to_open3d(),
        ),
    ]
    print(f"{len(points.points_mm)} points")
    for name, theirs, ours in rows:
        print(f"| {name} | {1e3 * seconds(theirs):.0f} | {1e3 * seconds(ours):.0f} |")


if __name__ == "__main__":
    main()
