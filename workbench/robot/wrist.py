"""A robot's wrist: whether it leaves the inverse a closed form, and on which side of its singularities the arm stands.

In closed form where axes 4, 5, 6 go through one point, which the first three move everywhere.

ABB's `cfx`, KUKA's STATUS and FANUC's configuration string say the same three things: whether the wrist's centre is
behind axis 1, whether it is below the line of the upper arm (the elbow is down), and whether the wrist is flipped.
Here they follow from the geometry, so that neither zeros nor senses of a maker's joints matter.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from workbench.errors import InputError
from workbench.robot.kinematics import Chain, motions
from workbench.robot.position import moves_everywhere
from workbench.units import Bool, Float, Shaped

PARALLEL = 1e-9  # sine of an angle that still counts as zero
MEETING_MM = 1e-4  # distance at which lines still count as meeting


@dataclass(frozen=True, slots=True, eq=False)
class SphericalWrist:
    """Where the wrist's three axes meet, all joints at zero."""

    centre_mm: Shaped[Float, " 3"]  # in the base
    behind_parallel_axes: bool  # axes 2 and 3 are parallel and axis 1 is not, as in most robots
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
    return SphericalWrist(
        centre,
        behind_parallel_axes=_sine(h[1], h[2]) < PARALLEL <= _sine(h[0], h[1]),
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
    """Behind axis 1, elbow down, wrist flipped: (n, 3), at joint angles (n, 6), rad.

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
    wrist = moved[:, 3, :3, :3] @ centre + moved[:, 3, :3, 3]
    elbow = moved[:, 2, :3, :3] @ o[2] + moved[:, 2, :3, 3]
    shoulder = moved[:, 1, :3, :3] @ o[1] + moved[:, 1, :3, 3]
    hand = moved[:, link, :3, :3] @ beyond + moved[:, link, :3, 3]
    behind = np.einsum("ni,ni->n", turn @ forward, hand - o[0]) < 0
    bent = np.einsum("ni,ni->n", turn @ side, np.cross(elbow - shoulder, wrist - elbow))
    flipped = np.sin(np.asarray(joints, float).reshape(-1, 6)[:, 4]) * np.sign(h[4] @ side) < 0
    return np.column_stack([behind, bent < 0, flipped])


def _wrist(chain: Chain) -> tuple[Float, Float, int]:
    """What the elbow is judged by, what the shoulder is judged by, and the link that carries the latter, at zero.

    Both are the wrist's centre, or where axes 4 and 5 meet. Where axis 4 is parallel to axes 2 and 3 (UR), joint 1
    decides where axes 5 and 6 meet, not where 4 and 5 do.
    """
    offset = offset_wrist(chain)
    if offset is None:
        centre = meeting_point(chain.axes[3:], chain.points_mm[3:])[0]
        return centre, centre, 3
    parallel = float(np.linalg.norm(np.cross(chain.axes[3], chain.axes[2]))) < PARALLEL
    return (offset.on_4_mm, offset.on_6_mm, 4) if parallel else (offset.on_4_mm, offset.on_4_mm, 3)


def level_joint_3(chain: Chain, joints: Float) -> Float:
    """Joint angles (..., 6) as a controller counts them whose joint 3 is against the ground, not the upper arm (FANUC).

    Such a controller turns joint 3 along when joint 2 moves alone, so that the forearm keeps its slope.
    """
    q = np.array(joints, float)
    q[..., 2] += np.sign(chain.axes[1] @ chain.axes[2]) * q[..., 1]
    return q


def free_joint_3(chain: Chain, joints: Float) -> Float:
    """The other way round: joint 3 against the upper arm, as a URDF counts it."""
    q = np.array(joints, float)
    q[..., 2] -= np.sign(chain.axes[1] @ chain.axes[2]) * q[..., 1]
    return q
