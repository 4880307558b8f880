"""Poses and the hand-eye pose out of a bag's /tf and /tf_static, by the names of their frames."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from workbench.errors import InputError
from workbench.importing.bags_frames import FrameTree, chained, frame_name, product
from workbench.importing.bags_mapping import LENGTH_MM, BagPart
from workbench.importing.bags_reader import TF, TF_OF_ROS1, Bag
from workbench.importing.bags_times import header_s
from workbench.units import Float


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
    pose: Float = product([replace(motion, is_static=True) for motion in chain], np.zeros(1))[0].copy()
    pose[:3, :3] = pose[:3, :3] @ ros_from_profiler
    return pose
