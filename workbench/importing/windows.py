"""Frames and the poses around them in time."""

from __future__ import annotations

import numpy as np

from workbench.errors import InputError
from workbench.importing.mapping import Mapping
from workbench.importing.neutral import PoseStream, TimedPass
from workbench.importing.passes import chosen_poses
from workbench.units import Bool


def within(one: TimedPass, mapping: Mapping, source: str) -> Bool:
    """Which frames lie within the poses' times; frames outside are refused unless the mapping trims them."""
    pose_time_s = one.poses.time_s
    assert pose_time_s is not None
    inside = (one.time_s >= pose_time_s[0]) & (one.time_s <= pose_time_s[-1])
    if mapping.sphere_diameter_mm is not None and len(pose_time_s) == 1:
        return np.ones(len(inside), bool)
    if inside.all() or (mapping.outside == "trim" and inside.any()):
        return np.asarray(inside)
    row = int(np.flatnonzero(~inside)[0])
    raise InputError(
        f"{source}: frame {row + 1}",
        f"{(~inside).sum()} of {len(inside)} frames lie outside the poses of {one.poses.source}: expected "
        f"{pose_time_s[0]:.9g} to {pose_time_s[-1]:.9g} s, found {one.time_s[row]:.9g} s "
        '(other clock, or "outside": "trim" in the mapping)',
    )


def around(one: TimedPass, inside: Bool) -> PoseStream:
    """The poses from the last before the first frame to the first after the last one."""
    pose_time_s = one.poses.time_s
    assert pose_time_s is not None
    time_s = one.time_s[inside]
    begin = max(0, int(np.searchsorted(pose_time_s, time_s.min(), side="right")) - 1)
    end = int(np.searchsorted(pose_time_s, time_s.max(), side="left")) + 1
    return chosen_poses(one.poses, slice(begin, max(end, begin + 1)))
