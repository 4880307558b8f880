"""The tree of frames of /tf and /tf_static: chains of named frames, looked up by times.

Poses here are in mm, `parent_from_child`.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from workbench.errors import InputError, nearest
from workbench.geometry.poses import interpolate_poses, inverse, pose_from, rotation_from_quaternion
from workbench.importing.bags_reader import in_order
from workbench.scan.checks import normalised
from workbench.units import Float, Shaped

SAME = 1e-9  # mm, or of a quaternion: nearer poses are one


@dataclass(slots=True)
class Link:
    """A frame and its parent: a pose that holds for ever, or one at each of its times."""

    parent: str
    is_static: bool
    time_s: list[float] = field(default_factory=list)
    rows: list[list[float]] = field(default_factory=list)  # x y z in mm, w x y z


@dataclass(frozen=True, slots=True, eq=False)
class Motion:
    """A link as arrays."""

    is_static: bool
    is_down: bool  # along the chain from parent to child
    time_s: Shaped[Float, " K"]
    position_mm: Shaped[Float, "K 3"]
    quaternion_wxyz: Shaped[Float, "K 4"]

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
        row = pose_row(transform.transform.translation, transform.transform.rotation, scale_mm, where)
        if is_static and link.rows:
            if not np.allclose(row, link.rows[0], rtol=0, atol=SAME):
                raise InputError(where, f"expected frame '{child}' fixed as before, found it elsewhere")
            return
        link.time_s.append(time_s)
        link.rows.append(row)

    @property
    def names(self) -> list[str]:
        """Of all frames, in alphabetical order."""
        return sorted({name for child, link in self.links.items() for name in (child, link.parent)})

    def chain(self, a: str, b: str) -> list[Motion]:
        """The links from frame a to frame b, by breadth-first search; their product is a_from_b.

        Raises:
            InputError: an unknown frame, no way between the two, a link whose poses contradict each other.
        """
        for name in (a, b):
            if name not in self.names:
                raise InputError(self.where, f"unknown frame '{name}'{nearest(name, self.names)}")
        came: dict[str, tuple[str, str, bool]] = {}  # frame -> the one before, child of the link, downwards
        queue = deque([a])
        while queue and b not in came and a != b:
            here = queue.popleft()
            for child, link in self.links.items():
                other = child if link.parent == here else link.parent if child == here else None
                if other is not None and other != a and other not in came:
                    came[other] = (here, child, link.parent == here)
                    queue.append(other)
        if b not in came and a != b:
            raise InputError(self.where, f"no chain of frames between '{a}' and '{b}'")
        found, here = [], b
        while here != a:
            here, child, is_down = came[here]
            found.append(self._motion(child, is_down))
        return found[::-1]

    def _motion(self, child: str, is_down: bool) -> Motion:
        link, where = self.links[child], f"{self.where}: {self.links[child].parent} to {child}"
        time_s, rows, _ = in_order(np.array(link.time_s), np.array(link.rows), where)
        return Motion(link.is_static, is_down, time_s, rows[:, :3], normalised(rows[:, 3:], where))


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


def pose_row(position: Any, quaternion: Any, scale_mm: float, where: str) -> list[float]:
    """x y z in mm and w x y z of a message's position and orientation. Raises InputError for what is no number."""
    row = [scale_mm * float(v) for v in (position.x, position.y, position.z)]
    row += [float(v) for v in (quaternion.w, quaternion.x, quaternion.y, quaternion.z)]
    if not np.isfinite(row).all():
        raise InputError(where, f"expected numbers for position and orientation, found {row}")
    return row


def frame_name(name: str) -> str:
    """A frame's name; ROS 1 knew it with a leading slash."""
    return name.lstrip("/")
