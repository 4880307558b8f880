"""Flange poses out of a bag: PoseStamped, TransformStamped, Odometry, JointState, or the chain of frames in /tf."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from workbench.errors import InputError
from workbench.geometry.poses import quaternion_from_rotation
from workbench.importing.bags_frames import FrameTree, frame_name, pose_row
from workbench.importing.bags_mapping import LENGTH_MM, BagPart
from workbench.importing.bags_reader import (
    JOINTS,
    ODOMETRY,
    POSE,
    TF,
    TF_OF_ROS1,
    TRANSFORM,
    Bag,
    Message,
    chosen_topic,
    listed,
)
from workbench.importing.bags_tf import is_static, poses_from_frames
from workbench.importing.bags_times import in_order, stamp_s
from workbench.importing.joint_states import JointModel
from workbench.importing.neutral import PoseStream
from workbench.importing.poses import of_flange_in_base
from workbench.scan.checks import normalised
from workbench.units import Float

STAMPED = (POSE, TRANSFORM, ODOMETRY)


def pose_source(bag: Bag, part: BagPart) -> str | None:
    """The topic of the poses, or 'tf': the mapping's, or the only one that there is; None where the bag has none.

    Raises:
        InputError: an unknown topic, or several candidates.
    """
    moving = [topic for topic in bag.topics(TF, TF_OF_ROS1) if not is_static(topic)]
    if part.poses is not None:
        if part.poses == "tf" or part.poses in moving:
            return "tf"
        return chosen_topic(bag, part.poses, (*STAMPED, JOINTS), "poses")
    topics = bag.topics(*STAMPED, JOINTS)
    if len(topics) + bool(moving) > 1:
        candidates = [listed(bag, topics), f"'tf' ({listed(bag, moving)})"][: 1 + bool(moving)]
        raise InputError(str(bag.path), f"expected $.bag.poses in the mapping to choose from {', '.join(candidates)}")
    return topics[0] if topics else "tf" if moving else None


def read_poses(bag: Bag, source: str, part: BagPart, tree: FrameTree | None, base_dir: Path) -> tuple[PoseStream, str]:
    """The flange in the base, from the source that `pose_source` names, and a note on it.

    Args:
        tree: the bag's frames, for 'tf'.
        base_dir: where the mapping's relative paths start.

    Raises:
        InputError: a message that cannot be used, an unknown frame, a missing joint.
    """
    if tree is not None and source == "tf":
        time_s, poses = poses_from_frames(tree, part)
        stream = _stream(bag, time_s, poses, part)
        note = f"poses: {len(time_s)} of /tf, '{part.flange_frame}' in '{part.base_frame}'{_dense(time_s)}"
    else:
        read = _joints if bag.types[source] == JOINTS else _stamped
        stream, note = read(bag, source, part, base_dir)
    position_mm, quaternion = of_flange_in_base(stream.position_mm, stream.quaternion_wxyz, part)
    told = [f"{name} applied" for name in ("base_from_frame", "flange_from_tool") if getattr(part, name) is not None]
    return replace(stream, position_mm=position_mm, quaternion_wxyz=quaternion), "; ".join([note, *told])


def _stamped(bag: Bag, source: str, part: BagPart, base_dir: Path) -> tuple[PoseStream, str]:
    """Poses that stand in the messages; all of the same two frames, and of the mapping's where it names them."""
    where, rows, frames = f"{bag.path}: {source}", [], (part.flange_frame, part.base_frame)
    for message in bag.messages([source]):
        frames = _same_frames(message, frames)
        rows.append([stamp_s(message, part.time), *_pose(message, LENGTH_MM[part.pose_length_unit])])
    values = np.array(rows)
    time_s, values, repeats = in_order(values[:, 0], values[:, 1:], where)
    quaternion = normalised(values[:, 3:], f"{where}: orientation")
    stream = PoseStream(str(bag.path), values[:, :3], quaternion, time_s, length_unit=part.pose_length_unit)
    flange = f"'{frames[0]}'" if frames[0] else "the flange"
    note = f"poses: {listed(bag, [source])}, {flange} in '{frames[1]}', in {part.pose_length_unit}"
    return stream, note + _dense(time_s, repeats)


def _same_frames(message: Message, before: tuple[str | None, str | None]) -> tuple[str | None, str | None]:
    """Child (a PoseStamped names none) and parent of a message, which must be those of before."""
    child = getattr(message.value, "child_frame_id", None)
    here = (before[0] if child is None else frame_name(child), frame_name(message.value.header.frame_id))
    for expected, found in zip(before, here, strict=True):
        if expected is not None and frame_name(expected) != found:
            raise InputError(message.where, f"expected frame '{expected}', found '{found}'")
    return here


def _pose(message: Message, scale_mm: float) -> list[float]:
    """Position in mm and quaternion."""
    value = message.value
    if hasattr(value, "transform"):
        return pose_row(value.transform.translation, value.transform.rotation, scale_mm, message.where)
    pose = getattr(value.pose, "pose", value.pose)  # Odometry has it beside a covariance
    return pose_row(pose.position, pose.orientation, scale_mm, message.where)


def _joints(bag: Bag, source: str, part: BagPart, base_dir: Path) -> tuple[PoseStream, str]:
    """Poses through the robot's URDF."""
    where = f"{bag.path}: {source}"
    if part.urdf is None or part.base_frame is None or part.flange_frame is None:
        raise InputError(where, "expected $.bag.urdf, base_frame and flange_frame in the mapping, for joint states")
    model = JointModel.read(base_dir / part.urdf, part.base_frame, part.flange_frame)
    times, rows = [], []
    for message in bag.messages([source]):
        row = model.joints(message.value, message.where)
        if row is not None:
            times.append(stamp_s(message, part.time))
            rows.append(row)
    if not rows:
        raise InputError(where, f"expected joints {', '.join(model.names)}, found none of them in any message")
    time_s, joints, repeats = in_order(np.array(times), np.array(rows), where)
    others = bag.counts[source] - len(rows)
    note = (
        f"poses: {listed(bag, [source])}, joints {', '.join(model.names)}, '{part.flange_frame}' in "
        f"'{part.base_frame}' by {part.urdf}{f'; {others} messages of other joints' if others else ''}"
    )
    return _stream(bag, time_s, model.base_from_flange(joints), part), note + _dense(time_s, repeats)


def _dense(time_s: Float, repeats: int = 0) -> str:
    """How densely the poses follow each other, and what was dropped."""
    steps_s = np.diff(time_s)
    dense = f"; every {np.median(steps_s):.3g} s, at most {steps_s.max():.3g} s apart" if len(steps_s) else ""
    return dense + (f"; {repeats} repeats dropped" if repeats else "")


def _stream(bag: Bag, time_s: Float, poses: Float, part: BagPart) -> PoseStream:
    quaternion = quaternion_from_rotation(poses[:, :3, :3])
    return PoseStream(str(bag.path), poses[:, :3, 3].copy(), quaternion, time_s, length_unit=part.pose_length_unit)
