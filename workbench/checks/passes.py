"""Passes over one plate against each other: do the faces that both saw lie in one place?"""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise

import numpy as np

from workbench.units import AnyArray, Float, Int, Shaped

PLACES = 5  # along a pass
REACH = 4  # columns on each side, for a normal
SAME = np.cos(np.radians(15.0))  # of the normals of one face
FAR_MM = 12.0  # what lies further off is not the same face
LEAST = 12  # returns of a face
BESIDE_MM = 1.0  # along the face, of points that stand opposite each other
COLUMNS = 160


def disagreement_mm(
    x_mm: AnyArray, z_mm: AnyArray, frames_of: Mapping[int, Int], poses: Shaped[Float, "N 4 4"]
) -> float:
    """Greatest distance (mm) between passes of a face that both saw, along its normal; NaN: nothing seen by both.

    Args:
        x_mm, z_mm: grid (N, M).
        frames_of: the frames (k,) of each pass.
        poses: (N, 4, 4) base_from_profiler.
    """
    found = [_between(x_mm, z_mm, frames_of[a], frames_of[b], poses) for a, b in pairwise(frames_of)]
    found = [one for one in found if np.isfinite(one)]
    return max(found, default=float("nan"))


def _between(x_mm: AnyArray, z_mm: AnyArray, first: Int, second: Int, poses: Float) -> float:
    origin_b = poses[second][:, :3, 3]
    normal_b = poses[second][:, :3, 1]
    found = []
    for i in first[np.unique(np.linspace(0, len(first) - 1, PLACES + 2).astype(int))[1:-1]]:
        points, normals = _profile(x_mm[i], z_mm[i], poses[i])
        if len(points) < LEAST:
            continue
        centre = points.mean(axis=0)
        behind = np.einsum("ki,ki->k", normal_b, centre - origin_b)  # distance to the other's planes
        crossing = np.flatnonzero(np.diff(np.sign(behind)) != 0)
        if not len(crossing):
            continue
        j = int(second[crossing[0]])
        others, their = _profile(x_mm[j], z_mm[j], poses[j])
        if len(others) < LEAST:
            continue
        found.append(_offset(points, normals, others, their))
    found = [one for one in found if np.isfinite(one)]
    return float(np.median(found)) if found else float("nan")


def _profile(x_mm: AnyArray, z_mm: AnyArray, pose: Float) -> tuple[Float, Float]:
    """Points (n, 3) of a frame in the base, and unit normals within its laser plane, towards the scanner's side."""
    valid = np.isfinite(x_mm) & np.isfinite(z_mm)
    x, z = x_mm[valid].astype(np.float64), z_mm[valid].astype(np.float64)
    if len(x) < 4 * REACH:
        return np.empty((0, 3)), np.empty((0, 3))
    dx, dz = x[2 * REACH :] - x[: -2 * REACH], z[2 * REACH :] - z[: -2 * REACH]
    bent = np.abs(z[2 * REACH :] + z[: -2 * REACH] - 2 * z[REACH:-REACH])
    size = np.hypot(dx, dz)
    smooth = (bent < 0.1) & (size > 0) & (size < 40 * REACH * np.median(np.abs(np.diff(x))))
    rows = np.flatnonzero(smooth)
    rows = rows[:: max(1, len(rows) // COLUMNS)]
    flat = np.zeros(len(rows))
    along = np.stack([dx[rows], flat, dz[rows]], axis=1) / size[rows][:, None] * np.sign(dx[rows])[:, None]
    inner = np.stack([x[REACH:-REACH][rows], flat, z[REACH:-REACH][rows]], axis=1)
    rotation = pose[:3, :3]
    normals = np.stack([-along[:, 2], flat, along[:, 0]], axis=1)
    return inner @ rotation.T + pose[:3, 3], normals @ rotation.T


def _offset(points: Float, normals: Float, others: Float, their: Float) -> float:
    """Greatest median distance along the normal, over faces: of each point to the nearest of its own direction.

    Normals count: z grows for all that one sensor sees, so the two sides of a plate have opposite ones. The nearest
    point must stand right opposite: a table beside the plate has the plate's direction, but is not under it.
    """
    gap = others[None] - points[:, None]
    distance = np.linalg.norm(gap, axis=2)
    distance[normals @ their.T < SAME] = np.inf
    nearest = np.argmin(distance, axis=1)
    near = distance[np.arange(len(points)), nearest]
    off = np.einsum("ki,ki->k", gap[np.arange(len(points)), nearest], normals)
    beside = np.sqrt(np.maximum(near**2 - off**2, 0.0))
    usable = (near < FAR_MM) & (beside < BESIDE_MM)
    group = np.round(np.degrees(np.arctan2(*_in_plane(normals))) / 20.0).astype(int)
    found = [
        abs(float(np.median(off[usable & (group == n)])))
        for n in np.unique(group[usable])
        if (usable & (group == n)).sum() >= LEAST
    ]
    return max(found, default=float("nan"))


def _in_plane(normals: Float) -> tuple[Float, Float]:
    """Coordinates of normals in the plane that holds most of them."""
    _, _, axes = np.linalg.svd(normals, full_matrices=False)
    return normals @ axes[0], normals @ axes[1]
