"""Bevel angle and root face with Open3D: remove_statistical_outlier, then segment_plane (RANSAC) for each of the faces.

Planes are taken out one after the other until one stands at more than 15 deg to the first. One angle for the whole
edge, between the planes' normals; in each section the root from the planes' line of intersection to the furthest inlier
of the root face's plane. It is spared the cropping: it gets the returns of those columns that see one of the two faces,
and is told about which way the root face looks.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from workbench.units import DEG, Float, Int

NEIGHBOURS, STD_RATIO = 20, 2.0
DISTANCE_MM = 0.1  # the RANSAC threshold
TRIALS = 1000
MOST_PLANES = 6
LEAST_ANGLE = 15.0 * DEG  # between the two faces
SLAB_MM = 1.0  # half width of a section


def inspect(points_mm: Float, normal: Float, origins_mm: Float, tangents: Float, seed: int) -> tuple[Float, Float]:
    """Root face (mm) and bevel angle (deg) in m sections from points (n, 3) of root and bevel face; NaN if not found.

    normal (3,): about the root face's outward normal. origins_mm, tangents (m, 3): the section planes.
    """
    import open3d as o3d

    local = points_mm.mean(axis=0)
    cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points_mm - local))
    o3d.utility.random.seed(seed)
    cloud, _ = cloud.remove_statistical_outlier(NEIGHBOURS, STD_RATIO)
    found = _two_planes(cloud)
    if found is None:
        return np.full(len(origins_mm), np.nan), np.full(len(origins_mm), np.nan)
    (root, face), (bevel, _) = sorted(found, key=lambda plane: -abs(float(plane[0][:3] @ normal)))
    point, direction = _line(root, bevel)
    off = origins_mm - local
    sizes = [_width(face, point, direction, origin, t) for origin, t in zip(off, tangents, strict=True)]
    return np.array(sizes), np.full(len(sizes), _angle(root, bevel) / DEG)


def _two_planes(cloud: Any) -> list[tuple[Float, Float]] | None:
    """Two planes (4,) at an angle to each other, each with its inliers (k, 3)."""
    found: list[tuple[Float, Float]] = []
    for _ in range(MOST_PLANES):
        if len(cloud.points) < 3:
            return None
        plane, inliers = cloud.segment_plane(DISTANCE_MM, 3, TRIALS)
        if not found or _angle(found[0][0], plane) > LEAST_ANGLE:
            found.append((np.asarray(plane), np.asarray(cloud.points)[inliers]))
        if len(found) == 2:
            return found
        cloud = cloud.select_by_index(inliers, invert=True)
    return None


def _angle(a: Float, b: Float) -> float:
    """Between two planes (rad), at most a right angle."""
    return float(np.arccos(min(1.0, abs(float(np.dot(a[:3], b[:3]))))))


def _line(a: Float, b: Float) -> tuple[Float, Float]:
    """A point and the direction of the line in which planes a and b (4,) meet."""
    direction = np.cross(a[:3], b[:3])
    point = np.linalg.lstsq(np.stack([a[:3], b[:3]]), -np.array([a[3], b[3]]), rcond=None)[0]
    return point, direction / np.linalg.norm(direction)


def _width(face: Float, point: Float, direction: Float, origin: Float, tangent: Float) -> float:
    """From the line to the furthest point of the face in the slab around a section; NaN if there is none."""
    inside: Int = np.flatnonzero(np.abs((face - origin) @ tangent) <= SLAB_MM)
    if len(inside) == 0:
        return float("nan")
    off = face[inside] - point
    return float(np.linalg.norm(off - np.outer(off @ direction, direction), axis=1).max())
