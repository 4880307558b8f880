"""When each frame of a pass was taken, on the robot's clock, and the poses around it."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from workbench.errors import InputError
from workbench.importing.mapping import LinearAxisPart, Mapping, TimesPart
from workbench.importing.neutral import PoseStream, ProfileFrames
from workbench.importing.passes import chosen_poses
from workbench.units import Float

FAR_FUTURE_S = 1e10  # what is beyond was not counted in the unit that is declared


class TimedPass(NamedTuple):
    """One pass on the robot's clock."""

    time_s: Float  # (n,) of its frames
    poses: PoseStream  # with times
    note: str  # how the times came about


def timed(frames: ProfileFrames, poses: PoseStream, mapping: Mapping) -> TimedPass:
    """The times of a pass's frames by the mapping's way; by the file's own times where both sides have some.

    Raises:
        InputError: the way needs something that the files lack; pose times that do not rise.
    """
    part = mapping.times or _usual(frames, poses)
    _check_rising(poses)
    return {"file": _by_file, "rate": _by_rate, "travel": _by_travel, "pose_each": _by_pose}[part.source](
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
        poses, note = replace(poses, time_s=np.arange(float(count))), "none: frames counted, one pose a frame"
    assert poses.time_s is not None
    return TimedPass(poses.time_s, poses, note)


def _by_travel(frames: ProfileFrames, poses: PoseStream, part: TimesPart) -> TimedPass:
    """Travel is the flange's way since its first pose, plus the reading there."""
    assert part.start_mm is not None
    travel_mm = _travel(frames, part.pitch_mm) - part.start_mm
    way_mm = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(poses.position_mm, axis=0), axis=1)))
    note = "from travel along the flange's way"
    if poses.time_s is None:
        moving = np.append(True, np.diff(way_mm) > 0)
        poses = chosen_poses(poses, np.flatnonzero(moving))
        way_mm = way_mm[moving]
        poses, note = replace(poses, time_s=way_mm), f"{note}; no clock: a mm of it counts as a second"
    assert poses.time_s is not None
    moving = np.append(True, np.diff(way_mm) > 0)
    time_s = np.interp(travel_mm, way_mm[moving], poses.time_s[moving])
    slope = poses.time_s[-1] - poses.time_s[0] + 1.0  # beyond the way: outside the poses' times, for trimming
    over_mm = np.maximum(travel_mm - way_mm[-1], 0.0) + np.minimum(travel_mm, 0.0)
    tolerance_mm = 1e-9 * (1.0 + way_mm[-1])
    return TimedPass(time_s + np.where(np.abs(over_mm) > tolerance_mm, slope * over_mm, 0.0), poses, note)


def on_linear_axis(frames: ProfileFrames, axis: LinearAxisPart, part: TimesPart | None) -> TimedPass:
    """A pass of a profiler on a straight axis: a pose a frame, no turn; the base is where the first frame was."""
    travel_mm = _travel(frames, part.pitch_mm if part else None)
    length = float(np.linalg.norm(axis.direction))
    if length == 0:
        raise InputError("mapping: linear_axis.direction", "expected a direction, found 0, 0, 0")
    way_mm = np.abs(travel_mm - travel_mm[0])
    position_mm = (travel_mm - travel_mm[0])[:, None] * np.array(axis.direction) / length
    time_s = way_mm / axis.speed_mm_s
    quaternion = np.tile([1.0, 0.0, 0.0, 0.0], (len(time_s), 1))
    poses = PoseStream(f"{frames.source}: linear axis", position_mm, quaternion, time_s)
    return TimedPass(time_s, poses, f"from travel at {axis.speed_mm_s:g} mm/s")


def _travel(frames: ProfileFrames, pitch_mm: float | None) -> Float:
    """Way along the scan of each frame, running one way."""
    if frames.travel_mm is None:
        if pitch_mm is None:
            raise InputError(frames.source, "has no travel: expected 'times.pitch_mm' in the mapping")
        return np.asarray(np.arange(len(frames.z_mm)) * pitch_mm)
    if pitch_mm is not None:
        raise InputError(frames.source, "has travel of its own: expected no 'times.pitch_mm' in the mapping")
    step_mm = np.diff(frames.travel_mm)
    wrong = np.flatnonzero(step_mm * np.sign(step_mm[:1].sum()) <= 0)
    if len(wrong):
        raise InputError(f"{frames.source}: frame {wrong[0] + 2}", "expected travel that runs one way")
    return frames.travel_mm


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
