"""The general route with numpy and Open3D, as one would write it without this project.

Every point into the base as float64, statistical outliers by nearest neighbours, the two largest planes by RANSAC. What
it finds are planes: no section, no root face and no uncertainty; measuring would come on top.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import h5py
import numpy as np

from workbench.artefacts import Recording
from workbench.scan.fuse import flange_poses

NEIGHBOURS, STD_RATIO = 20, 2.0
DISTANCE_MM, TRIALS = 0.1, 1000


def planes(recording: Recording) -> list[Any]:
    """The two largest planes (4,) of the whole cloud."""
    import open3d as o3d

    points = fused(recording)
    cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points - points.mean(axis=0)))
    cloud, _ = cloud.remove_statistical_outlier(nb_neighbors=NEIGHBOURS, std_ratio=STD_RATIO)
    found = []
    for _ in range(2):
        plane, inliers = cloud.segment_plane(DISTANCE_MM, ransac_n=3, num_iterations=TRIALS)
        cloud = cloud.select_by_index(inliers, invert=True)
        found.append(plane)
    return found


def fused(recording: Recording) -> Any:
    """(n, 3) float64 points in the base, without those that did not return. The poses are taken as given."""
    pose = flange_poses(recording) @ recording.flange_from_profiler
    x, z = recording.x_mm.astype(float), recording.z_mm.astype(float)
    points = x[..., None] * pose[:, None, :3, 0] + z[..., None] * pose[:, None, :3, 2] + pose[:, None, :3, 3]
    return points[np.isfinite(x) & np.isfinite(z)]


def plain_read(path: Path) -> tuple[Any, Any]:
    """x and z, and nothing else, with h5py."""
    with h5py.File(path) as file:
        return file["profiles/x"][()], file["profiles/z"][()]
