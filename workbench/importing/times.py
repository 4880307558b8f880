"""When each frame of a pass was taken, on the robot's clock, and the poses around it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from workbench.errors import InputError
from workbench.importing.mapping import Mapping, TimesPart
from workbench.importing.neutral import PoseStream, ProfileFrames, TimedPass
from workbench.importing.travel import by_travel
from workbench.units import Float

FAR_FUTURE_S = 1e10  # what is beyond was not counted in the unit that is declared


def timed(frames: ProfileFrames, poses: PoseStream, mapping: Mapping) -> TimedPass:
    """The times of a pass's frames by the mapping's way; by the file's own times where both sides have some.

    Raises:
        InputError: the way needs something that the files lack; pose times that do not rise.
    """
    part = mapping.times or _usual(frames, poses)
    _check_rising(poses)
    return {"file": _by_file, "rate": _by_rate, "travel": by_travel, "pose_each": _by_pose}[part.source](
        frames, poses, part
    )


def _usual(frames: ProfileFrames, poses: PoseStream) -> TimesPart:
    if frames.time_s is None or poses.time_s is None:
        lacking = frames.source if frames.time_s is None else poses.source
        has_travel = frames.travel_mm is not None
        ways = "rate, pose_each" + (", travel" if has_travel else "")
        raise InputError(lacking, f"has no times: expected 'times' in the mapping, with source one of {ways}")
    return TimesPart(source="file")


def _by_file(frames: ProfileFrames, poses: PoseStream, part: TimesPart) -> TimedPass:
    if frames.time_s is None:
        raise InputError(frames.source, "has no times: expected another 'times.source' than 'file' in the mapping")
    _pose_times(poses)
    offset = f", {part.clock_offset_s:g} s taken off" if part.clock_offset_s else ", taken as the robot's clock"
    return TimedPass(frames.time_s - part.clock_offset_s, poses, f"the file's{offset}")


def _by_rate(frames: ProfileFrames, poses: PoseStream, part: TimesPart) -> TimedPass:
    assert part.rate_hz is not None
    assert part.start_s is not None
    pose_time_s = _pose_times(poses)
    start_s = float(pose_time_s[0]) if part.start_s == "first_pose" else part.start_s
    note = f"{part.rate_hz:g} frames a second from {'the first pose' if part.start_s == 'first_pose' else start_s} on"
    return TimedPass(np.asarray(start_s + np.arange(len(frames.z_mm)) / part.rate_hz), poses, note)


def _by_pose(frames: ProfileFrames, poses: PoseStream, part: TimesPart) -> TimedPass:
    count = len(frames.z_mm)
    if len(poses.position_mm) != count:
        raise InputError(poses.source, f"expected a pose for each of {count} frames, found {len(poses.position_mm)}")
    note = "the poses' own, one pose a frame"
    if poses.time_s is None:
        time_s = np.arange(float(count))
        note = "none: frames counted, one pose a frame"
        return TimedPass(time_s, replace(poses, time_s=time_s), note, has_clock=False)
    return TimedPass(poses.time_s, poses, note)


def _pose_times(poses: PoseStream) -> Float:
    if poses.time_s is None:
        raise InputError(poses.source, "has no times: expected poses with times, or 'times' from travel or pose_each")
    return poses.time_s


def _check_rising(poses: PoseStream) -> None:
    if poses.time_s is None:
        return
    if np.abs(poses.time_s).max() > FAR_FUTURE_S:
        what = f"expected times in {poses.time_unit}, found {np.abs(poses.time_s).max():.4g} s: is the unit wrong?"
        raise InputError(poses.source, what)
    stuck = np.flatnonzero(np.diff(poses.time_s) <= 0)
    if len(stuck):
        raise InputError(
            f"{poses.source}: pose {stuck[0] + 2}",
            f"expected times that rise, found {poses.time_s[stuck[0] + 1]:.9g} s again",
        )
