"""An open bag: MCAP, rosbag2 or rosbag1, message by message, by rosbags; its times and its tree of frames.

Every fault of the file, whatever rosbags raises of it, is an InputError here and nowhere else. Messages are read by the
standard definitions of their types, never by code made from the bag's own ones; a bag whose type has another digest is
refused.

Poses here are in mm, `parent_from_child`.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np

from workbench.errors import InputError, nearest
from workbench.extras import Extra
from workbench.geometry.poses import interpolate_poses, inverse, pose_from, rotation_from_quaternion
from workbench.scan.checks import normalised
from workbench.units import Float, Shaped

CLOUD = "sensor_msgs/msg/PointCloud2"
POSE, TRANSFORM = "geometry_msgs/msg/PoseStamped", "geometry_msgs/msg/TransformStamped"
ODOMETRY, JOINTS = "nav_msgs/msg/Odometry", "sensor_msgs/msg/JointState"
TF, TF_OF_ROS1 = "tf2_msgs/msg/TFMessage", "tf/msg/tfMessage"


@dataclass(frozen=True, slots=True)
class Message:
    """One message of a bag."""

    topic: str
    index: int  # of the messages of its topic, from 0
    time_ns: int  # when it was recorded
    value: Any  # fields as the message type has them
    where: str  # for messages: file, topic, index


@dataclass(frozen=True, slots=True)
class Bag:
    """An open bag (`opened`)."""

    path: Path
    reader: Any
    typestore: Any
    is_ros1: bool
    types: dict[str, str]  # message type of each topic
    counts: dict[str, int]  # messages of each topic, as the bag's index has it

    def topics(self, *types: str) -> list[str]:
        """Topics of these message types that hold messages, in alphabetical order."""
        return sorted(topic for topic, name in self.types.items() if name in types and self.counts[topic])

    def messages(self, topics: list[str]) -> Iterator[Message]:
        """Messages of these topics in the order of recording.

        Raises:
            InputError: a damaged bag, fewer messages than its index says, a type with a strange definition.
        """
        chosen, store = [c for c in self.reader.connections if c.topic in topics], self.typestore
        if not chosen:
            return  # the library would take it for all
        for connection in chosen:
            self._check_definition(connection)
        count = dict.fromkeys(topics, 0)
        for connection, time_ns, raw in _each(self.reader.messages(chosen), str(self.path)):
            topic = connection.topic
            if topic not in count:
                raise InputError(f"{self.path}: {topic}", "messages among another topic's: the bag is damaged")
            index = count[topic]
            where = f"{self.path}: {topic}[{index}]"
            with _edge(where, "message"):
                value = (store.deserialize_ros1 if self.is_ros1 else store.deserialize_cdr)(raw, connection.msgtype)
            count[topic] += 1
            yield Message(topic, index, time_ns, value, where)
        for topic in topics:
            if count[topic] != self.counts[topic]:
                found = f"found {count[topic]}: the bag is damaged"
                raise InputError(f"{self.path}: {topic}", f"expected {self.counts[topic]} messages, {found}")

    def _check_definition(self, connection: Any) -> None:
        """Digest (md5 in rosbag1, RIHS01 in rosbag2; a bare MCAP file has none) against the standard type's."""
        name, store = connection.msgtype, self.typestore
        expected = store.generate_msgdef(name)[1] if self.is_ros1 else store.hash_rihs01(name)
        if connection.digest not in ("", "*", expected):
            where = f"{self.path}: {connection.topic}"
            raise InputError(where, f"expected the standard definition of {name} ({expected}), found another")


@contextmanager
def opened(path: Path) -> Iterator[Bag]:
    """Open a bag: a .mcap, .db3 or .bag file, or the directory of a rosbag2.

    Raises:
        InputError: it cannot be opened, is damaged, or holds no message.
    """
    rosbag1, rosbag2 = Extra("rosbags.rosbag1"), Extra("rosbags.rosbag2")
    is_ros1 = not path.is_dir() and path.suffix == ".bag"
    _check_sqlite(path)
    with ExitStack() as stack:
        with _edge(str(path), "bag"):
            reader: Any = stack.enter_context(rosbag1.Reader(path) if is_ros1 else rosbag2.Reader(path))
            topics = {topic: (info.msgtype, info.msgcount) for topic, info in reader.topics.items()}
        if not any(count for _, count in topics.values()):
            raise InputError(str(path), "expected a bag with messages, found none")
        for topic, (name, _) in topics.items():
            if name is None:
                raise InputError(f"{path}: {topic}", "expected one message type, found several")
        types = {topic: str(name) for topic, (name, _) in topics.items()}
        yield Bag(path, reader, _typestore(is_ros1), is_ros1, types, {t: count for t, (_, count) in topics.items()})


def _check_sqlite(path: Path) -> None:
    """rosbags opens a database by its address, as if nothing had ever been left beside it."""
    files = sorted(path.glob("*.db3")) if path.is_dir() else [path] if path.suffix == ".db3" else []
    for file in files:
        log = Path(f"{file}-wal")
        if log.is_file() and log.stat().st_size:
            raise InputError(str(log), "holds messages that were never put into the bag: open it once with sqlite3")
        if any(mark in str(file) for mark in "?#%"):
            raise InputError(str(file), "expected a path without ?, # and %, which SQLite takes for its own")


def chosen_topic(bag: Bag, wanted: str, types: tuple[str, ...], key: str) -> str:
    """A topic that the mapping names under `key`, if the bag has it and it is of one of the types."""
    where = f"{bag.path}: {wanted}"
    if wanted not in bag.types:
        raise InputError(where, f"no such topic ($.bag.{key} of the mapping){nearest(wanted, bag.types)}")
    if bag.types[wanted] not in types:
        raise InputError(where, f"expected {' or '.join(types)} ($.bag.{key}), found {bag.types[wanted]}")
    if not bag.counts[wanted]:
        raise InputError(where, f"expected messages ($.bag.{key}), found none")
    return wanted


def listed(bag: Bag, topics: list[str]) -> str:
    """Topics with their types, for a message."""
    return ", ".join(f"{topic} ({bag.types[topic].split('/')[-1]}, {bag.counts[topic]})" for topic in topics[:20])


@cache
def _typestore(is_ros1: bool) -> Any:
    """The standard message types; those of this module are the same in every ROS 2 so far."""
    typesys = Extra("rosbags.typesys")
    store = typesys.get_typestore(typesys.Stores.ROS1_NOETIC if is_ros1 else typesys.Stores.ROS2_HUMBLE)
    for name in (TF, TF_OF_ROS1):
        if name not in store.fielddefs:
            store.register(typesys.get_types_from_msg("geometry_msgs/TransformStamped[] transforms", name))
    return store


def _each(messages: Iterator[Any], where: str) -> Iterator[Any]:
    """The messages one by one; only the library's own steps are watched."""
    while True:
        with _edge(where, "bag"):
            found = next(messages, None)
        if found is None:
            return
        yield found


@contextmanager
def _edge(where: str, what: str) -> Iterator[None]:
    """The library's edge: a damaged file makes it raise anything, from struct.error to AssertionError."""
    try:
        yield
    except MemoryError:
        raise InputError(where, f"expected a readable {what}: a record claims more bytes than there can be") from None
    except Exception as error:
        said = getattr(error, "strerror", None) or " ".join(str(error).split())[:300] or "a record that does not fit"
        raise InputError(where, f"expected a readable {what}: {said} ({type(error).__name__})") from None


def stamp_s(message: Message, time: Literal["header", "message"]) -> float:
    """The time of a message that has a header. Raises InputError for a header without time."""
    return message.time_ns / 1e9 if time == "message" else header_s(message.value.header, message.where)


def header_s(header: object, where: str) -> float:
    """The header's stamp. Raises InputError where it was never set."""
    stamp = header.stamp  # type: ignore[attr-defined]
    if stamp.sec == 0 and stamp.nanosec == 0:
        raise InputError(where, 'the header has no time: expected "time": "message" in $.bag of the mapping')
    return float(stamp.sec + stamp.nanosec / 1e9)


def in_order(time_s: Float, rows: Float, where: str) -> tuple[Float, Float, int]:
    """Times (K,) and rows (K, n) sorted by time, and how many repeats were dropped.

    Publishers may run ahead of each other, and repeat themselves: what says the same at the same time counts once.

    Raises:
        InputError: two different rows at one time.
    """
    order = np.argsort(time_s, kind="stable")
    time_s, rows = time_s[order], rows[order]
    again = np.flatnonzero(np.diff(time_s) == 0) + 1
    for k in again:
        if not np.allclose(rows[k], rows[k - 1], rtol=0, atol=1e-9):
            raise InputError(where, f"two different poses at {time_s[k]!s} s")
    return np.delete(time_s, again), np.delete(rows, again, axis=0), len(again)


SAME = 1e-9  # mm, or of a quaternion: nearer poses are one


@dataclass(slots=True)
class Link:
    """A frame in its parent: a pose that holds for ever, or one at each of its times."""

    parent: str
    is_static: bool = False
    time_s: list[float] = field(default_factory=list)
    rows: list[list[float]] = field(default_factory=list)  # x y z in mm, w x y z

    def add(self, position: Any, quaternion: Any, time_s: float, scale_mm: float, where: str) -> None:
        """Add a message's pose. Raises InputError for what is no number, or for a fixed frame that is elsewhere."""
        row = [scale_mm * float(v) for v in (position.x, position.y, position.z)]
        row += [float(v) for v in (quaternion.w, quaternion.x, quaternion.y, quaternion.z)]
        if not np.isfinite(row).all():
            raise InputError(where, f"expected numbers for position and orientation, found {row}")
        if self.is_static and self.rows and not np.allclose(row, self.rows[0], rtol=0, atol=SAME):
            raise InputError(where, "expected the frame fixed as before, found it elsewhere")
        if not (self.is_static and self.rows):
            self.time_s.append(time_s)
            self.rows.append(row)

    def motion(self, where: str, is_down: bool = True) -> Motion:
        """The link as arrays, in order. Raises InputError for poses that contradict each other, or are none."""
        time_s, rows, repeats = in_order(np.array(self.time_s), np.array(self.rows), where)
        quaternion = normalised(rows[:, 3:], f"{where}: orientation")
        return Motion(self.is_static, is_down, time_s, rows[:, :3], quaternion, repeats)


class Motion(NamedTuple):
    """A link as arrays."""

    is_static: bool
    is_down: bool  # along the chain from parent to child
    time_s: Shaped[Float, " K"]
    position_mm: Shaped[Float, "K 3"]
    quaternion_wxyz: Shaped[Float, "K 4"]
    repeats: int  # that were dropped

    @property
    def holds_still(self) -> bool:
        """Whether it is fixed in fact: ROS 1 repeated fixed links on /tf."""
        rows = np.column_stack([self.position_mm, self.quaternion_wxyz])
        return self.is_static or bool(np.ptp(rows, axis=0).max() <= SAME)

    def at(self, time_s: Float) -> Float:
        """Poses (N, 4, 4), in the chain's sense, at times within its own (any, if static)."""
        if self.is_static:
            one = pose_from(rotation_from_quaternion(self.quaternion_wxyz[-1]), self.position_mm[-1])
            poses = np.broadcast_to(one, (len(time_s), 4, 4))
        else:
            poses = interpolate_poses(time_s, self.time_s, self.position_mm, self.quaternion_wxyz)
        return poses if self.is_down else inverse(poses)


@dataclass(slots=True)
class FrameTree:
    """All frames of a bag by their names."""

    where: str  # for messages
    links: dict[str, Link] = field(default_factory=dict)  # by child

    def add(self, transform: Any, time_s: float, is_static: bool, scale_mm: float, where: str) -> None:
        """Add a geometry_msgs/TransformStamped.

        Raises:
            InputError: a frame with two parents, or fixed in two places.
        """
        parent, child = frame_name(transform.header.frame_id), frame_name(transform.child_frame_id)
        link = self.links.setdefault(child, Link(parent, is_static))
        if (link.parent, link.is_static) != (parent, is_static):
            found = f"'{parent}'" if link.parent != parent else "both in /tf and /tf_static"
            raise InputError(where, f"expected frame '{child}' under '{link.parent}' as before, found it under {found}")
        link.add(transform.transform.translation, transform.transform.rotation, time_s, scale_mm, f"{where}: '{child}'")

    @property
    def names(self) -> list[str]:
        """Of all frames, in alphabetical order."""
        return sorted({name for child, link in self.links.items() for name in (child, link.parent)})

    def chain(self, a: str, b: str) -> list[Motion]:
        """The links from frame a to frame b, up to where their ways to the root meet and down; a_from_b in all.

        Raises:
            InputError: an unknown frame, no way between the two, a link whose poses contradict each other.
        """
        for name in (a, b):
            if name not in self.names:
                raise InputError(self.where, f"unknown frame '{name}'{nearest(name, self.names)}")
        up, down = self._to_root(a), self._to_root(b)
        if up[-1] != down[-1]:
            raise InputError(self.where, f"no chain of frames between '{a}' and '{b}'")
        ways = [(name, False) for name in up if name not in down]
        ways += [(name, True) for name in down[::-1] if name not in up]
        return [self.links[name].motion(f"{self.where}: {self.links[name].parent} to {name}", to) for name, to in ways]

    def _to_root(self, name: str) -> list[str]:
        """The frame, its parent, and so on."""
        way = [name]
        while name in self.links and (name := self.links[name].parent) not in way:
            way.append(name)
        return way


def chained(chain: list[Motion], where: str) -> tuple[Float, Float]:
    """Times (K,) and poses (K, 4, 4) of a chain: at every time of any of its moving links that all of them cover.

    Between its own times each link's position is interpolated linearly and its orientation by slerp. A chain without
    moving link has no times.

    Raises:
        InputError: the moving links have no time in common.
    """
    moving = [motion.time_s for motion in chain if not motion.is_static]
    if not moving:
        time_s = np.zeros(0)
        return time_s, product(chain, np.zeros(1))
    first, last = max(t[0] for t in moving), min(t[-1] for t in moving)
    every = np.unique(np.concatenate(moving))
    time_s = every[(every >= first) & (every <= last)]
    if not len(time_s):
        raise InputError(where, "the links between the frames have no time in common")
    return time_s, product(chain, time_s)


def product(chain: list[Motion], time_s: Float) -> Float:
    """a_from_b (K, 4, 4) at times (K,)."""
    poses = np.broadcast_to(np.eye(4), (len(time_s), 4, 4))
    for motion in chain:
        poses = poses @ motion.at(time_s)
    return np.asarray(poses)


def frame_name(name: str) -> str:
    """A frame's name; ROS 1 knew it with a leading slash."""
    return name.lstrip("/")
