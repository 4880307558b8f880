"""Where a surface lies along an axis: planes through its points in a cylinder, with the uncertainty of the height.

Multiscale model to model cloud comparison (Lague, Brodu and Leroux, "Accurate 3D comparison of complex topography with
terrestrial laser scanner", ISPRS J. Photogramm. 82, 2013): the normal at one scale, the mean of each surface in a
cylinder along it at another. Departures: the surface at the axis is that of a plane fitted in the cylinder, so that
unequal sampling of a slope is no distance; a streak of a frame that lies aside of the others is left out; points of one
frame share the robot's error, so the noise of a mean is enlarged by what residuals of a frame have in common.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy

from workbench.compare.surfels import neighbours
from workbench.geometry.fits_steps import across
from workbench.geometry.medians import medians
from workbench.units import Bool, Float, Int, Shaped

LEAST_POINTS = 8  # in a cylinder
LEAST_FRAMES = 3  # or single points: the plane takes up two of them along the motion
LEAST_LEVERAGE = 0.5  # of the intercept: beyond, points lie all to one side of the axis
BATCH = 2_000
ROUNDS = 5  # of leaving out and fitting again
ASIDE = 4.685  # robust standard deviations beyond which a point counts no more: none of normal noise
TO_SD = 1.4826  # a normal distribution's standard deviation by its median absolute value


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
    used = _used(design, what, owner, len(position))
    cluster = index if frame is None else frame[index]
    return _intercepts(design[used], what[used], owner[used], cluster[used], len(position))


def _used(design: Float, what: Float, owner: Int, count: int) -> Bool:
    """(n,) points within `ASIDE` standard deviations of their owner's plane, by medians; owners in rising order.

    The deviation is at least that of the median owner, so that few points which agree by chance leave none out.
    """
    edges = np.searchsorted(owner, np.arange(count + 1))
    filled = np.diff(edges) >= LEAST_POINTS
    residual = what - medians(what, edges)[owner]
    used = np.ones(len(what), bool)
    for _ in range(ROUNDS):
        spread = TO_SD * medians(np.abs(residual), edges)
        least = float(np.median(spread[filled])) if filled.any() else 0.0
        again = np.abs(residual) <= ASIDE * np.maximum(spread, least)[owner]
        plane, _, _ = _planes(design[again], what[again], owner[again], count)
        residual = what - (design * plane[owner]).sum(axis=1)
        if (again == used).all():
            break
        used = again
    return used


def _planes(design: Float, what: Float, owner: Int, count: int) -> tuple[Float, Float, Bool]:
    """Coefficients (count, 3) of every owner's plane, the inverse normal matrix, and whether there is one."""
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
    return np.asarray(np.einsum("kij,kj->ki", inverse, side)), np.asarray(inverse), np.asarray(good)


def _intercepts(design: Float, what: Float, owner: Int, cluster: Int, count: int) -> tuple[Float, ...]:
    """Planes (1, u, v) through `what` of each owner: the intercept, and what `Heights` says of it."""
    plane, inverse, good = _planes(design, what, owner, count)
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
