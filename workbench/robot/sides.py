"""On which side of its three singularities an arm stands, as controllers count it, and the coupling of joints 2 and 3.

ABB's `cfx`, KUKA's STATUS and FANUC's configuration string say the same three things: whether the wrist's centre is
behind axis 1, whether it is below the line of the upper arm (the elbow is down), and whether the wrist is flipped.
Here they follow from the geometry, so that neither zeros nor senses of a maker's joints matter.
"""

from __future__ import annotations

import numpy as np

from workbench.robot.kinematics import Chain, motions
from workbench.robot.wrist import PARALLEL, meeting_point, offset_wrist
from workbench.units import Bool, Float


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
