"""Bags of ROS: MCAP, rosbag2 and rosbag1 with profiles, poses, or both.

The method: open the bag, choose its topics, read profiles and poses message by message, tell passes apart. What the
bag leaves open is asked for by its name in the mapping (`workbench.importing.mapping_parts`), never guessed.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from workbench.errors import InputError
from workbench.geometry.poses import quaternion_from_rotation
from workbench.importing.bags_profiles import profile_topics, read_profiles
from workbench.importing.bags_reader import (
    JOINTS,
    ODOMETRY,
    POSE,
    TF,
    TF_OF_ROS1,
    TRANSFORM,
    Bag,
    FrameTree,
    Link,
    Message,
    chained,
    chosen_topic,
    frame_name,
    header_s,
    in_order,
    listed,
    opened,
    stamp_s,
)
from workbench.importing.joints import JointModel
from workbench.importing.mapping import Mapping
from workbench.importing.mapping_parts import LENGTH_MM, BagPart
from workbench.importing.neutral import Imported, PoseStream
from workbench.importing.poses import of_flange_in_base
from workbench.units import Float

NAME = "bag (MCAP, rosbag2, rosbag1)"
SUFFIXES = (".mcap", ".bag", ".db3")
METADATA = "metadata.yaml"
MAGIC = (b"\x89MCAP0", b"#ROSBAG V")


def recognises(path: Path, head: bytes, mapping: Mapping) -> bool:
    """Whether the source is a bag: by its suffix or first bytes, or a directory with a rosbag2's metadata."""
    if path.is_dir():
        return any(file.name == METADATA or file.suffix in SUFFIXES for file in path.iterdir())
    return path.suffix in SUFFIXES or head.startswith(MAGIC)


def read(path: Path, mapping: Mapping) -> Imported:
    """Profiles, poses and, where frames say it, the hand-eye pose of one bag.

    Raises:
        InputError: a damaged bag, a message that cannot be used, or a question that only the mapping can answer.
    """
    if path.is_dir() and not (path / METADATA).is_file():
        raise InputError(str(path), f"expected {METADATA} beside the storage; or name the .mcap or .db3 file itself")
    if not path.is_dir() and path.suffix not in SUFFIXES:
        raise InputError(str(path), f"expected a bag to be named {', '.join(SUFFIXES)}")
    part = mapping.bag or BagPart()
    with opened(path) as bag:
        return _read(bag, part, mapping)


def _read(bag: Bag, part: BagPart, mapping: Mapping) -> Imported:
    topics, source = profile_topics(bag, part), pose_source(bag, part)
    if not topics and source is None:
        there = ", ".join(f"{topic} ({name})" for topic, name in sorted(bag.types.items())[:12])
        raise InputError(str(bag.path), f"expected topics of profiles or poses, found {there}")
    tree = read_frames(bag, part) if source == "tf" or part.profiler_frame is not None else None
    poses, note = read_poses(bag, source, part, tree, mapping.base_dir) if source else (None, "poses: none in the bag")
    if part.profiler_frame is not None and mapping.hand_eye is not None:
        raise InputError("mapping: $.bag.profiler_frame", "stands beside $.hand_eye: expected one of them")
    if not topics:
        return Imported(poses=poses, notes=(note,))
    found = read_profiles(bag, topics, part)
    notes = [*found.notes, f"times: of the {part.time}", note]
    hand_eye = None
    if tree is not None and part.profiler_frame is not None:
        hand_eye = hand_eye_from_frames(tree, part, found.ros_from_profiler)
        notes.append(f"hand-eye: '{part.profiler_frame}' on '{part.flange_frame}' in /tf")
    elif tree is not None and frame_name(found.frame_id) in tree.names and mapping.hand_eye is None:
        notes.append(f"hand-eye: not taken from /tf; profiler_frame '{found.frame_id}' in the mapping would take it")
    return Imported(found.profiles, poses, tuple(notes), hand_eye)


# Flange poses out of a bag: PoseStamped, TransformStamped, Odometry, JointState, or the chain of frames in /tf.

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
        joints = bag.types[source] == JOINTS
        stream, note = _joints(bag, source, part, base_dir) if joints else _stamped(bag, source, part)
    position_mm, quaternion = of_flange_in_base(stream.position_mm, stream.quaternion_wxyz, part)
    told = [f"{name} applied" for name in ("base_from_frame", "flange_from_tool") if getattr(part, name) is not None]
    return replace(stream, position_mm=position_mm, quaternion_wxyz=quaternion), "; ".join([note, *told])


def _stamped(bag: Bag, source: str, part: BagPart) -> tuple[PoseStream, str]:
    """Poses that stand in the messages; all of the same two frames, and of the mapping's where it names them."""
    where, frames, link = f"{bag.path}: {source}", (part.flange_frame, part.base_frame), Link("")
    for message in bag.messages([source]):
        frames = _same_frames(message, frames)
        place, turn = _pose(message.value)
        link.add(place, turn, stamp_s(message, part.time), LENGTH_MM[part.pose_length_unit], message.where)
    found = link.motion(where)
    flange = f"'{frames[0]}'" if frames[0] else "the flange"
    note = f"poses: {listed(bag, [source])}, {flange} in '{frames[1]}', in {part.pose_length_unit}"
    unit = part.pose_length_unit
    stream = PoseStream(str(bag.path), found.position_mm, found.quaternion_wxyz, found.time_s, length_unit=unit)
    return stream, note + _dense(found.time_s, found.repeats)


def _same_frames(message: Message, before: tuple[str | None, str | None]) -> tuple[str | None, str | None]:
    """Child (a PoseStamped names none) and parent of a message, which must be those of before."""
    child = getattr(message.value, "child_frame_id", None)
    here = (before[0] if child is None else frame_name(child), frame_name(message.value.header.frame_id))
    for expected, found in zip(before, here, strict=True):
        if expected is not None and frame_name(expected) != found:
            raise InputError(message.where, f"expected frame '{expected}', found '{found}'")
    return here


def _pose(value: Any) -> tuple[Any, Any]:
    """Position and quaternion."""
    if hasattr(value, "transform"):
        return value.transform.translation, value.transform.rotation
    pose = getattr(value.pose, "pose", value.pose)  # Odometry has it beside a covariance
    return pose.position, pose.orientation


def _joints(bag: Bag, source: str, part: BagPart, base_dir: Path) -> tuple[PoseStream, str]:
    """Poses through the robot's URDF."""
    where = f"{bag.path}: {source}"
    if part.urdf is None or part.base_frame is None or part.flange_frame is None:
        raise InputError(where, "expected $.bag.urdf, base_frame and flange_frame in the mapping, for joint states")
    model = JointModel.read(base_dir / part.urdf, part.base_frame, part.flange_frame)
    times, rows, places = [], [], []
    for message in bag.messages([source]):
        row = model.joints(message.value, message.where)
        if row is not None:
            times.append(stamp_s(message, part.time))
            rows.append(row)
            places.append(message.where)
    if not rows:
        raise InputError(where, f"expected joints {', '.join(model.names)}, found none of them in any message")
    model.check(np.array(rows), "rad", places.__getitem__)
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


# Poses and the hand-eye pose out of a bag's /tf and /tf_static, by the names of their frames.


def read_frames(bag: Bag, part: BagPart) -> FrameTree:
    """All frames of /tf and /tf_static."""
    tree = FrameTree(f"{bag.path}: /tf")
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


def poses_from_frames(tree: FrameTree, part: BagPart) -> tuple[Float, Float]:
    """Times (K,) and base_from_flange (K, 4, 4).

    Raises:
        InputError: a frame is not named in the mapping or not known; the flange does not move.
    """
    if part.base_frame is None or part.flange_frame is None:
        known = ", ".join(tree.names[:20]) or "none"
        raise InputError(tree.where, f"expected $.bag.base_frame and flange_frame in the mapping; frames: {known}")
    time_s, poses = chained(tree.chain(frame_name(part.base_frame), frame_name(part.flange_frame)), tree.where)
    if not len(time_s):
        raise InputError(tree.where, f"expected '{part.flange_frame}' to move in '{part.base_frame}', found it fixed")
    return time_s, poses


def hand_eye_from_frames(tree: FrameTree, part: BagPart, ros_from_profiler: Float) -> Float:
    """flange_from_profiler (4, 4): the fixed chain from `flange_frame` to `profiler_frame`, with the profiler's axes.

    Raises:
        InputError: the flange is not named, a frame is unknown, or one moves against the other.
    """
    if part.flange_frame is None or part.profiler_frame is None:
        raise InputError(tree.where, "expected $.bag.flange_frame beside profiler_frame in the mapping")
    chain = tree.chain(frame_name(part.flange_frame), frame_name(part.profiler_frame))
    if not all(motion.holds_still for motion in chain):
        raise InputError(
            tree.where, f"expected '{part.profiler_frame}' fixed to '{part.flange_frame}', found it moving"
        )
    pose: Float = np.eye(4)
    for motion in chain:
        pose = pose @ motion.at(motion.time_s[:1])[0]
    pose[:3, :3] = pose[:3, :3] @ ros_from_profiler
    return pose
