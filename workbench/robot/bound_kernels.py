"""The compiled kernels of `workbench.robot.bounds`.

Arrays are passed whole, with indices: a slice of an array costs as much as the arithmetic here. Volumes s: ends
`at` (S, 2, 3) of a capsule's axis, pose `placed` (S, 3, 4) of a solid in it, in the base.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from workbench.kernels import kernel
from workbench.units import AnyArray, Shaped

NONE, BOX, CYLINDER = 0, 1, 2  # what a volume is besides a capsule
SECTION = 0.6180339887498949  # golden
STEPS = 22  # of the search along a segment: 2.5e-5 of its length is left


class BoundingVolumes(NamedTuple):
    """S shapes in volumes, and pairs of them to look at.

    Volumes are capsules, and solids within some of them, where they are at zero: in the base, or the frame of the
    external axis that carries them.
    """

    link: Shaped[AnyArray, " S"]  # as in `Shape`, the fixed ones 0
    solid: Shaped[AnyArray, " S"]  # a box, a cylinder, or none: a capsule alone
    ends_mm: Shaped[AnyArray, "S 2 3"]  # of capsules
    radius_mm: Shaped[AnyArray, " S"]
    pose: Shaped[AnyArray, "S 4 4"]  # of solids
    half_mm: Shaped[AnyArray, "S 3"]  # their half lengths
    around_mm: Shaped[AnyArray, " S"]  # radius of the sphere around each
    pairs: Shaped[AnyArray, "P 2"]


class Standing(NamedTuple):
    """The S volumes where their links carry them, at n postures."""

    at: Shaped[AnyArray, "n S 2 3"]  # ends of capsules
    placed: Shaped[AnyArray, "n S 3 4"]  # poses of solids
    middle: Shaped[AnyArray, "n S 3"]  # of both


@kernel(error_model="numpy")
def placed_kernel(scene: BoundingVolumes, links: AnyArray) -> Standing:
    """The volumes where motions (n, 8 or more, 4, 4) by `Shape.link` carry them."""
    shape = len(links), len(scene.link)
    at, placed, middle = np.empty((*shape, 2, 3)), np.empty((*shape, 3, 4)), np.empty((*shape, 3))
    for n in range(len(links)):
        for s in range(len(scene.link)):
            motion = links[n, scene.link[s]]
            for r in range(3):
                a, b, c, d = motion[r]
                for k in range(2):
                    x, y, z = scene.ends_mm[s, k]
                    at[n, s, k, r] = a * x + b * y + c * z + d
                for k in range(4):
                    x, y, z, w = scene.pose[s, :, k]
                    placed[n, s, r, k] = a * x + b * y + c * z + d * w
                boxed = scene.solid[s] == BOX
                middle[n, s, r] = placed[n, s, r, 3] if boxed else (at[n, s, 0, r] + at[n, s, 1, r]) / 2
    return Standing(at, placed, middle)


@kernel(error_model="numpy")
def pairs_kernel(scene: BoundingVolumes, standing: Standing, most: AnyArray) -> AnyArray:
    """A lower bound of each pair's distance (n, P), or `most` (n, P) where that is less."""
    found, pairs, around, middles = most.copy(), scene.pairs, scene.around_mm, standing.middle
    for n in range(len(most)):
        at, placed, middle = standing.at[n], standing.placed[n], middles[n]
        for i in range(len(pairs)):
            a, b = pairs[i, 0], pairs[i, 1]
            reach = most[n, i] + around[a] + around[b]
            x, y, z = middle[a, 0] - middle[b, 0], middle[a, 1] - middle[b, 1], middle[a, 2] - middle[b, 2]
            if x * x + y * y + z * z < reach * reach:
                found[n, i] = _distance(at, placed, scene, a, b, most[n, i])
    return found


@kernel(error_model="numpy")
def _distance(at: AnyArray, placed: AnyArray, scene: BoundingVolumes, a: int, b: int, most: float) -> float:
    """A lower bound of the distance of volumes a and b, or `most` where that is less."""
    radius, half, around, solid = scene.radius_mm, scene.half_mm, scene.around_mm, scene.solid
    fits = solid[b] == NONE or solid[a] == BOX or radius[a] > radius[b]  # as the capsule around it, of two solids
    larger = solid[a] == BOX and around[a] > around[b]  # of two boxes the smaller is the capsule around it
    if larger if solid[b] == BOX else solid[a] != NONE and fits:
        a, b = b, a
    if solid[b] != BOX:
        apart: float = _between(at, a, b) - radius[a] - radius[b]
        if solid[b] == NONE or apart >= most:
            return min(most, apart)
    if _beyond_a_face(at, a, placed, half, b) - radius[a] >= most:
        return most
    near: float = _to_solid(at, a, placed, half, b, solid[b] == CYLINDER) - radius[a]
    return min(most, near)


@kernel(error_model="numpy")
def _between(at: AnyArray, a: int, b: int) -> float:
    """Distance of two segments (Ericson, Real-Time Collision Detection, 2005, section 5.1.9)."""
    uu, vv, uv, uw, vw, ww = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for r in range(3):
        u, v, w = at[a, 1, r] - at[a, 0, r], at[b, 1, r] - at[b, 0, r], at[a, 0, r] - at[b, 0, r]
        uu, vv, uv = uu + u * u, vv + v * v, uv + u * v
        uw, vw, ww = uw + u * w, vw + v * w, ww + w * w
    square = uu * vv - uv * uv
    s = min(max((uv * vw - uw * vv) / square, 0.0), 1.0) if square > 1e-12 * uu * vv else 0.0
    t = (uv * s + vw) / vv if vv > 0.0 else 0.0
    if t < 0.0 or t > 1.0 or vv == 0.0:
        t = min(max(t, 0.0), 1.0)
        s = min(max((uv * t - uw) / uu, 0.0), 1.0) if uu > 0.0 else 0.0
    left = 0.0
    for r in range(3):
        on_a = at[a, 0, r] + s * (at[a, 1, r] - at[a, 0, r])
        on_b = at[b, 0, r] + t * (at[b, 1, r] - at[b, 0, r])
        left += (on_a - on_b) ** 2
    return np.sqrt(left)  # type: ignore[no-any-return]


@kernel(error_model="numpy")
def _beyond_a_face(at: AnyArray, a: int, pose: AnyArray, half: AnyArray, b: int) -> float:
    """A lower bound of a segment's distance from a box: how far it stays beyond one of the box's faces."""
    best = -1e9
    for k in range(3):
        x, y, z = pose[b, 0, k], pose[b, 1, k], pose[b, 2, k]
        o = x * pose[b, 0, 3] + y * pose[b, 1, 3] + z * pose[b, 2, 3]
        p = x * at[a, 0, 0] + y * at[a, 0, 1] + z * at[a, 0, 2] - o
        q = x * at[a, 1, 0] + y * at[a, 1, 1] + z * at[a, 1, 2] - o
        best = max(best, min(p, q) - half[b, k], -max(p, q) - half[b, k])
    return best


@kernel(error_model="numpy")
def _to_solid(at: AnyArray, a: int, pose: AnyArray, half: AnyArray, b: int, is_round: bool) -> float:
    """A lower bound of a segment's distance from a solid: convex along the segment, so a golden search brackets it."""
    low, high, left, right = 0.0, 1.0, 1.0 - SECTION, SECTION
    f, g = _outside(at, a, left, pose, half, b, is_round), _outside(at, a, right, pose, half, b, is_round)
    for _ in range(STEPS):
        if f < g:
            high, right, g = right, left, f
            left = high - SECTION * (high - low)
            f = _outside(at, a, left, pose, half, b, is_round)
        else:
            low, left, f = left, right, g
            right = low + SECTION * (high - low)
            g = _outside(at, a, right, pose, half, b, is_round)
    length = np.sqrt(
        (at[a, 1, 0] - at[a, 0, 0]) ** 2 + (at[a, 1, 1] - at[a, 0, 1]) ** 2 + (at[a, 1, 2] - at[a, 0, 2]) ** 2
    )
    return min(f, g) - (high - low) * length  # type: ignore[no-any-return]


@kernel(error_model="numpy")
def _outside(at: AnyArray, a: int, t: float, pose: AnyArray, half: AnyArray, b: int, is_round: bool) -> float:
    """Distance from a box, or the cylinder in it along its z, of the point at t, 0 to 1, on a segment; 0 inside."""
    x = at[a, 0, 0] + t * (at[a, 1, 0] - at[a, 0, 0]) - pose[b, 0, 3]
    y = at[a, 0, 1] + t * (at[a, 1, 1] - at[a, 0, 1]) - pose[b, 1, 3]
    z = at[a, 0, 2] + t * (at[a, 1, 2] - at[a, 0, 2]) - pose[b, 2, 3]
    square, across = 0.0, 0.0
    for k in range(3):
        along = pose[b, 0, k] * x + pose[b, 1, k] * y + pose[b, 2, k] * z
        if is_round and k < 2:
            across += along * along
        else:
            beyond = max(abs(along) - half[b, k], 0.0)
            square += beyond * beyond
    if is_round:
        beyond = max(np.sqrt(across) - half[b, 0], 0.0)
        square += beyond * beyond
    return np.sqrt(square)  # type: ignore[no-any-return]
