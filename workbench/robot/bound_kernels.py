"""The compiled kernels of `workbench.robot.bounds`.

Arrays are passed whole, with indices: a slice of an array costs as much as the arithmetic here. Volumes s: ends
`at` (S, 2, 3) of a capsule's axis, pose `placed` (S, 3, 4) of a solid in it, in the base.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from workbench.geometry.distances import segments_apart
from workbench.kernels import kernel
from workbench.robot.kinematics import compose, turn_about_axis
from workbench.units import DEG, AnyArray, Shaped

NONE, BOX, CYLINDER = 0, 1, 2  # what a volume is besides a capsule
SECTION = 0.6180339887498949  # golden
MOST_SWEPT = 0.6  # rad, of all joints together: beyond it the levers change too much for a bound to be of use
DEPTHS = 34  # of halving a way of up to 2**31 places, and one more
STEPS = 22  # of the search along a segment: 2.5e-5 of its length is left


class BoundingVolumes(NamedTuple):
    """A robot's axes at zero, e external axes from the base outwards, and S shapes in volumes; pairs to look at.

    Volumes are capsules, and solids within some of them, where they are at zero: in the base, or the frame of the
    external axis that carries them. Joint angles are those of the robot and the values of the external axes behind
    them.
    """

    axes: Shaped[AnyArray, "6 3"]  # unit
    points_mm: Shaped[AnyArray, "6 3"]  # on them
    frames: Shaped[AnyArray, "e 4 4"]  # of each external axis at 0, in what carries it
    slides: Shaped[AnyArray, " e"]  # whether it is a track's floor
    link: Shaped[AnyArray, " S"]  # as in `Shape`, the fixed ones 0
    solid: Shaped[AnyArray, " S"]  # a box, a cylinder, or none: a capsule alone
    ends_mm: Shaped[AnyArray, "S 2 3"]  # of capsules
    radius_mm: Shaped[AnyArray, " S"]
    pose: Shaped[AnyArray, "S 4 4"]  # of solids
    half_mm: Shaped[AnyArray, "S 3"]  # their half lengths
    around_mm: Shaped[AnyArray, " S"]  # radius of the sphere around each
    pairs: Shaped[AnyArray, "P 2"]


class Standing(NamedTuple):
    """The S volumes where their links carry them."""

    at: Shaped[AnyArray, "S 2 3"]  # ends of capsules
    placed: Shaped[AnyArray, "S 3 4"]  # poses of solids
    middle: Shaped[AnyArray, "S 3"]  # of both


@kernel(error_model="numpy")
def _place(standing: Standing, motion: AnyArray, scene: BoundingVolumes, arm_only: bool) -> None:
    """Every volume where its link carries it; `arm_only`: those of base and turntable stay where they are."""
    at, placed, middle = standing
    link, solid, ends, pose = scene.link, scene.solid, scene.ends_mm, scene.pose
    for s in range(len(link)):
        if arm_only and not 1 <= link[s] <= 6:
            continue
        _carry(at, middle, s, motion, link[s], ends)
        if solid[s] != NONE:
            compose(placed, s, motion, link[s], pose, s)
        if solid[s] == BOX:
            for r in range(3):
                middle[s, r] = placed[s, r, 3]


@kernel(error_model="numpy")
def _room(scene: BoundingVolumes) -> tuple[AnyArray, AnyArray, Standing]:
    """Room for motions of links, for turns of joints and external axes, and for what `_place` places."""
    count, e = len(scene.link), len(scene.slides)
    motion, turn = np.zeros((7 + e, 3, 4)), np.zeros((7 + 2 * e, 3, 4))
    for k in range(e):
        turn[6 + e + k] = scene.frames[k, :3]
    return motion, turn, Standing(np.empty((count, 2, 3)), np.empty((count, 3, 4)), np.empty((count, 3)))


@kernel(error_model="numpy")
def bound_kernel(scene: BoundingVolumes, joints: AnyArray, most: float) -> AnyArray:
    """See `clearance_bound_mm`; `most` is enough to know."""
    found = np.empty(len(joints))
    motion, turn, standing = _room(scene)
    # Taken out of the scene once: in the loop that would be counted for every posture.
    axes, points = scene.axes, scene.points_mm
    for n in range(len(joints)):
        _move(motion, turn, axes, points, joints, scene.slides, n)
        _place(standing, motion, scene, False)
        found[n] = _smallest(standing, scene, 0, len(scene.pairs), most)
    return found


@kernel(error_model="numpy")
def pairs_kernel(scene: BoundingVolumes, joints: AnyArray, most: AnyArray) -> tuple[AnyArray, AnyArray]:
    """A lower bound of the distance of each pair (n, P), or `most` (P,), and the middles of the volumes (n, S, 3)."""
    found, middles = np.zeros((len(joints), len(scene.pairs))), np.zeros((len(joints), len(scene.link), 3))
    motion, turn, standing = _room(scene)
    axes, points = scene.axes, scene.points_mm
    for n in range(len(joints)):
        _move(motion, turn, axes, points, joints, scene.slides, n)
        _place(standing, motion, scene, False)
        middles[n] = standing.middle
        for i in range(len(scene.pairs)):
            found[n, i] = _smallest(standing, scene, i, i + 1, most[i])
    return found, middles


@kernel(error_model="numpy")
def swept_kernel(
    scene: BoundingVolumes, joints: AnyArray, carried: AnyArray, moves: AnyArray, by: AnyArray, least: AnyArray
) -> AnyArray:
    """Which places (c, s) of ways (c, s, 6 + e) stay open (`CollisionScreen.swept`); what is not proven is halved.

    Joints `moves` (w, 6) move volumes `carried` (w,); pair i comes nearer by motion `by[i]` of these. A pair that is
    proven on a stretch is on its halves: these begin with the pair that was not, and ask about those behind it.
    Pairs must keep `least` (P,) apart besides.
    """
    count, places = len(joints), joints.shape[1]
    found = np.zeros((count, places), np.bool_)
    motion, turn, standing = _room(scene)
    axes, points = scene.axes, scene.points_mm
    many_axes = joints.shape[2]
    step, reach, lever = np.zeros((places, many_axes)), np.zeros(many_axes), np.zeros((many_axes, 2, 3))
    first, last, depth = np.zeros(64, np.int64), np.zeros(64, np.int64), np.zeros(64, np.int64)
    asked, many = np.empty((DEPTHS, len(scene.pairs)), np.int64), np.zeros(DEPTHS, np.int64)
    asked[0], many[0] = np.arange(len(scene.pairs)), len(scene.pairs)
    need, external_mm = np.empty(len(carried)), np.zeros(len(scene.link))
    for n in range(count):
        _steps(joints, n, step)
        stands, external_mm[:] = True, 0.0
        for j in range(6, many_axes):
            stands &= joints[n, :, j].max() == joints[n, :, j].min()
        _move(motion, turn, axes, points, joints[n], scene.slides, 0)
        _place(standing, motion, scene, False)
        first[0], last[0], depth[0], waiting = 0, places - 1, 0, 1
        while waiting > 0:
            waiting -= 1
            a, b, d = first[waiting], last[waiting], depth[waiting]
            m = (a + b) // 2
            total, proven = _reach(joints, n, a, b, m, step, reach), 0
            total -= reach[6:][scene.slides].sum()  # which changes no lever
            if total < MOST_SWEPT:
                _move(motion, turn, axes, points, joints[n], scene.slides, m)
                _place(standing, motion, scene, stands)
                _axes_there(motion, axes, points, lever)
                for w in range(len(carried)):
                    moved = _moved(carried[w], moves, w, lever, reach, standing.middle, scene.around_mm)
                    need[w] = moved / (1.0 - total)
                if not stands:
                    _external_motion(lever, scene, standing.middle, reach, 1.0 / (1.0 - total), external_mm)
                proven = _proven(standing, scene, need, by, least, external_mm, asked[d], many[d])
            left = many[d] - proven
            if left > 0 and a == b:
                found[n, a] = True
            elif left > 0:
                for k in range(left):
                    asked[d + 1, k] = asked[d, proven + k]
                many[d + 1] = left
                first[waiting], last[waiting], depth[waiting] = a, m, d + 1
                first[waiting + 1], last[waiting + 1], depth[waiting + 1] = m + 1, b, d + 1
                waiting += 2
    return found


@kernel(error_model="numpy")
def _proven(
    standing: Standing,
    scene: BoundingVolumes,
    need: AnyArray,
    by: AnyArray,
    least: AnyArray,
    external_mm: AnyArray,
    asked: AnyArray,
    many: int,
) -> int:
    """How many pairs of `asked[:many]` are farther apart than they need to be, before the first that may not be.

    What stands on external axes moves by `external_mm` (S,) mm besides.
    """
    pairs, around = scene.pairs, scene.around_mm
    for k in range(many):
        i = asked[k]
        s, t = pairs[i, 0], pairs[i, 1]
        apart = least[i] + need[by[i]] + external_mm[s] + external_mm[t]
        far = apart + 1e-6
        near = _nearer(standing.middle, s, t, far + around[s] + around[t])
        if near and _smallest(standing, scene, i, i + 1, far) <= apart:
            return k
    return many


@kernel(error_model="numpy")
def _external_motion(
    lever: AnyArray, scene: BoundingVolumes, middle: AnyArray, reach: AnyArray, slack: float, external_mm: AnyArray
) -> None:
    """What each volume (S,) on external axes moves by within their reaches, at most, mm, times `slack`."""
    e = len(scene.slides)
    for s in range(len(scene.link)):
        external_mm[s] = 0.0
        for k in range(e):
            carrier = 6 + e - k
            if scene.link[s] < 7 or scene.link[s] > carrier:
                continue
            if scene.slides[k]:
                external_mm[s] += reach[6 + k] / DEG * slack
                continue
            external_mm[s] += reach[6 + k] * (_off_axis(middle, s, lever, 6 + k) + scene.around_mm[s]) * slack


@kernel(error_model="numpy")
def _steps(joints: AnyArray, n: int, step: AnyArray) -> None:
    """How far each joint goes (s, 6 + e) from each place halfway to its neighbours, with what it bulges out in between.

    A parabola through three places lies off their chords by an eighth of the second difference; a quarter is taken.
    """
    places = joints.shape[1]
    for k in range(places):
        for j in range(joints.shape[2]):
            most = 0.0
            if k > 0:
                most = abs(joints[n, k, j] - joints[n, k - 1, j])
            if k + 1 < places:
                most = max(most, abs(joints[n, k + 1, j] - joints[n, k, j]))
            bulge = 0.0
            for i in range(max(k - 1, 1), min(k + 2, places - 1)):
                bulge = max(bulge, abs(joints[n, i - 1, j] - 2.0 * joints[n, i, j] + joints[n, i + 1, j]))
            step[k, j] = most / 2 + bulge / 4


@kernel(error_model="numpy")
def _reach(joints: AnyArray, n: int, a: int, b: int, m: int, step: AnyArray, reach: AnyArray) -> float:
    """How far each joint goes from place m between half a step before place a and half a step behind b; their sum."""
    total = 0.0
    for j in range(len(reach)):
        far = 0.0
        for k in range(a, b + 1):
            far = max(far, abs(joints[n, k, j] - joints[n, m, j]) + step[k, j])
        reach[j] = far
        total += far
    return total


@kernel(error_model="numpy")
def _axes_there(motion: AnyArray, axes: AnyArray, points: AnyArray, lever: AnyArray) -> None:
    """Direction and a point (6 + e, 2, 3) of each axis where what carries it stands."""
    for j in range(6):
        for r in range(3):
            lever[j, 0, r], lever[j, 1, r] = 0.0, motion[j, r, 3]
            for c in range(3):
                lever[j, 0, r] += motion[j, r, c] * axes[j, c]
                lever[j, 1, r] += motion[j, r, c] * points[j, c]
    for k in range(6, len(lever)):
        carrier = len(lever) - k + 6
        for r in range(3):
            lever[k, 0, r], lever[k, 1, r] = motion[carrier, r, 2], motion[carrier, r, 3]


@kernel(error_model="numpy")
def _off_axis(middle: AnyArray, s: int, lever: AnyArray, j: int) -> float:
    """How far the middle of volume s is from axis j."""
    x, y, z = middle[s, 0] - lever[j, 1, 0], middle[s, 1] - lever[j, 1, 1], middle[s, 2] - lever[j, 1, 2]
    u, v, w = lever[j, 0, 0], lever[j, 0, 1], lever[j, 0, 2]
    cx, cy, cz = v * z - w * y, w * x - u * z, u * y - v * x
    return np.sqrt(cx * cx + cy * cy + cz * cz)  # type: ignore[no-any-return]


@kernel(error_model="numpy")
def _moved(
    s: int, moves: AnyArray, i: int, lever: AnyArray, reach: AnyArray, middle: AnyArray, around: AnyArray
) -> float:
    """What the joints between the bodies of pair i move volume s by, at most, with the levers as they are."""
    way = 0.0
    for j in range(6):
        if moves[i, j]:
            way += reach[j] * (_off_axis(middle, s, lever, j) + around[s])
    return way


@kernel(error_model="numpy")
def _nearer(middle: AnyArray, s: int, t: int, reach: float) -> bool:
    """Whether the middles of two volumes are nearer to each other than a reach."""
    x, y, z = middle[s, 0] - middle[t, 0], middle[s, 1] - middle[t, 1], middle[s, 2] - middle[t, 2]
    return x * x + y * y + z * z < reach * reach  # type: ignore[no-any-return]


@kernel(error_model="numpy")
def _smallest(
    standing: Standing,
    scene: BoundingVolumes,
    first: int,
    last: int,
    best: float,
) -> float:
    """The smallest distance of pairs [first, last) below `best`, or one of 0 or less; what is farther is left out."""
    at, placed, middle = standing
    radius, half, around, solid, pairs = scene.radius_mm, scene.half_mm, scene.around_mm, scene.solid, scene.pairs
    for i in range(first, last):
        a, b = pairs[i, 0], pairs[i, 1]
        if not _nearer(middle, a, b, best + around[a] + around[b]):
            continue
        fits = solid[b] == NONE or solid[a] == BOX or radius[a] > radius[b]  # as the capsule around it, of two solids
        larger = solid[a] == BOX and around[a] > around[b]  # of two boxes the smaller is the capsule around it
        if larger if solid[b] == BOX else solid[a] != NONE and fits:
            a, b = b, a
        if solid[b] != BOX:
            apart = segments_apart(at, a, at, b) - radius[a] - radius[b]
            if solid[b] == NONE or apart >= best:
                best = min(best, apart)
                if best <= 0.0:
                    break
                continue
        if _beyond_a_face(at, a, placed, half, b) - radius[a] < best:
            best = min(best, _to_solid(at, a, placed, half, b, solid[b] == CYLINDER) - radius[a])
        if best <= 0.0:
            break
    return best


@kernel(error_model="numpy")
def _move(
    motion: AnyArray,
    turn: AnyArray,
    axes: AnyArray,
    points: AnyArray,
    joints: AnyArray,
    slides: AnyArray,
    n: int,
) -> None:
    """Motions of base, six links and what external axes carry: one turn after the other about the axes at zero."""
    for r in range(3):
        motion[0, r, r] = 1.0
    e = len(slides)
    for i in range(6 + e):
        if i < 6:
            turn_about_axis(turn, i, axes, points, i, joints[n, i])
            compose(motion, i + 1, motion, i, turn, i)
            continue
        angle = 0.0 if slides[i - 6] else joints[n, i]
        c, s = np.cos(angle), np.sin(angle)
        turn[i, 0, 0], turn[i, 0, 1], turn[i, 1, 0], turn[i, 1, 1], turn[i, 2, 2] = c, -s, s, c, 1.0
        turn[i, 2, 3] = joints[n, i] / DEG if slides[i - 6] else 0.0
        carrier = 6 + e - (i - 6)
        compose(turn, 6 + 2 * e, motion, 0 if i == 6 else carrier + 1, turn, e + i)
        compose(motion, carrier, turn, 6 + 2 * e, turn, i)


@kernel(error_model="numpy")
def _carry(at: AnyArray, middle: AnyArray, s: int, motion: AnyArray, link: int, ends: AnyArray) -> None:
    """Ends and middle of a capsule where its link took it."""
    for r in range(3):
        m0, m1, m2, m3 = motion[link, r, 0], motion[link, r, 1], motion[link, r, 2], motion[link, r, 3]
        at[s, 0, r] = m0 * ends[s, 0, 0] + m1 * ends[s, 0, 1] + m2 * ends[s, 0, 2] + m3
        at[s, 1, r] = m0 * ends[s, 1, 0] + m1 * ends[s, 1, 1] + m2 * ends[s, 1, 2] + m3
        middle[s, r] = (at[s, 0, r] + at[s, 1, r]) / 2


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
