"""Frames and passes against each other: what stands there twice, and whether both saw a face in one place."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from workbench.checks.sensor import some
from workbench.geometry.along import by_pass
from workbench.geometry.grids import frame_digests
from workbench.units import AnyArray, Bool, Float, Int, Shaped

LEAST_RETURNS = 16  # of a frame: with fewer, frames may well be alike
NOISE_MM = 1e-4  # of neighbouring returns: frames without any noise were computed, and may be alike
ALIKE = 0.9  # correlation of the noise of two frames of different passes that are copies of one


@dataclass(frozen=True, slots=True, eq=False)
class Repeats:
    """What a recording shows more than once."""

    copies: Shaped[Bool, " N"]  # frames that are bit for bit an earlier one of their own pass
    passes: dict[int, int]  # pass that is a copy: the one that it is a copy of


def find_repeats(z_mm: AnyArray, pass_index: Int) -> Repeats:
    """Compare all frames of a grid (N, M) with each other, by the digests of their ranges, and passes by their noise.

    Frames with few returns and recordings without noise do not count: they may be alike and yet right.
    """
    frames = len(z_mm)
    alike = _alike_passes(z_mm, pass_index)
    none = Repeats(np.zeros(frames, bool), alike)
    if frames < 2 or not _has_noise(z_mm):
        return none
    digest = frame_digests(z_mm)
    _, first = np.unique(digest, return_index=True)
    if len(first) == frames:  # the usual case: no two are alike
        return none
    counted = np.isfinite(z_mm).sum(axis=1) >= LEAST_RETURNS
    copies = np.zeros(frames, bool)
    for at in by_pass(pass_index, counted):
        copies[np.delete(at, np.unique(digest[at], return_index=True)[1])] = True
    return Repeats(copies, alike)


def _has_noise(z_mm: AnyArray) -> bool:
    """Whether neighbouring returns of some frames scatter as measured ones do."""
    bend = np.abs(np.diff(some(z_mm, 9).astype(np.float64), n=2, axis=1))
    bend = bend[np.isfinite(bend)]
    return bool(bend.size and np.median(bend) > NOISE_MM)


def _alike_passes(z_mm: AnyArray, pass_index: Int) -> dict[int, int]:
    """By copy, the original, of passes of as many frames whose noise is the same, though perhaps no frame bit for bit.

    A second pass over the same plate has the same shape, but noise of its own.
    """
    numbers = np.unique(pass_index)
    found, bends = {}, {}
    for number in numbers:
        at = np.flatnonzero(pass_index == number)
        bends[int(number)] = (len(at), np.diff(z_mm[some(at, 5)].astype(np.float64), n=4, axis=1))
    for i, copy in enumerate(map(int, numbers)):
        for original in map(int, numbers[:i]):
            (count_a, a), (count_b, b) = bends[copy], bends[original]
            if count_a == count_b and a.shape == b.shape and _correlation(a, b) > ALIKE:
                found[copy] = original
                break
    return found


def _correlation(a: AnyArray, b: AnyArray) -> float:
    both = np.isfinite(a) & np.isfinite(b)
    if both.sum() < 100:
        return 0.0
    u, v = a[both], b[both]
    limit = 10.0 * np.median(np.abs(u)) + 1e-12  # jumps have no part in it
    inside = (np.abs(u) < limit) & (np.abs(v) < limit)
    if inside.sum() < 100 or not u[inside].std() * v[inside].std() > 0:
        return 0.0
    return float(np.corrcoef(u[inside], v[inside])[0, 1])


PLACES = 5  # along a pass
MOST_CROSSED = 40  # frames of the other pass, evenly
REACH = 4  # columns on each side, for a normal
SAME = np.cos(np.radians(15.0))  # of the normals of one face
FAR_MM = 12.0  # what lies further off is not the same face
LEAST = 12  # returns of a face
LATERAL_MM = 1.0  # along the face, of points that stand opposite each other
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
    for i in some(first, PLACES + 2)[1:-1]:
        points, normals = _profile(x_mm[i], z_mm[i], poses[i])
        if len(points) < LEAST:
            continue
        # the other's frames that these points lie in: several, where one of the passes leads
        behind = points[:: len(points) // LEAST] @ normal_b.T - np.einsum("ki,ki->k", normal_b, origin_b)
        crossed = second[np.flatnonzero((np.diff(np.sign(behind), axis=1) != 0).any(axis=0))]
        if not len(crossed):
            continue
        every = len(crossed) // MOST_CROSSED + 1
        met = [_profile(x_mm[j], z_mm[j], poses[j]) for j in crossed[::every]]
        others, their = (np.concatenate(one) for one in zip(*met, strict=True))
        if len(others) >= LEAST:
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
    lateral = np.sqrt(np.maximum(near**2 - off**2, 0.0))
    usable = (near < FAR_MM) & (lateral < LATERAL_MM)
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
