"""Bags of ROS: MCAP, rosbag2 and rosbag1 with profiles, poses, or both.

The method: open the bag, choose its topics, read profiles and poses message by message, tell passes apart. What the
bag leaves open is asked for by its name in the mapping (`workbench.importing.bags_mapping`), never guessed.
"""

from __future__ import annotations

from pathlib import Path

from workbench.errors import InputError
from workbench.importing.bags_frames import frame_name
from workbench.importing.bags_mapping import BagPart
from workbench.importing.bags_poses import pose_source, read_poses
from workbench.importing.bags_profiles import profile_topics, read_profiles
from workbench.importing.bags_reader import Bag, opened
from workbench.importing.bags_tf import hand_eye_from_frames, read_frames
from workbench.importing.mapping import Mapping
from workbench.importing.neutral import Imported

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
