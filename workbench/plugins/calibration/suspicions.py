"""Known mistakes in a recording, and which of them would make a hand-eye pose explain what the profiles show."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeAlias

import numpy as np
from scipy.spatial.transform import Rotation

from workbench.api import (
    DEG,
    Float,
    known_conventions,
    known_profile_readings,
    pose_from,
    quaternion_from_rotation,
    rotation_from_quaternion,
    vector_from_rotation,
)
from workbench.plugins.calibration.model import Estimate

Fitted: TypeAlias = Callable[[], float]
NAMED = 3  # suspicions in a sentence; of so many times as many, the likeliest, the misfit is fitted
ALIKE = 4.0  # times the least misfit: explains nearly as well
DESIGN_DEG = 20.0  # by which a design's pose may be off
FAR_DEG, FAR_MM = 30.0, 60.0  # beyond it nobody took it for the same pose
OTHER_TOOL = (
    "the hand-eye pose lies {:.0f} mm from the recording's own (/hand_eye); suspicion: the poses are those of a tool "
    "frame, no longer the flange's (another tool was active), or that pose is of another mount"
)


def suspected(base_from_flange: Float, begin: Callable[[Float], tuple[float, Fitted]], most: float) -> str:
    """The known mistakes in flange poses (k, 4, 4) without which their misfit is at most `most`; empty: none.

    Args:
        base_from_flange: as read.
        begin: of the poses as they would be (k, 4, 4) a rough misfit, and what tells it well; smaller is better.
        most: of a misfit that noise explains.
    """
    turns, position = base_from_flange[:, :3, :3], base_from_flange[:, :3, 3]
    otherwise: list[tuple[str, Float]] = []
    for one in known_conventions():
        if one.quaternion or one.position or one.inverted:
            quaternion, place, _ = one.read(quaternion_from_rotation(turns), position, np.eye(4))
            otherwise.append((one.name, pose_from(rotation_from_quaternion(quaternion), place)))
    turn = Rotation.from_matrix(turns)
    for order in ("ZYX", "XYZ", "ZYZ"):
        degrees = Rotation.from_euler(order, np.degrees(turn.as_euler(order)))
        otherwise.append(("angles are in rad, but were read as degrees", pose_from(degrees.as_matrix(), position)))
    otherwise.append(("rotations are by half of their angles", pose_from((turn * turn).as_matrix(), position)))
    for shift in (-1, 1):
        otherwise.append(("poses are those of the posture beside", np.roll(base_from_flange, shift, axis=0)))
    begun = sorted(((*begin(poses), name) for name, poses in otherwise), key=lambda one: one[0])
    tried = sorted((fitted(), name) for _, fitted, name in begun[: NAMED * NAMED])
    named = dict.fromkeys(name for left, name in tried if left <= min(most, ALIKE * tried[0][0]))
    return " or ".join(list(named)[:NAMED])


def pose_warnings(pose: Estimate, design: Float | None) -> tuple[str, ...]:
    """A warning where a hand-eye pose is far from that which its recording carries, with the likeliest cause."""
    if design is None or (design == np.eye(4)).all():
        return ()
    between = design[:3, :3].T @ pose.rotation
    far_mm = float(np.linalg.norm(pose.translation_mm - design[:3, 3]))
    moved = (OTHER_TOOL.format(far_mm),) if far_mm > FAR_MM else ()
    off = _angle_deg(between)
    if off <= FAR_DEG:
        return moved
    x, _, z = np.eye(3, dtype=np.float32)
    causes = [(DESIGN_DEG, "that pose is of another convention")]
    for profile in known_profile_readings():
        right_x, right_z = profile.read(x, z)
        frame = np.stack([right_x, np.cross(right_z, right_x), right_z])
        causes.append((_angle_deg(frame.T @ between), profile.name))
    for one in known_conventions():
        if one.hand_eye is not None:
            causes.append((_angle_deg(one.hand_eye(design)[:3, :3].T @ pose.rotation), one.name))
    cause = min(causes, key=lambda one: round(one[0]))[1]  # of equals the likeliest, which comes first
    turned = f"the hand-eye pose is turned by {off:.0f} deg from the recording's own (/hand_eye); suspicion: {cause}"
    return (*moved, turned)


def _angle_deg(rotation: Float) -> float:
    return float(np.linalg.norm(vector_from_rotation(rotation))) / DEG
