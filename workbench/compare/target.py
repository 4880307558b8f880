"""The nearest place of a reference: on a mesh, or on local planes of a scan."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import scipy

from workbench.compare.surface_values import Surface
from workbench.compare.surfels import surfels
from workbench.units import Float

Target = Callable[[Float], tuple[Float, Float]]  # points (n, 3) -> feet (n, 3) and outward normals (n, 3); NaN: none


def target_of(reference: Surface, spacing_mm: float, radius_mm: float) -> Target:
    """Nearest places of a surface."""
    return on_mesh(reference) if reference.triangles is not None else on_scan(reference, spacing_mm, radius_mm)


def on_scan(reference: Surface, spacing_mm: float, radius_mm: float) -> Target:
    """Feet on the plane through the nearest flat neighbourhood of a scan."""
    local = surfels(reference, spacing_mm, radius_mm)
    centre, normal = local.centre_mm[local.flat], local.normal[local.flat]
    tree = scipy.spatial.cKDTree(centre) if len(centre) else None

    def nearest(points: Float) -> tuple[Float, Float]:
        if tree is None:
            return np.full_like(points, np.nan), np.full_like(points, np.nan)
        index = tree.query(points)[1]
        height = ((points - centre[index]) * normal[index]).sum(axis=1, keepdims=True)
        foot = points - height * normal[index]
        beside = np.linalg.norm(foot - centre[index], axis=1) > 2.0 * radius_mm
        foot[beside] = np.nan
        return foot, normal[index]

    return nearest


def on_mesh(reference: Surface) -> Target:
    """Feet on the triangles of a mesh (Open3D's closest points, about a local origin since it works in float32)."""
    import open3d

    o3d: Any = open3d  # its stubs know less than it does
    assert reference.triangles is not None
    origin = reference.points_mm.mean(axis=0)
    corners = reference.points_mm[reference.triangles]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    normals = np.divide(normals, length, out=np.full_like(normals, np.nan), where=length > 0)
    scene = o3d.t.geometry.RaycastingScene()
    scene.add_triangles(
        o3d.core.Tensor((reference.points_mm - origin).astype(np.float32)),
        o3d.core.Tensor(reference.triangles.astype(np.uint32)),
    )

    def nearest(points: Float) -> tuple[Float, Float]:
        found = scene.compute_closest_points(o3d.core.Tensor((points - origin).astype(np.float32)))
        index = found["primitive_ids"].numpy().astype(np.int64)
        normal, corner = normals[index], corners[index, 0]
        near = found["points"].numpy().astype(float) + origin
        height = ((points - corner) * normal).sum(axis=1, keepdims=True)
        foot = points - height * normal  # in float64, on the triangle's plane
        beside = np.linalg.norm(foot - near, axis=1) > 1e-3 + 1e-6 * np.abs(near - origin).max(initial=0.0)
        foot[beside] = np.nan  # the nearest place is a border of the mesh
        return foot, normal

    return nearest
