"""Deviations of a registered scan from a reference at evenly spread places."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy

from workbench.compare.course import Course
from workbench.compare.surface_values import Deviations, Registration, Surface
from workbench.compare.surfels import Surfels, neighbours, surfels
from workbench.compare.target import on_mesh
from workbench.geometry.fits_steps import across
from workbench.units import Float, Int


@dataclass(frozen=True, slots=True)
class Scales:
    """Of the comparison: between places; diameters of a normal's neighbourhood and of a cylinder; its reach."""

    spacing_mm: float
    normal_mm: float
    projection_mm: float
    depth_mm: float


def places_of(scan: Surface, reference: Surface, scales: Scales) -> Surfels:
    """Flat places of the scan; their normals point outwards as the reference's do where it is a mesh."""
    found = surfels(scan, scales.spacing_mm, 0.5 * scales.normal_mm)
    centre, normal = found.centre_mm[found.flat], found.normal[found.flat]
    if reference.triangles is not None and len(centre):
        turned = (on_mesh(reference)(centre)[1] * normal).sum(axis=1) < 0
        normal = np.where(turned[:, None], -normal, normal)
    return Surfels(centre, normal, np.ones(len(centre), bool))


def deviations(
    scan: Surface,
    reference: Surface,
    places: Surfels,
    registration: Registration | None,
    position_u_mm: float,
    course: Course,
    scales: Scales,
) -> Deviations:
    """M3C2 distances at places of a registered scan; NaN where one of the surfaces is missing."""
    position, normal, radius = places.centre_mm, places.normal, 0.5 * scales.projection_mm
    depth_mm = scales.depth_mm
    if reference.triangles is None:
        mine = heights(scan.points_mm, None, scan.frame, position, normal, radius, depth_mm)
        other = heights(reference.points_mm, None, reference.frame, position, normal, radius, depth_mm)
        distance, noise = mine.height_mm - other.height_mm, np.hypot(mine.u_mm, other.u_mm)
    else:
        foot, outward = on_mesh(reference)(scan.points_mm)
        off = ((scan.points_mm - foot) * outward).sum(axis=1)
        off[np.abs(off) > depth_mm] = np.nan
        mine = heights(scan.points_mm, off, scan.frame, position, normal, radius, depth_mm)
        distance, noise = mine.height_mm, mine.u_mm
    u = np.hypot(noise, position_u(registration, position, normal, position_u_mm))
    along, aside = course.locate(position)
    return Deviations(position, normal, distance, u, DETECTION * u, along, aside)


def position_u(registration: Registration | None, position_mm: Float, normal: Float, position_u_mm: float) -> Float:
    """(c,) what the registration's covariance makes along each normal; without one, the uncertainty that is stated."""
    if registration is None:
        return np.full(len(position_mm), position_u_mm)
    rows = np.hstack([normal, np.cross(position_mm - registration.pivot_mm, normal)])
    return np.asarray(np.sqrt(np.einsum("ki,ij,kj->k", rows, registration.covariance, rows)))


# Signed distances between a scan and a reference along normals, with their uncertainty.
#
# Multiscale model to model cloud comparison (Lague, Brodu and Leroux, "Accurate 3D comparison of complex topography
# with
# terrestrial laser scanner", ISPRS J. Photogramm. 82, 2013): the normal at one scale, the mean of each surface in a
# cylinder along it at another. Departures: the surface at the axis is that of a plane fitted in the cylinder, so
# that
# unequal sampling of a slope is no distance; points of one frame share the robot's error, so the noise of a mean is
# enlarged by what residuals of a frame have in common; and the registration's covariance at the place is added in
# quadrature (the paper adds one number linearly).

DETECTION = 1.959964  # two-sided 95 %
LEAST_POINTS = 8  # in a cylinder
LEAST_FRAMES = 3  # or single points: the plane takes up two of them along the motion
LEAST_LEVERAGE = 0.5  # of the intercept: beyond, points lie all to one side of the axis
BATCH = 2_000


@dataclass(frozen=True, slots=True, eq=False)
class Heights:
    """Where a surface meets the axes of c cylinders, along their normals; NaN: it does not."""

    height_mm: Float  # (c,)
    variance_mm2: Float  # (c,) of the height, as if all points were independent
    shared_mm2: Float  # (c,) the same by the frames' sums
    leverage: Float  # (c,) variance of the height for an error of unit variance that each frame has as a whole

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
        _batch(points_mm, values, frame, tree, position_mm[k : k + BATCH], normal[k : k + BATCH], radius_mm, depth_mm)
        for k in range(0, len(position_mm), BATCH)
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
    return _intercepts(design, what, owner, index if frame is None else frame[index], len(position))


def _intercepts(design: Float, what: Float, owner: Int, cluster: Int, count: int) -> tuple[Float, ...]:
    """Planes (1, u, v) through `what` of each owner: the intercept, and what `Heights` says of it."""
    moments = np.empty((count, 3, 3))
    side = np.empty((count, 3))
    for i in range(3):
        side[:, i] = np.bincount(owner, design[:, i] * what, count)
        for j in range(3):
            moments[:, i, j] = np.bincount(owner, design[:, i] * design[:, j], count)
    number = np.bincount(owner, minlength=count)
    good = (number >= LEAST_POINTS) & (np.linalg.det(moments) > 1e-6 * np.maximum(number, 1.0) ** 3)
    moments[~good] = np.eye(3)
    inverse = np.linalg.inv(moments)
    plane = np.einsum("kij,kj->ki", inverse, side)
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
