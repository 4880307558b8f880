"""A robot's wrist: whether it leaves the inverse a closed form, how the arm stands there, which postures put it where.

In closed form where axes 4, 5, 6 go through one point, which the first three move everywhere.

ABB's `cfx`, KUKA's STATUS and FANUC's configuration string say the same three things: whether the wrist's centre is
behind axis 1, whether it is below the line of the upper arm (the elbow is down), and whether the wrist is flipped.
Here they follow from the geometry, so that neither zeros nor senses of a maker's joints matter.

Where the first three joints put the wrist's centre is solved backwards, for parallel axes 2 and 3 in closed form, by
subproblems after Paden and Kahan (Murray, Li, Sastry 1994, section 3.3): shoulder from the wrist centre's distance
along axis 2, elbow by the law of cosines. Lengths there in m.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from workbench.errors import InputError
from workbench.geometry.moves import chords_mm
from workbench.geometry.poses import mapped
from workbench.kernels import kernel
from workbench.robot.kinematics import Chain, jacobian_at, joint_axes, motions, turn_about_axis
from workbench.units import AnyArray, Bool, Float, Shaped

PARALLEL = 1e-9  # sine of an angle that still counts as zero
MEETING_MM = 1e-4  # distance at which lines still count as meeting
NEARLY = 0.01  # sine of an angle between axes 2 and 3 that Newton's steps take away
ROUNDING = 1e-14  # parts of the largest coefficient
Side = Literal["front", "back", "elbow_up", "elbow_down", "unflipped", "flipped"]
SIDES = tuple(zip(get_args(Side)[::2], get_args(Side)[1::2], strict=True))  # what `arm_sides` calls false and true
SINGULAR = 1e-13  # distance from an axis in m, and sine, below which an angle is free and set to 0


@dataclass(frozen=True, slots=True, eq=False)
class SphericalWrist:
    """Where the wrist's three axes meet, all joints at zero."""

    centre_mm: Shaped[Float, " 3"]  # in the base
    parallel_axes: bool  # 2 and 3, exactly
    square: bool  # axis 5 at right angles to axes 4 and 6


@dataclass(frozen=True, slots=True, eq=False)
class OffsetWrist:
    """A wrist whose axes 4 and 6 meet axis 5 in two points, all joints at zero, in the base."""

    on_4_mm: Shaped[Float, " 3"]  # where axes 4 and 5 meet
    on_6_mm: Shaped[Float, " 3"]  # where axes 5 and 6 meet
    offset_mm: float  # from the one to the other, along axis 5


def offset_wrist(chain: Chain) -> OffsetWrist | None:
    """The robot's wrist, if it is offset along axis 5 behind parallel axes 2 and 3 (UR, CRX); None: it is not."""
    h, o = chain.axes, chain.points_mm
    square = min(_sine(h[3], h[4]), _sine(h[4], h[5])) > PARALLEL
    if not square or _sine(h[1], h[2]) >= PARALLEL or _sine(h[0], h[1]) < PARALLEL:
        return None
    (on_4, miss_4), (on_6, miss_6) = (meeting_point(h[i : i + 2], o[i : i + 2]) for i in (3, 4))
    if max(miss_4, miss_6) > MEETING_MM or not moves_everywhere(chain, on_4):
        return None
    return OffsetWrist(on_4, on_6, float((on_6 - on_4) @ h[4]))


def spherical_wrist(chain: Chain) -> SphericalWrist:
    """The robot's wrist, if it is spherical.

    Raises:
        InputError: it is not, or there are places or turns that its joints cannot reach; the line says why.
    """
    h = chain.axes
    for i, j in ((3, 4), (4, 5)):
        if _sine(h[i], h[j]) < PARALLEL:
            raise _unsolved(chain, f"axes {i + 1} and {j + 1} are parallel")
    centre, miss = meeting_point(h[3:], chain.points_mm[3:])
    if miss > MEETING_MM:
        raise _unsolved(chain, f"its wrist is not spherical (axes 4, 5 and 6 miss each other by {miss:.3g} mm)")
    if not moves_everywhere(chain, centre):
        raise _unsolved(chain, "joints 1 to 3 cannot move the wrist's centre in all directions")
    if _sine(h[1], h[2]) > NEARLY or _sine(h[0], h[1]) < NEARLY:
        raise _unsolved(chain, "axes 2 and 3 are not parallel, or axis 1 is parallel to them")
    return SphericalWrist(
        centre,
        parallel_axes=_sine(h[1], h[2]) < PARALLEL,
        square=bool(max(abs(h[3] @ h[4]), abs(h[4] @ h[5])) < PARALLEL),
    )


def _sine(a: Float, b: Float) -> float:
    return float(np.linalg.norm(np.cross(a, b)))


def meeting_point(axes: Float, points: Float) -> tuple[Float, float]:
    """The point nearest to three lines, and its largest distance from one of them."""
    across = np.eye(3) - axes[:, :, None] * axes[:, None, :]
    point = np.linalg.solve(across.sum(axis=0), np.einsum("kij,kj->i", across, points))
    return point, float(np.linalg.norm(np.einsum("kij,kj->ki", across, point - points), axis=1).max())


def _unsolved(chain: Chain, why: str) -> InputError:
    return InputError(f"robot '{chain.name}'", f"expected a spherical wrist that its arm moves everywhere: {why}")


def arm_sides(chain: Chain, joints: Float) -> Bool:
    """Behind axis 1, elbow down, wrist flipped (see SIDES): (n, 3), at joint angles (n, 6), rad.

    Forward is where the wrist's centre lies with all joints at zero. The elbow is up where forward bending of the
    upper arm and of the forearm go the same way round. The wrist is flipped where joint 5 bends it backwards, with
    joint 4 at zero. The base's z counts as up: a robot that hangs hangs with its base.
    """
    h, o = chain.axes, chain.points_mm
    centre, beyond, link = _wrist(chain)
    up = h[0] if h[0, 2] >= 0 else -h[0]
    side = np.cross(up, centre - o[0])
    side = h[1] * np.sign(h[1] @ side)  # bends the arm forward
    forward = np.cross(side, up)
    moved = motions(chain, np.asarray(joints, float).reshape(-1, 6))
    turn = moved[:, 1, :3, :3]  # of what axis 1 carries
    wrist = mapped(moved[:, 3], centre)
    elbow = mapped(moved[:, 2], o[2])
    shoulder = mapped(moved[:, 1], o[1])
    hand = mapped(moved[:, link], beyond)
    behind = np.einsum("ni,ni->n", turn @ forward, hand - o[0]) < 0
    bent = np.einsum("ni,ni->n", turn @ side, np.cross(elbow - shoulder, wrist - elbow))
    flipped = np.sin(np.asarray(joints, float).reshape(-1, 6)[:, 4]) * np.sign(h[4] @ side) < 0
    return np.column_stack([behind, bent < 0, flipped])


def refuse_contradiction(configuration: Sequence[Side]) -> None:
    """Refuse both words of a pair. Raises ValueError."""
    for pair in SIDES:
        if set(pair) <= set(configuration):
            raise ValueError(f"expected '{pair[0]}' or '{pair[1]}', found both")


@functools.lru_cache(maxsize=16)  # of a chain, asked for at every posture
def _wrist(chain: Chain) -> tuple[Float, Float, int]:
    """What the elbow is judged by, what the shoulder is judged by, and the link that carries the latter, at zero.

    Both are the wrist's centre, or where axes 4 and 5 meet. Where axis 4 is parallel to axes 2 and 3 (UR), joint 1
    decides where axes 5 and 6 meet, not where 4 and 5 do.
    """
    offset = offset_wrist(chain)
    if offset is None:
        centre = meeting_point(chain.axes[3:], chain.points_mm[3:])[0]
        return centre, centre, 3
    parallel = _sine(chain.axes[3], chain.axes[2]) < PARALLEL
    return (offset.on_4_mm, offset.on_6_mm, 4) if parallel else (offset.on_4_mm, offset.on_4_mm, 3)


def level_joint_3(chain: Chain, joints: Float, sense: float = 1.0) -> Float:
    """Joint angles (..., 6) as a controller counts them whose joint 3 is against the ground, not the upper arm (FANUC).

    Such a controller turns joint 3 along when joint 2 moves alone, so that the forearm keeps its slope.
    """
    q = np.array(joints, float)
    q[..., 2] += sense * np.sign(chain.axes[1] @ chain.axes[2]) * q[..., 1]
    return q


def free_joint_3(chain: Chain, joints: Float) -> Float:
    """The other way round: joint 3 against the upper arm, as a URDF counts it."""
    return level_joint_3(chain, joints, -1.0)


# The wrist's centre, solved backwards.


def on_circle(rising: AnyArray, off: float) -> Float:
    """Zeros (n, m) of sum c_k exp(i k t), k = 0 to m, c (n, m + 1); NaN: those that are `off` real or more.

    Eigenvalues of companion matrices.
    """
    count, degree = len(rising), rising.shape[1] - 1
    rising = rising / np.maximum(np.abs(rising).max(axis=1, keepdims=True), np.finfo(float).tiny)
    leading = np.where(np.abs(rising[:, -1]) < ROUNDING, ROUNDING, rising[:, -1])  # of a lower degree: roots far off
    companion = np.zeros((count, degree, degree), complex)
    companion[:, np.arange(1, degree), np.arange(degree - 1)] = 1.0
    companion[:, :, -1] = -rising[:, :-1] / leading[:, None]
    root = np.linalg.eigvals(companion)
    return np.where(np.abs(np.abs(root) - 1.0) < off, np.angle(root), np.nan)


def arm_size_mm(chain: Chain, centre_mm: Float) -> float:
    """A length in which the arm's reach is about 1: from point to point of the first three axes to the wrist."""
    points = np.vstack([chain.points_mm[:3], centre_mm])
    return float(chords_mm(points).sum())


def moves_everywhere(chain: Chain, centre_mm: Float) -> bool:
    """Whether joints 1 to 3 can move the wrist's centre in all directions, in some posture."""
    q = np.random.default_rng(0).uniform(-np.pi, np.pi, (4, 3))  # no angle is special
    _, slope = centre_at(chain, centre_mm, q, arm_size_mm(chain, centre_mm))
    return bool(np.abs(np.linalg.det(slope)).max() > 1e-9)


def turn_about(axis: Float, start: Float, end: Float) -> Float:
    """Angles about `axis` that turn `start` to `end`, (..., 3)."""
    across = np.cross(start, end) @ axis
    return np.asarray(np.arctan2(across, (start * end).sum(axis=-1) - (start @ axis) * (end @ axis)))


def centre_at(chain: Chain, centre_mm: Float, q: Float, size: float) -> tuple[Float, Float]:
    """The wrist's centre (..., 3) at angles (..., 3) and its slopes (..., 3, 3), in units of `size`."""
    six = np.concatenate([q, np.zeros_like(q)], axis=-1)
    moved = motions(chain, six)[..., 3, :, :]
    at = mapped(moved, centre_mm)
    return at / size, jacobian_at(*joint_axes(chain, six), at)[..., :3, :3] / size


def newton(missing: Callable[[Float], tuple[Float, Float]], start: Float, steps: int) -> tuple[Float, Float]:
    """The best of Newton's steps from joint angles (..., j), damped where the arm is singular; and what it misses.

    Args:
        missing: what angles miss (..., k), and its slopes (..., k, j).
        start: where the first begins.
        steps: how many.
    """
    best, least, here = start, np.full(start.shape[:-1], np.inf), start
    for _ in range(steps):
        miss, slope = missing(here)
        now = np.linalg.norm(miss, axis=-1)
        best = np.where((now < least)[..., None], here, best)
        least = np.minimum(now, least)
        back = slope.mT
        square = back @ slope + 1e-14 * np.eye(here.shape[-1])
        here = here + np.linalg.solve(square, back @ miss[..., None])[..., 0]
    return best, least


@kernel
def parallel_position(h: AnyArray, o: AnyArray, centre: AnyArray, wanted: AnyArray, beyond: float) -> AnyArray:
    """Angles (n, 4, 3) of joints 1 to 3 that bring the wrist's centre to `wanted` (n, 3); NaN: no such branch.

    Rows are 2 * shoulder + elbow. `h`, `o` (6, 3): axes and points on them, `centre` (3,), all at zero in the base.
    What is out of reach by a share of `beyond` at most is taken with the arm stretched.
    """
    out = np.full((len(wanted), 4, 3), np.nan)
    upper, fore = o[2] - o[1], centre - o[2]
    upper, fore = upper - (upper @ h[1]) * h[1], fore - (fore @ h[1]) * h[1]
    for n in range(len(wanted)):
        w = wanted[n]
        shoulder, slack = _on_circle(h[1], h[0], w - o[0], h[1] @ (centre - o[0]), -1.0)
        for a in range(2):
            u = rotation_about(h[0], shoulder[a]).T @ (w - o[0]) + o[0] - o[1]
            u = u - (u @ h[1]) * h[1]
            elbow, bent = _on_circle(upper, h[2], fore, (u @ u - upper @ upper - fore @ fore) / 2, 1.0)
            if min(slack, bent) < -beyond:
                continue
            for b in range(2):
                row = out[n, 2 * a + b]
                q2 = angle_about(h[1], upper + rotation_about(h[2], elbow[b]) @ fore, u)
                row[0], row[1], row[2] = shoulder[a], q2, elbow[b]
    return out


@kernel
def _on_circle(d: AnyArray, axis: AnyArray, p: AnyArray, wanted: float, sense: float) -> tuple[AnyArray, float]:
    """Both angles t with d . Rot(axis, sense t) p = wanted, or where it comes nearest; and the share left to their end.

    Below 0 where there are none.
    """
    along = (d @ axis) * (p @ axis)
    a, b = d @ p - along, sense * (d @ np.cross(axis, p))
    c, r = wanted - along, np.hypot(d @ p - along, d @ np.cross(axis, p))
    angles = np.zeros(2)
    if r <= SINGULAR:
        return angles, 0.0 if abs(c) <= SINGULAR else -1.0
    middle, half = np.arctan2(b, a), np.arctan2(np.sqrt(max(r * r - c * c, 0.0)), c)
    angles[0], angles[1] = wrapped(middle + half), wrapped(middle - half)
    return angles, 1.0 - abs(c) / r


@kernel
def angle_about(axis: AnyArray, start: AnyArray, end: AnyArray) -> float:
    """The angle about `axis` that turns `start` to `end`, as seen along it; 0 where either lies on it."""
    across, along = axis @ np.cross(start, end), start @ end - (axis @ start) * (axis @ end)
    return float(np.arctan2(across, along)) if across != 0.0 or along != 0.0 else 0.0


@kernel
def wrapped(angle: float) -> float:
    """The same angle in (-pi, pi]."""
    return float(np.pi - (np.pi - angle) % (2 * np.pi))


@kernel
def rotation_about(axis: AnyArray, angle: float) -> AnyArray:
    """The rotation (3, 3) about a unit axis (Rodrigues)."""
    turn = np.zeros((1, 3, 4))
    turn_about_axis(turn, 0, axis.reshape(1, 3), np.zeros((1, 3)), 0, angle)
    return np.ascontiguousarray(turn[0, :, :3])
