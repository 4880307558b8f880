"""Local planes through the points of a scan, and the nearest place of a reference: on these, or on a mesh."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy

from workbench.compare.surface_values import Surface
from workbench.units import Bool, Float, Int, Shaped

LEAST_POINTS = 8
FLAT = 0.02  # smallest over middle eigenvalue of a flat neighbourhood: beyond, there is a corner in it
BATCH = 20_000


@dataclass(frozen=True, slots=True, eq=False)
class Surfels:
    """c local planes."""

    centre_mm: Shaped[Float, "c 3"]  # mean of the neighbourhood
    normal: Shaped[Float, "c 3"]  # unit, outwards
    flat: Shaped[Bool, " c"]  # enough points, and no corner among them
    frame: Shaped[Int, " c"] | None = None  # in whose middle it lies; None: not known


def thinned(points_mm: Float, spacing_mm: float) -> Int:
    """Indices of the points nearest to the mean of every cube of `spacing_mm` that holds points (n, 3)."""
    cell = np.floor((points_mm - points_mm.min(axis=0)) / spacing_mm).astype(np.int64)
    _, index = np.unique(cell, axis=0, return_inverse=True)
    count = np.bincount(index)
    middle = np.stack([np.bincount(index, points_mm[:, k]) / count for k in range(3)], axis=1)
    distance = ((points_mm - middle[index]) ** 2).sum(axis=1)
    order = np.lexsort((distance, index))
    return np.asarray(order[np.r_[0, np.cumsum(count)[:-1]]])


def surfels(surface: Surface, spacing_mm: float, radius_mm: float) -> Surfels:
    """Principal axes of the points within `radius_mm` of places about `spacing_mm` apart."""
    chosen = thinned(surface.points_mm, spacing_mm)
    at_mm = surface.points_mm[chosen]
    tree = scipy.spatial.cKDTree(surface.points_mm)
    parts = [_planes(surface.points_mm, tree, at_mm[k : k + BATCH], radius_mm) for k in range(0, len(at_mm), BATCH)]
    centre, normal, flat = (np.concatenate(columns) for columns in zip(*parts, strict=True))
    return Surfels(
        centre,
        outwards(normal, centre, flat, surface.range_axis),
        flat,
        None if surface.frame is None else surface.frame[chosen],
    )


def neighbours(tree: scipy.spatial.cKDTree, at_mm: Float, radius_mm: float) -> tuple[Int, Int]:
    """Indices of the points near each place, one list after the other, and where each list begins (c + 1,)."""
    lists = tree.query_ball_point(at_mm, radius_mm)
    start = np.concatenate([[0], np.cumsum([len(one) for one in lists])])
    return np.fromiter((i for one in lists for i in one), np.int64, start[-1]), start


def _planes(points: Float, tree: scipy.spatial.cKDTree, at: Float, radius: float) -> tuple[Float, Float, Bool]:
    index, start = neighbours(tree, at, radius)
    count = np.diff(start)
    owner = np.repeat(np.arange(len(at)), count)
    off = points[index] - at[owner]
    safe = np.maximum(count, 1)[:, None]
    mean = np.stack([np.bincount(owner, off[:, k], len(at)) for k in range(3)], axis=1) / safe
    off = off - mean[owner]
    moment = np.empty((len(at), 3, 3))
    for i in range(3):
        for j in range(3):
            moment[:, i, j] = np.bincount(owner, off[:, i] * off[:, j], len(at)) / safe[:, 0]
    size, axes = np.linalg.eigh(moment)
    flat = (count >= LEAST_POINTS) & (size[:, 0] <= FLAT * size[:, 1])
    return at + mean, axes[:, :, 0], flat


def outwards(normal: Float, centre: Float, flat: Bool, range_axis: Float | None) -> Float:
    """Normals (c, 3) turned to the side from which a convex edge is seen.

    Away from the middle of a convex body is outside. Summed over all places this gives the direction of view, or which
    sense of the profiler's range axis it is, and each normal is turned towards that.
    """
    use = flat if flat.any() else np.ones(len(normal), bool)
    away = ((centre - centre[use].mean(axis=0)) * normal).sum(axis=1)
    guess = (np.sign(away)[:, None] * np.abs(away)[:, None] * normal)[use].sum(axis=0)
    view = guess if range_axis is None else range_axis * (1.0 if range_axis @ guess >= 0 else -1.0)
    return np.asarray(normal * np.where(normal @ view >= 0, 1.0, -1.0)[:, None])


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
