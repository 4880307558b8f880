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

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import scipy

from workbench.compare.surface_stage import Surface
from workbench.geometry.medians import robust_sd
from workbench.geometry.poses import frame_about
from workbench.units import Bool, Float, Int, Shaped

LEAST_POINTS = 8
FLAT = 0.02  # smallest over middle eigenvalue of a flat neighbourhood: beyond, there is a corner in it
JOINED, NEIGHBOURS = 3.0, 12  # times their usual distance, in which places are of one surface; that tell its side
LEAST_TURN = 1e-6  # of neighbours, for a graph whose edges are not 0
LEAST_IN_CYLINDER = 8  # in a cylinder
LEAST_FRAMES = 3  # or single points: the plane takes up two of them along the motion
LEAST_LEVERAGE = 0.5  # of the intercept: beyond, points lie all to one side of the axis
SAME_SIDE = 0.8  # least cosine between normals that belong together
NOWHERE = (math.nan,) * 4  # where a surface does not meet an axis
ROUNDS = 5  # of leaving out and fitting again
CUTOFF = 4.685  # robust standard deviations beyond which a point counts no more: none of normal noise


class Surfels(NamedTuple):
    """c local planes."""

    centre_mm: Shaped[Float, "c 3"]  # mean of the neighbourhood
    normal: Shaped[Float, "c 3"]  # unit, outwards
    flat: Shaped[Bool, " c"]  # enough points, and no corner among them
    frame: Shaped[Int, " c"] | None = None  # in whose middle it lies; None: not known


def surfels(surface: Surface, spacing_mm: float, radius_mm: float) -> Surfels:
    """Principal axes of the points within `radius_mm` of places about `spacing_mm` apart, Open3D's voxels' middles."""
    import open3d

    o3d: Any = open3d  # its stubs know less than it does
    cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(np.array(surface.points_mm)))  # its own, since it writes
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


def outwards(normal: Float, centre: Float, flat: Bool, range_axis: Float | None) -> Float:
    """Normals (c, 3) turned outwards: away from the middle of a convex body, summed over what belongs together.

    A scanner sees all places from one side, so that with a range axis this tells its sense. Without one each normal
    follows its neighbours', around edges too, over those that turn least (H. Hoppe et al., Surface reconstruction from
    unorganized points, SIGGRAPH 1992): a part may be seen from all sides.
    """
    use = flat if flat.any() else np.ones(len(normal), bool)
    away = centre - centre[use].mean(axis=0)
    if range_axis is not None:
        guess = ((away * normal).sum(axis=1)[:, None] * normal)[use].sum(axis=0)
        view = range_axis * (1.0 if range_axis @ guess >= 0 else -1.0)
        return np.asarray(normal * np.where(normal @ view >= 0, 1.0, -1.0)[:, None])
    sign = np.where((away * normal).sum(axis=1) >= 0.0, 1.0, -1.0)
    if len(normal) < 2:
        return normal * sign[:, None]
    apart, near = scipy.spatial.cKDTree(centre).query(centre, min(NEIGHBOURS, len(centre)))
    joined = (apart <= JOINED * np.median(apart[:, 1])) & (apart > 0.0)
    one, other = np.nonzero(joined)[0], near[joined]
    turn = 1.0 + LEAST_TURN - np.abs((normal[one] * normal[other]).sum(axis=1))
    graph = scipy.sparse.coo_array((turn, (one, other)), (len(normal),) * 2).tocsr()
    least = scipy.sparse.csgraph.minimum_spanning_tree(graph)
    piece = scipy.sparse.csgraph.connected_components(least, directed=False)[1]
    _, first, size = np.unique(piece, return_index=True, return_counts=True)
    for root in first[size > 1]:
        order, before = scipy.sparse.csgraph.breadth_first_order(least, int(root), directed=False)
        for at in order[1:]:
            sign[at] = sign[before[at]] * (1.0 if normal[at] @ normal[before[at]] >= 0.0 else -1.0)
        outside = (away[order] * normal[order]).sum(axis=1) * sign[order]
        sign[order] *= 1.0 if outside[use[order]].sum() >= 0.0 else -1.0
    return np.asarray(normal * sign[:, None])


Target = Callable[[Float], tuple[Float, Float]]  # points (n, 3) -> feet (n, 3) and outward normals (n, 3); NaN: none


def target_of(reference: Surface, spacing_mm: float, radius_mm: float) -> Target:
    """The nearest place of a mesh, or of a scan's local planes."""
    return on_scan(reference, spacing_mm, radius_mm) if reference.triangles is None else on_mesh(reference)


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
        off_surface = np.linalg.norm(foot - centre[index], axis=1) > 2.0 * radius_mm
        foot[off_surface] = np.nan
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
        off_surface = np.linalg.norm(foot - near, axis=1) > 1e-3 + 1e-6 * np.abs(near - origin).max(initial=0.0)
        foot[off_surface] = np.nan  # the nearest place is a border of the mesh
        return foot, normal

    return nearest


class Heights(NamedTuple):
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
    near = scipy.spatial.cKDTree(points_mm).query_ball_point(position_mm, float(np.hypot(radius_mm, depth_mm)))
    cluster = np.arange(len(points_mm)) if frame is None else frame
    cylinders = []
    for index, at, axis, plane_axes in zip(near, position_mm, normal, frame_about(normal)[:, :2], strict=True):
        off = points_mm[index] - at
        height, lateral = off @ axis, off @ plane_axes.T
        what = height if values is None else values[index]
        inside = ((lateral**2).sum(axis=1) <= radius_mm**2) & (np.abs(height) <= depth_mm) & np.isfinite(what)
        design = np.column_stack([np.ones(len(off)), lateral / radius_mm])
        cylinders.append((design[inside], what[inside], cluster[index][inside]))
    spreads = [_scatter(design, what) for design, what, _ in cylinders if len(what) >= LEAST_IN_CYLINDER]
    least = float(np.median(spreads)) if spreads else 0.0
    return Heights(*np.array([_intercept(*cylinder, least) for cylinder in cylinders]).reshape(-1, 4).T)


def _scatter(design: Float, what: Float) -> float:
    """Of the points about their plane, less those that stand aside by `CUTOFF` of it."""
    residual = what - np.median(what)
    for _ in range(ROUNDS):
        near = np.abs(residual) <= CUTOFF * robust_sd(residual)
        if near.sum() < LEAST_IN_CYLINDER:
            break
        residual = what - design @ np.linalg.lstsq(design[near], what[near])[0]
    return robust_sd(residual)


def _intercept(design: Float, what: Float, cluster: Int, least: float) -> tuple[float, float, float, float]:
    """A plane (1, u, v) through `what` of a cylinder: the intercept, and what `Heights` says of it.

    Points count within `CUTOFF` standard deviations of it, by medians; the deviation is at least `least`, that of the
    median cylinder, so that few points which agree by chance leave none out.
    """
    if len(what) < LEAST_IN_CYLINDER:
        return NOWHERE
    residual, used = what - np.median(what), np.zeros(len(what), bool)
    for _ in range(ROUNDS):
        again = np.abs(residual) <= CUTOFF * max(robust_sd(residual), least)
        matrix = design[again].T @ design[again]
        if again.sum() < LEAST_IN_CYLINDER or np.linalg.det(matrix) <= 1e-6 * again.sum() ** 3:
            return NOWHERE
        if (again == used).all():
            break
        used, inverse = again, np.linalg.inv(matrix)
        plane = inverse @ (design[again].T @ what[again])
        residual = what - design @ plane
    pull, own = design[used] @ inverse[0], residual[used]
    _, group = np.unique(cluster[used], return_inverse=True)
    frames = int(group.max()) + 1
    if inverse[0, 0] > LEAST_LEVERAGE or frames < LEAST_FRAMES:
        return NOWHERE
    shared = (np.bincount(group, pull * own) ** 2).sum() * frames / (frames - 2)
    leverage = (np.bincount(group, pull) ** 2).sum()
    return float(plane[0]), float(own @ own) / (len(own) - 3) * float(inverse[0, 0]), float(shared), float(leverage)
