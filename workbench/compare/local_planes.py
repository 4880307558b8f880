"""Planes through the points of a scan: about places all over it, and in cylinders along an axis.

The nearest place of a reference is told on such planes, or on a mesh. Where a surface lies along an axis, with the
uncertainty of the height, follows the multiscale model to model cloud comparison (Lague, Brodu and Leroux, "Accurate 3D
comparison of complex topography with terrestrial laser scanner", ISPRS J. Photogramm. 82, 2013): the normal at one
scale, the mean of each surface in a cylinder along it at another. Departures: the surface at the axis is that of a
plane fitted in the cylinder, so that unequal sampling of a slope is no distance; a streak of a frame that lies aside of
the others is left out; points of one frame share the robot's error, so the noise of a mean is enlarged by what
residuals of a frame have in common.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy

from workbench.compare.surface import Surface
from workbench.geometry.fits import across
from workbench.geometry.medians import medians
from workbench.units import Bool, Float, Int, Shaped

LEAST_POINTS = 8
FLAT = 0.02  # smallest over middle eigenvalue of a flat neighbourhood: beyond, there is a corner in it
LEAST_IN_CYLINDER = 8  # in a cylinder
LEAST_FRAMES = 3  # or single points: the plane takes up two of them along the motion
LEAST_LEVERAGE = 0.5  # of the intercept: beyond, points lie all to one side of the axis
CYLINDERS_AT_ONCE = 2_000
ROUNDS = 5  # of leaving out and fitting again
ASIDE = 4.685  # robust standard deviations beyond which a point counts no more: none of normal noise
TO_SD = 1.4826  # a normal distribution's standard deviation by its median absolute value


@dataclass(frozen=True, slots=True, eq=False)
class Surfels:
    """c local planes."""

    centre_mm: Shaped[Float, "c 3"]  # mean of the neighbourhood
    normal: Shaped[Float, "c 3"]  # unit, outwards
    flat: Shaped[Bool, " c"]  # enough points, and no corner among them
    frame: Shaped[Int, " c"] | None = None  # in whose middle it lies; None: not known


def surfels(surface: Surface, spacing_mm: float, radius_mm: float) -> Surfels:
    """Principal axes of the points within `radius_mm` of places about `spacing_mm` apart, Open3D's voxels' middles."""
    import open3d

    o3d: Any = open3d  # its stubs know less than it does
    cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(surface.points_mm))
    tree, centre = o3d.geometry.KDTreeFlann(cloud), np.array(cloud.voxel_down_sample(spacing_mm).points)
    count, nearest, moment = (
        np.zeros(len(centre), np.int64),
        np.zeros(len(centre), np.int64),
        np.zeros((len(centre), 3, 3)),
    )
    for k, at in enumerate(centre):
        nearest[k] = tree.search_knn_vector_3d(at, 1)[1][0]
        count[k], index, _ = tree.search_radius_vector_3d(at, radius_mm)
        if count[k]:
            near = surface.points_mm[np.asarray(index)]
            centre[k] = near.mean(axis=0)
            moment[k] = (near - centre[k]).T @ (near - centre[k]) / count[k]
    size, axes = np.linalg.eigh(moment)
    flat = (count >= LEAST_POINTS) & (size[:, 0] <= FLAT * size[:, 1])
    normal = outwards(axes[:, :, 0], centre, flat, surface.range_axis)
    return Surfels(centre, normal, flat, None if surface.frame is None else surface.frame[nearest])


def neighbours(tree: scipy.spatial.cKDTree, at_mm: Float, radius_mm: float) -> tuple[Int, Int]:
    """Indices of the points near each place, one list after the other, and where each list begins (c + 1,)."""
    lists = tree.query_ball_point(at_mm, radius_mm)
    start = np.concatenate([[0], np.cumsum([len(one) for one in lists])])
    return np.fromiter((i for one in lists for i in one), np.int64, start[-1]), start


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


@dataclass(frozen=True, slots=True, eq=False)
class Heights:
    """Where a surface meets the axes of c cylinders, along their normals; NaN: it does not."""

    height_mm: Shaped[Float, " c"]
    variance_mm2: Shaped[Float, " c"]  # of the height, as if all points were independent
    shared_mm2: Shaped[Float, " c"]  # the same by the frames' sums
    leverage: Shaped[Float, " c"]  # variance of the height for an error of unit variance that each frame has as a whole

    @property
    def u_mm(self) -> Float:
        """(c,) standard uncertainty; the variance of what a frame's points share is one for the whole surface."""
        good = np.isfinite(self.variance_mm2)
        excess = float((self.shared_mm2 - self.variance_mm2)[good].sum())
        of_frame = max(0.0, excess / float(self.leverage[good].sum())) if good.any() else 0.0
        return np.asarray(np.sqrt(self.variance_mm2 + of_frame * self.leverage))


def heights(
    points_mm: Float,
    values: Float | None,
    frame: Int | None,
    position_mm: Float,
    normal: Float,
    radius_mm: float,
    depth_mm: float,
) -> Heights:
    """The surface of points (n, 3) in cylinders about axes through `position_mm` along `normal`, both (c, 3).

    `values` (n,): what to average instead of the height over the position, such as distances from a mesh (NaN: none).
    `frame` (n,) in which each point was measured.
    """
    tree = scipy.spatial.cKDTree(points_mm)
    parts = [
        _batch(
            points_mm,
            values,
            frame,
            tree,
            position_mm[k : k + CYLINDERS_AT_ONCE],
            normal[k : k + CYLINDERS_AT_ONCE],
            radius_mm,
            depth_mm,
        )
        for k in range(0, len(position_mm), CYLINDERS_AT_ONCE)
    ]
    return Heights(*(np.concatenate(columns) for columns in zip(*parts, strict=True)))


def _batch(
    points: Float,
    values: Float | None,
    frame: Int | None,
    tree: scipy.spatial.cKDTree,
    position: Float,
    normal: Float,
    radius: float,
    depth: float,
) -> tuple[Float, ...]:
    index, start = neighbours(tree, position, float(np.hypot(radius, depth)))
    owner = np.repeat(np.arange(len(position)), np.diff(start))
    off = points[index] - position[owner]
    height = (off * normal[owner]).sum(axis=1)
    aside = off - height[:, None] * normal[owner]
    what = height if values is None else values[index]
    inside = ((aside**2).sum(axis=1) <= radius**2) & (np.abs(height) <= depth) & np.isfinite(what)
    index, owner, aside, what = index[inside], owner[inside], aside[inside], what[inside]
    across_axes = across(normal)[owner] / radius
    design = np.column_stack([np.ones(len(owner)), np.einsum("nij,nj->ni", across_axes, aside)])
    used = _used(design, what, owner, len(position))
    cluster = index if frame is None else frame[index]
    return _intercepts(design[used], what[used], owner[used], cluster[used], len(position))


def _used(design: Float, what: Float, owner: Int, count: int) -> Bool:
    """(n,) points within `ASIDE` standard deviations of their owner's plane, by medians; owners in rising order.

    The deviation is at least that of the median owner, so that few points which agree by chance leave none out.
    """
    edges = np.searchsorted(owner, np.arange(count + 1))
    filled = np.diff(edges) >= LEAST_IN_CYLINDER
    residual = what - medians(what, edges)[owner]
    used = np.ones(len(what), bool)
    for _ in range(ROUNDS):
        spread = TO_SD * medians(np.abs(residual), edges)
        least = float(np.median(spread[filled])) if filled.any() else 0.0
        again = np.abs(residual) <= ASIDE * np.maximum(spread, least)[owner]
        plane, _, _ = _fitted(design[again], what[again], owner[again], count)
        residual = what - (design * plane[owner]).sum(axis=1)
        if (again == used).all():
            break
        used = again
    return used


def _fitted(design: Float, what: Float, owner: Int, count: int) -> tuple[Float, Float, Bool]:
    """Coefficients (count, 3) of every owner's plane, the inverse normal matrix, and whether there is one."""
    moments = np.empty((count, 3, 3))
    side = np.empty((count, 3))
    for i in range(3):
        side[:, i] = np.bincount(owner, design[:, i] * what, count)
        for j in range(3):
            moments[:, i, j] = np.bincount(owner, design[:, i] * design[:, j], count)
    number = np.bincount(owner, minlength=count)
    good = (number >= LEAST_IN_CYLINDER) & (np.linalg.det(moments) > 1e-6 * np.maximum(number, 1.0) ** 3)
    moments[~good] = np.eye(3)
    inverse = np.linalg.inv(moments)
    return np.asarray(np.einsum("kij,kj->ki", inverse, side)), np.asarray(inverse), np.asarray(good)


def _intercepts(design: Float, what: Float, owner: Int, cluster: Int, count: int) -> tuple[Float, ...]:
    """Planes (1, u, v) through `what` of each owner: the intercept, and what `Heights` says of it."""
    plane, inverse, good = _fitted(design, what, owner, count)
    number = np.bincount(owner, minlength=count)
    residual = what - (design * plane[owner]).sum(axis=1)
    spread = np.bincount(owner, residual**2, count) / np.maximum(number - 3, 1)
    pull = (inverse[owner, 0] * design).sum(axis=1)
    group, first = _groups(owner, cluster)
    frames = np.bincount(owner[first], minlength=count)
    shared = (
        np.bincount(owner[first], np.bincount(group, pull * residual) ** 2, count) * frames / np.maximum(frames - 2, 1)
    )
    good &= (inverse[:, 0, 0] <= LEAST_LEVERAGE) & (frames >= LEAST_FRAMES)
    leverage = np.bincount(owner[first], np.bincount(group, pull) ** 2, count)
    found = plane[:, 0], spread * inverse[:, 0, 0], shared, leverage
    return tuple(np.where(good, one, np.nan) for one in found)


def _groups(owner: Int, cluster: Int) -> tuple[Int, Int]:
    """A number for every pair of owner and cluster, and where each first occurs."""
    key = owner * (int(cluster.max(initial=0)) + 1) + cluster
    _, first, group = np.unique(key, return_index=True, return_inverse=True)
    return group, first
