"""Open3D as its tutorials use it: statistical outlier removal, two planes by RANSAC, one angle for the whole edge.

The root from the planes' line to the furthest inliers of a section. u: the rms distance
of the inliers from their planes, as an offset at the root's end and as a turn over the root's width.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from bench.open.rivals.reader import corners, in_base, stretches

TITLE = "Open3D planes"
TRACKS = ("milled",)
NEIGHBOURS, STD_RATIO, DISTANCE_MM, TRIALS = 20, 2.0, 0.05, 1000
FURTHEST = 98.0  # %, of a section's inliers


def measure(recording: Path, declared: Mapping[str, Any]) -> dict[str, Any]:
    """Nine sections; the returns of both faces as the common reader finds them."""
    import open3d as o3d

    seen = corners(recording, declared)

    def plane(faces: list[Any]) -> tuple[Any, Any]:
        poses = np.repeat(seen.base_from_profiler, [len(face) for face in faces], axis=0)
        points = in_base(poses, np.concatenate(faces)) - origin
        cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points))
        cloud, _ = cloud.remove_statistical_outlier(NEIGHBOURS, STD_RATIO)
        found, inliers = cloud.segment_plane(DISTANCE_MM, 3, TRIALS)
        return np.asarray(found), np.asarray(cloud.points)[inliers]

    end = in_base(seen.base_from_profiler, seen.end[:, :2])
    origin = end.mean(axis=0)
    o3d.utility.random.seed(0)
    (root, face), (bevel, _) = plane(seen.root), plane(seen.bevel)
    angle = np.degrees(np.arccos(min(1.0, abs(float(root[:3] @ bevel[:3])))))
    direction = np.cross(root[:3], bevel[:3])
    direction /= np.linalg.norm(direction)
    point = np.linalg.lstsq(np.stack([root[:3], bevel[:3]]), -np.array([root[3], bevel[3]]), rcond=None)[0]
    u = float(np.sqrt(np.mean((face @ root[:3] + root[3]) ** 2)))
    sections = []
    for mine in stretches(end)[1]:
        middle = np.median(end[mine], axis=0) - origin if len(mine) else None
        off = face[np.abs((face - middle) @ direction) < 1.0] - point if middle is not None else []
        if middle is None or len(off) < 3:
            continue
        away = np.linalg.norm(off - np.outer(off @ direction, direction), axis=1)
        size = float(np.percentile(away, FURTHEST))
        values = {"root_mm": size, "root_u_mm": u, "bevel_deg": float(angle)}
        sections.append({"origin_mm": (middle + origin).tolist(), **values, "bevel_u_deg": float(np.degrees(u / size))})
    return {"sections": sections}
