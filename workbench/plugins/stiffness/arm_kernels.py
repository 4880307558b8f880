"""The compiled kernels of `workbench.plugins.stiffness.arm`; everything in the arm frame, mm, N, N mm/rad."""

from __future__ import annotations

from typing import NamedTuple, TypeAlias

import numpy as np

from workbench.api import AnyArray, kernel

FREE, SINGULAR, LIMIT, UNREACHABLE = map(float, range(4))  # as `arm` counts them
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


class PerRotation(NamedTuple):
    """Of each of t rotations of the cutter."""

    total: AnyArray  # displacements of the points so far
    worst: AnyArray  # what is said of them
    flipped: AnyArray  # likewise, the wrist flipped


@kernel(error_model="numpy")
def traverse_kernel(
    branch: Branch, path: ArmPath, cosine: AnyArray, sine: AnyArray
) -> tuple[AnyArray, AnyArray, AnyArray]:
    """In the arm frame. The innermost loop runs over the cutter's rotations, several side by side."""
    tables, points, steps = path.at.shape[0], path.at.shape[1], len(cosine)
    total, worst, flipped = np.zeros((tables, steps)), np.zeros((tables, steps)), np.zeros((tables, steps))
    for i in range(tables):
        found = PerRotation(total[i], worst[i], flipped[i])
        for j in range(points):
            _turn_cutter(branch, path, i, j, cosine, sine, found)
    return total / points, worst.astype(np.uint8), flipped.astype(np.uint8)


@kernel(error_model="numpy", fastmath={"contract", "nsz", "arcp"})
def _turn_cutter(
    branch: Branch, path: ArmPath, i: int, j: int, cosine: AnyArray, sine: AnyArray, found: PerRotation
) -> None:
    """Add the displacements of one path point at all rotations t of the cutter: R Rz(t) v = c + cos t a + sin t b."""
    (vx, vy, vz), (ux, uy, uz) = path.wrist, path.axis
    r, p, load, force = path.turn[i, j], path.at[i, j], path.load[i, j], path.force[i, j]
    total, worst, flipped = found
    r00, r01, r02 = r[0, 0], r[0, 1], r[0, 2]
    r10, r11, r12 = r[1, 0], r[1, 1], r[1, 2]
    r20, r21, r22 = r[2, 0], r[2, 1], r[2, 2]
    cx, cy, cz = p[0] + r02 * vz, p[1] + r12 * vz, p[2] + r22 * vz
    ax, ay, az = r00 * vx + r01 * vy, r10 * vx + r11 * vy, r20 * vx + r21 * vy
    bx, by, bz = r01 * vx - r00 * vy, r11 * vx - r10 * vy, r21 * vx - r20 * vy
    dx, dy, dz = r02 * uz, r12 * uz, r22 * uz
    ex, ey, ez = r00 * ux + r01 * uy, r10 * ux + r11 * uy, r20 * ux + r21 * uy
    gx, gy, gz = r01 * ux - r00 * uy, r11 * ux - r10 * uy, r21 * ux - r20 * uy
    at, acts = (load[0], load[1], load[2]), (force[0], force[1], force[2])
    for t in range(len(cosine)):
        c, s = cosine[t], sine[t]
        wrist = cx + c * ax + s * bx, cy + c * ay + s * by, cz + c * az + s * bz
        axis = dx + c * ex + s * gx, dy + c * ey + s * gy, dz + c * ez + s * gz
        moved, said, other = posture(branch, wrist, axis, at, acts)
        total[t] += moved
        worst[t], flipped[t] = max(worst[t], said), max(flipped[t], other)


@kernel(error_model="numpy")
def joints_kernel(
    branch: Branch, bend: float, flip: float, w: AnyArray, a: AnyArray, b: AnyArray, found: AnyArray
) -> None:
    """Joint angles (n, 6) as `posture` has their cosines; b: joint 5's axis as joint 6 would carry it along."""
    sense3, sense5 = branch.lengths[9], branch.lengths[10]
    for n in range(w.shape[1]):
        ax, ay, az = a[0, n], a[1, n], a[2, n]
        first, second, both, _, (hx, hy, hz), _, _ = _arm(branch, (w[0, n], w[1, n], w[2, n]))
        (c1, s1), (c2, s2), (c23, s23) = first, second, both
        gx, gy, gz = flip * (hy * az - hz * ay), flip * (hz * ax - hx * az), flip * (hx * ay - hy * ax)
        bent = flip * np.sqrt(gx * gx + gy * gy + gz * gz)
        across = sense5 * (gy * c1 - gx * s1)
        up = sense5 * (hx * c1 * gz + hy * s1 * gz - hz * (c1 * gx + s1 * gy))
        bx, by, bz = b[0, n], b[1, n], b[2, n]
        over = ax * (gy * bz - gz * by) + ay * (gz * bx - gx * bz) + az * (gx * by - gy * bx)
        found[n, 0], found[n, 1] = np.arctan2(s1, c1), np.arctan2(s2, c2)
        found[n, 2] = np.arctan2(sense3 * (s23 * c2 - c23 * s2), c23 * c2 + s23 * s2)
        found[n, 3] = np.arctan2(up, across)
        found[n, 4] = (np.arctan2(bent, hx * ax + hy * ay + hz * az) - bend + np.pi) % (2 * np.pi) - np.pi
        found[n, 5] = np.arctan2(over, gx * bx + gy * by + gz * bz)


@kernel(error_model="numpy", fastmath={"contract", "nsz", "arcp"}, inline="always")
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


@kernel(error_model="numpy", fastmath={"contract", "nsz", "arcp"}, inline="always")
def posture(branch: Branch, wrist: Vector, axis: Vector, at: Vector, acts: Vector) -> tuple[float, float, float]:
    """Displacement of one posture and what is said of it and of the one with its wrist flipped.

    Without a jump, so that several run side by side once inlined. Given are the wrist's centre, joint 6's axis, and the
    force with the point that it acts at.
    """
    a1, z2, sense3, sense5 = branch.lengths[0], branch.lengths[1], branch.lengths[9], branch.lengths[10]
    limits, k = branch.limits, branch.springs
    (wx, wy, wz), (ax, ay, az), (px, py, pz), (fx, fy, fz) = wrist, axis, at, acts
    first, second, both, (er, ei), (hx, hy, hz), (x2, height2), free = _arm(branch, wrist)
    (c1, s1), (c2, s2), (c23, s23) = first, second, both
    c3, s3 = c23 * c2 + s23 * s2, sense3 * (s23 * c2 - c23 * s2)
    # Axis 5 across 4 and 6.
    gx, gy, gz = hy * az - hz * ay, hz * ax - hx * az, hx * ay - hy * ax
    bent2 = gx * gx + gy * gy + gz * gz
    bent = np.sqrt(bent2)
    safe = max(bent2, 1e-300)
    c5 = hx * ax + hy * ay + hz * az
    across = sense5 * (gy * c1 - gx * s1)  # |sin q5| cos q4: axis 5 against axis 2, which is (-s1, c1, 0)
    up = sense5 * (hx * c1 * gz + hy * s1 * gz - hz * (c1 * gx + s1 * gy))
    # Displacement: each joint's arm t, times its torque over its stiffness.
    lx, ly, lz = px - wx, py - wy, pz - wz
    q = (fy * px - fx * py) / k[0]
    dx, dy, dz = -py * q, px * q, 0.0
    reach = c1 * px + s1 * py
    out = c1 * fx + s1 * fy
    r2, v2 = reach - a1, pz - z2
    r3, v3 = r2 - ei, v2 - er
    q2, q3 = (v2 * out - r2 * fz) / k[1], (v3 * out - r3 * fz) / k[2]
    planar = v2 * q2 + v3 * q3
    dx, dy, dz = dx + c1 * planar, dy + s1 * planar, dz - r2 * q2 - r3 * q3
    tx, ty, tz = hy * lz - hz * ly, hz * lx - hx * lz, hx * ly - hy * lx
    q = (tx * fx + ty * fy + tz * fz) / k[3]
    dx, dy, dz = dx + tx * q, dy + ty * q, dz + tz * q
    tx, ty, tz = gy * lz - gz * ly, gz * lx - gx * lz, gx * ly - gy * lx
    q = (tx * fx + ty * fy + tz * fz) / (k[4] * safe)
    dx, dy, dz = dx + tx * q, dy + ty * q, dz + tz * q
    tx, ty, tz = ay * lz - az * ly, az * lx - ax * lz, ax * ly - ay * lx
    q = (tx * fx + ty * fy + tz * fz) / k[5]
    dx, dy, dz = dx + tx * q, dy + ty * q, dz + tz * q
    # Verdict.
    inside = (
        (c1 * limits[0] + s1 * limits[1] >= limits[2])
        & (c2 * limits[3] + s2 * limits[4] >= limits[5])
        & (c3 * limits[6] + s3 * limits[7] >= limits[8])
    )
    turned = across * limits[9] + up * limits[10]
    straight, sideways = c5 * limits[12], bent * limits[13]
    kept = (turned >= limits[11] * bent) & (straight + sideways >= limits[14])
    flipped = (-turned >= limits[11] * bent) & (straight - sideways >= limits[14])
    missed, singular = (x2 < 0.0) | (height2 < 0.0), (bent < 1e-6) | free
    said = UNREACHABLE if missed else (SINGULAR if singular else (FREE if inside & kept else LIMIT))
    other = UNREACHABLE if missed else (SINGULAR if singular else (FREE if inside & flipped else LIMIT))
    return np.sqrt(dx * dx + dy * dy + dz * dz), said, other
