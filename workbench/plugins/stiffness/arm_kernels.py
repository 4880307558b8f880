"""The compiled kernels of `workbench.plugins.stiffness.arm`; everything in the arm frame, mm, N, N mm/rad."""

from __future__ import annotations

from typing import Any, NamedTuple, TypeAlias

import numpy as np

from workbench.api import AnyArray, kernel

FREE, SINGULAR, LIMIT, UNREACHABLE = map(float, range(4))  # as `arm` counts them
FAST: Any = {"error_model": "numpy", "fastmath": {"contract", "nsz", "arcp"}}
NOWHERE = 1e-12  # mm^2, of the wrist's centre from axis 2: nearer, nothing tells where the elbow is


Vector: TypeAlias = tuple[float, float, float]
Pair: TypeAlias = tuple[float, float]


class Branch(NamedTuple):
    """An arm in one of its branches."""

    lengths: tuple[float, ...]  # 11, mm: see `posture`
    limits: tuple[float, ...]  # 15: cosine and sine of the middle, cosine of half the span, of joints 1 to 5
    springs: tuple[float, ...]  # 6, N mm/rad
    front: float  # 1: the arm reaches forward, -1: over its back
    side: float  # of the elbow, 1 or -1


class ArmPath(NamedTuple):
    """Where the cutter stands at p path points for each of a turntable angles, and what pushes it there."""

    turn: AnyArray  # (a, p, 3, 3), at rotation 0
    at: AnyArray  # (a, p, 3)
    load: AnyArray  # (a, p, 3), where the force acts
    force: AnyArray  # (a, p, 3)
    wrist: Vector  # its centre in the cutter's frame
    axis: Vector  # of joint 6, likewise


@kernel(error_model="numpy")
def traverse_kernel(
    branch: Branch, path: ArmPath, cosine: AnyArray, sine: AnyArray
) -> tuple[AnyArray, AnyArray, AnyArray]:
    """In the arm frame. The innermost loop runs over the cutter's rotations, several side by side."""
    tables, points, steps = path.at.shape[0], path.at.shape[1], len(cosine)
    total, worst, flipped = np.zeros((tables, steps)), np.zeros((tables, steps)), np.zeros((tables, steps))
    for i in range(tables):
        found = total[i], worst[i], flipped[i]
        for j in range(points):
            _turn_cutter(branch, path, i, j, cosine, sine, found)
    return total / points, worst.astype(np.uint8), flipped.astype(np.uint8)


@kernel(**FAST)
def _turn_cutter(
    branch: Branch,
    path: ArmPath,
    i: int,
    j: int,
    cosine: AnyArray,
    sine: AnyArray,
    found: tuple[AnyArray, AnyArray, AnyArray],
) -> None:
    """Add the displacements of one path point at all rotations t of the cutter, and the worst that is said so far."""
    total, worst, flipped = found
    p, load, force = path.at[i, j], path.load[i, j], path.force[i, j]
    (cx, cy, cz), (ax, ay, az), (bx, by, bz) = _round_z(path.turn[i, j], path.wrist)
    (dx, dy, dz), (ex, ey, ez), (gx, gy, gz) = _round_z(path.turn[i, j], path.axis)
    cx, cy, cz = cx + p[0], cy + p[1], cz + p[2]
    at, acts = (load[0], load[1], load[2]), (force[0], force[1], force[2])
    for t in range(len(cosine)):
        c, s = cosine[t], sine[t]
        wrist = cx + c * ax + s * bx, cy + c * ay + s * by, cz + c * az + s * bz
        axis = dx + c * ex + s * gx, dy + c * ey + s * gy, dz + c * ez + s * gz
        moved, said, other = posture(branch, wrist, axis, at, acts)
        total[t] += moved
        worst[t], flipped[t] = max(worst[t], said), max(flipped[t], other)


@kernel(inline="always", **FAST)
def _round_z(r: AnyArray, v: Vector) -> tuple[Vector, Vector, Vector]:
    """What R Rz(t) v is made of: c + cos t a + sin t b."""
    x, y, z = v
    c = r[0, 2] * z, r[1, 2] * z, r[2, 2] * z
    a = r[0, 0] * x + r[0, 1] * y, r[1, 0] * x + r[1, 1] * y, r[2, 0] * x + r[2, 1] * y
    return c, a, (r[0, 1] * x - r[0, 0] * y, r[1, 1] * x - r[1, 0] * y, r[2, 1] * x - r[2, 0] * y)


@kernel(inline="always", **FAST)
def _dot(a: Vector, b: Vector) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@kernel(inline="always", **FAST)
def _cross(a: Vector, b: Vector) -> Vector:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@kernel(inline="always", **FAST)
def _across(branch: Branch, first: Pair, h: Vector, axis: Vector) -> tuple[Vector, float, float]:
    """Axis 5 across 4 and 6, as long as the wrist is bent; of that along axis 2, and up: cosine and sine of q4."""
    (c1, s1), (hx, hy, hz) = first, h
    gx, gy, gz = _cross(h, axis)
    along = branch.lengths[10] * (gy * c1 - gx * s1)  # axis 2 is (-s1, c1, 0)
    up = branch.lengths[10] * (hx * c1 * gz + hy * s1 * gz - hz * (c1 * gx + s1 * gy))
    return (gx, gy, gz), along, up


@kernel(inline="always", **FAST)
def _with_joint(moved: Vector, axis: Vector, lever: Vector, acts: Vector, spring: float) -> Vector:
    """A displacement, and what a joint adds that gives way about its axis."""
    x, y, z = _cross(axis, lever)
    q = _dot((x, y, z), acts) / spring
    return moved[0] + x * q, moved[1] + y * q, moved[2] + z * q


@kernel(error_model="numpy")
def joints_kernel(
    branch: Branch, bend: float, flip: float, w: AnyArray, a: AnyArray, b: AnyArray, found: AnyArray
) -> None:
    """Joint angles (n, 6) as `posture` has their cosines; b: joint 5's axis as joint 6 would carry it along."""
    for n in range(len(w)):
        axis, carried = (a[n, 0], a[n, 1], a[n, 2]), (b[n, 0], b[n, 1], b[n, 2])
        first, second, both, _, h, _, _ = _arm(branch, (w[n, 0], w[n, 1], w[n, 2]))
        (c1, s1), (c2, s2), (c23, s23) = first, second, both
        g, across, up = _across(branch, first, h, axis)
        found[n, 0], found[n, 1] = np.arctan2(s1, c1), np.arctan2(s2, c2)
        found[n, 2] = np.arctan2(branch.lengths[9] * (s23 * c2 - c23 * s2), c23 * c2 + s23 * s2)
        found[n, 3] = np.arctan2(flip * up, flip * across)
        bent = np.arctan2(flip * np.sqrt(_dot(g, g)), _dot(h, axis))
        found[n, 4] = (bent - bend + np.pi) % (2 * np.pi) - np.pi
        found[n, 5] = np.arctan2(flip * _dot(axis, _cross(g, carried)), flip * _dot(g, carried))


@kernel(inline="always", **FAST)
def _arm(branch: Branch, wrist: Vector) -> tuple[Pair, Pair, Pair, Pair, Vector, Pair, bool]:
    """Cosine and sine of joints 1, 2, 2 and 3 together; the elbow; axis 4; what is below 0 where nothing reaches.

    And whether the wrist's centre lies on axis 1 or 2, where a joint is free.
    """
    a1, z2, d, ur, ui, fr, fi, gr, gi, _, _ = branch.lengths
    wx, wy, wz = wrist
    # Joint 1: the wrist's centre at (x, d) in the arm's plane, turned to (wx, wy).
    flat = wx * wx + wy * wy
    x2 = flat - d * d
    x = branch.front * np.sqrt(max(x2, 0.0))
    on_axis = flat == 0.0  # joint 1 is free there: 0, as the inverse has it
    c1, s1 = (1.0, 0.0) if on_axis else ((wx * x + wy * d) / flat, (wy * x - wx * d) / flat)
    # Joints 2 and 3: the triangle upper arm, forearm, distance; its elbow e on one side of the line.
    tr, ti = wz - z2, x - a1
    far, l2, l3 = max(tr * tr + ti * ti, NOWHERE), ur * ur + ui * ui, fr * fr + fi * fi
    along = (far + l2 - l3) / (2 * far)
    height2 = l2 / far - along * along
    height = branch.side * np.sqrt(max(height2, 0.0))
    er, ei = along * tr - height * ti, along * ti + height * tr
    mr, mi = tr - er, ti - ei
    second = (er * ur + ei * ui) / l2, (ei * ur - er * ui) / l2
    both = (mr * fr + mi * fi) / l3, (mi * fr - mr * fi) / l3
    # Axis 4 along the forearm.
    hr, hi = mr * gr - mi * gi, mr * gi + mi * gr
    return (c1, s1), second, both, (er, ei), (c1 * hi, s1 * hi, hr), (x2, height2), on_axis | (far == NOWHERE)


@kernel(inline="always", **FAST)
def posture(branch: Branch, wrist: Vector, axis: Vector, at: Vector, acts: Vector) -> tuple[float, float, float]:
    """Displacement of one posture and what is said of it and of the one with its wrist flipped.

    Without a jump, so that several run side by side once inlined. Given are the wrist's centre, joint 6's axis, and the
    force with the point that it acts at.
    """
    a1, z2, limits, k = branch.lengths[0], branch.lengths[1], branch.limits, branch.springs
    (wx, wy, wz), (px, py, pz), (fx, fy, fz) = wrist, at, acts
    first, second, both, (er, ei), h, (x2, height2), free = _arm(branch, wrist)
    (c1, s1), (c2, s2), (c23, s23) = first, second, both
    c3, s3 = c23 * c2 + s23 * s2, branch.lengths[9] * (s23 * c2 - c23 * s2)
    g, across, up = _across(branch, first, h, axis)
    bent2, c5 = _dot(g, g), _dot(h, axis)
    bent = np.sqrt(bent2)
    # Displacement: each joint's arm, times its torque over its stiffness.
    q = (fy * px - fx * py) / k[0]
    reach, out = c1 * px + s1 * py, c1 * fx + s1 * fy
    r2, v2 = reach - a1, pz - z2
    r3, v3 = r2 - ei, v2 - er
    q2, q3 = (v2 * out - r2 * fz) / k[1], (v3 * out - r3 * fz) / k[2]
    planar = v2 * q2 + v3 * q3
    moved, lever = (c1 * planar - py * q, s1 * planar + px * q, -r2 * q2 - r3 * q3), (px - wx, py - wy, pz - wz)
    moved = _with_joint(moved, h, lever, acts, k[3])
    moved = _with_joint(moved, g, lever, acts, k[4] * max(bent2, 1e-300))
    moved = _with_joint(moved, axis, lever, acts, k[5])
    # Verdict.
    inside = (
        (c1 * limits[0] + s1 * limits[1] >= limits[2])
        & (c2 * limits[3] + s2 * limits[4] >= limits[5])
        & (c3 * limits[6] + s3 * limits[7] >= limits[8])
    )
    roll = across * limits[9] + up * limits[10]
    straight, sideways = c5 * limits[12], bent * limits[13]
    kept = (roll >= limits[11] * bent) & (straight + sideways >= limits[14])
    flipped = (-roll >= limits[11] * bent) & (straight - sideways >= limits[14])
    missed, singular = (x2 < 0.0) | (height2 < 0.0), (bent < 1e-6) | free
    said = UNREACHABLE if missed else (SINGULAR if singular else (FREE if inside & kept else LIMIT))
    other = UNREACHABLE if missed else (SINGULAR if singular else (FREE if inside & flipped else LIMIT))
    return np.sqrt(_dot(moved, moved)), said, other
