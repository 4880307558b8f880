"""Flange poses out of a bag: PoseStamped, TransformStamped, Odometry, JointState, or the chain of frames in /tf."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from workbench.errors import InputError
from workbench.geometry.poses import quaternion_from_rotation
from workbench.importing.bags_frames import FrameTree, chained, frame_name, pose_row, product
from workbench.importing.bags_mapping import BagPart
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
from workbench.importing.bags_times import header_s, in_order, stamp_s
from workbench.importing.neutral import PoseStream
from workbench.scan.checks import normalised
from workbench.units import Float

TYPES = (POSE, TRANSFORM, ODOMETRY, JOINTS)
LENGTH_MM = {"m": 1e3, "mm": 1.0}


def pose_source(bag: Bag, part: BagPart) -> str | None:
    """The topic of the poses, or 'tf': the mapping's, or the only one that there is; None where the bag has none.

    Raises:
        InputError: an unknown topic, or several candidates.
    """
    moving = [topic for topic in bag.topics(TF, TF_OF_ROS1) if not is_static(topic)]
    if part.poses is not None:
        if part.poses == "tf" or part.poses in moving:
            return "tf"
        return chosen_topic(bag, part.poses, TYPES, "poses")
    topics = bag.topics(*TYPES)
    if len(topics) + bool(moving) > 1:
        candidates = listed(bag, topics) + (f", 'tf' ({listed(bag, moving)})" if moving else "")
        raise InputError(str(bag.path), f"expected $.bag.poses in the mapping to choose from {candidates}")
    return topics[0] if topics else "tf" if moving else None


def read_poses(bag: Bag, source: str, part: BagPart, base_dir: Path) -> tuple[PoseStream, list[str]]:
    """The flange in the base, from the source that `pose_source` names, and notes on it.

    Raises:
        InputError: a message that cannot be used, an unknown frame, a missing joint.
    """
    if source == "tf":
        base, flange = _named(part, bag, "/tf")
        tree = read_frames(bag, part)
        time_s, poses = chained(tree.chain(base, flange), str(bag.path))
        if not len(time_s):
            raise InputError(f"{bag.path}: /tf", f"expected frame '{flange}' to move in '{base}', found it fixed")
        return _stream(bag, time_s, poses), [f"poses: {len(time_s)} of /tf, '{flange}' in '{base}'"]
    if bag.types[source] == JOINTS:
        return _from_joints(bag, source, part, base_dir)
    frames: set[tuple[str, str]] = set()
    rows = [row for message in bag.messages([source]) for row in _rows(message, part, frames)]
    values = np.array(rows)
    time_s, values, repeats = in_order(values[:, 0], values[:, 1:], f"{bag.path}: {source}")
    stream = PoseStream(
        str(bag.path), values[:, :3], normalised(values[:, 3:], f"{bag.path}: {source}: orientation"), time_s
    )
    child, parent = next(iter(frames))
    note = f"poses: {listed(bag, [source])}, {child or 'the flange'} in '{parent}', in {part.pose_length_unit}"
    return stream, [note + _told(repeats)]


def hand_eye_from_frames(bag: Bag, part: BagPart, ros_from_profiler: Float) -> Float:
    """flange_from_profiler (4, 4): the fixed chain from `flange_frame` to `profiler_frame`, with the profiler's axes.

    Raises:
        InputError: an unknown frame, or one that moves against the flange.
    """
    flange, profiler = frame_name(part.flange_frame or ""), frame_name(part.profiler_frame or "")
    chain = read_frames(bag, part).chain(flange, profiler)
    if any(not motion.is_static for motion in chain):
        raise InputError(f"{bag.path}: /tf_static", f"expected '{profiler}' fixed to '{flange}', found it moving")
    pose: Float = product(chain, np.zeros(1))[0].copy()
    pose[:3, :3] = pose[:3, :3] @ ros_from_profiler
    return pose


def read_frames(bag: Bag, part: BagPart) -> FrameTree:
    """All frames of /tf and /tf_static."""
    tree = FrameTree(str(bag.path))
    for message in bag.messages(bag.topics(TF, TF_OF_ROS1)):
        fixed = is_static(message.topic)
        for transform in message.value.transforms:
            by_header = part.time == "header" and not fixed
            time_s = header_s(transform.header, message.where) if by_header else message.time_ns / 1e9
            tree.add(transform, time_s, fixed, LENGTH_MM[part.pose_length_unit], message.where)
    return tree


def is_static(topic: str) -> bool:
    """Whether a topic of transforms holds those that never change."""
    return topic.endswith("tf_static")


def _named(part: BagPart, bag: Bag, what: str) -> tuple[str, str]:
    """Names of base and flange, which the mapping must give."""
    if part.base_frame is None or part.flange_frame is None:
        known = ""
        if what == "/tf":
            links = read_frames(bag, part).links
            known = "; frames: " + ", ".join(sorted({*links, *(link.parent for link in links.values())})[:20])
        raise InputError(f"{bag.path}: {what}", f"expected $.bag.base_frame and flange_frame in the mapping{known}")
    return frame_name(part.base_frame), frame_name(part.flange_frame)


def _rows(message: Message, part: BagPart, frames: set[tuple[str, str]]) -> Iterator[list[float]]:
    """Time, position and orientation of one message; its frames must be those of all others and of the mapping."""
    value: Any = message.value
    here = (frame_name(getattr(value, "child_frame_id", "")), frame_name(value.header.frame_id))
    frames.add(here)
    wanted = (part.flange_frame if here[0] else None, part.base_frame)
    if len(frames) > 1 or any(w is not None and frame_name(w) != h for w, h in zip(wanted, here, strict=True)):
        expected = next(frame for frame in frames if frame != here) if len(frames) > 1 else wanted
        raise InputError(message.where, f"expected child and parent frame {expected}, found {here}")
    pose = getattr(value, "transform", None) or value.pose
    pose = getattr(pose, "pose", pose)  # Odometry: with covariance
    position, orientation = (pose.translation, pose.rotation) if hasattr(pose, "rotation") else (
        pose.position, pose.orientation)  # fmt: skip
    yield [
        stamp_s(message, part.time),
        *pose_row(position, orientation, LENGTH_MM[part.pose_length_unit], message.where),
    ]


def _from_joints(bag: Bag, source: str, part: BagPart, base_dir: Path) -> tuple[PoseStream, list[str]]:
    """Through the robot's URDF."""
    from workbench.importing.joint_states import JointModel

    if part.urdf is None:
        raise InputError(f"{bag.path}: {source}", "expected $.bag.urdf in the mapping: poses come through the URDF")
    base, flange = _named(part, bag, source)
    model = JointModel.read(base_dir / part.urdf, base, flange)
    used = [(stamp_s(message, part.time), joints, message.where) for message in bag.messages([source])
            if (joints := model.joints(message.value, message.where)) is not None]  # fmt: skip
    if not used:
        raise InputError(f"{bag.path}: {source}", f"expected joints {', '.join(model.names)}, found none of them")
    times, rows = np.array([u[0] for u in used]), np.array([u[1] for u in used])
    time_s, joints, repeats = in_order(times, rows, f"{bag.path}: {source}")
    note = f"poses: {listed(bag, [source])}, joints {', '.join(model.names)}, '{flange}' in '{base}' by {part.urdf}"
    others = bag.counts[source] - len(used)
    told = f"; {others} messages of other joints" if others else ""
    return _stream(bag, time_s, model.base_from_flange(joints)), [note + told + _told(repeats)]


def _told(repeats: int) -> str:
    return f"; {repeats} repeats dropped" if repeats else ""


def _stream(bag: Bag, time_s: Float, poses: Float) -> PoseStream:
    return PoseStream(str(bag.path), poses[:, :3, 3].copy(), quaternion_from_rotation(poses[:, :3, :3]), time_s)
