"""Frames placed by the way that has been gone: an encoder's reading, or the y of a surface."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from workbench.errors import InputError
from workbench.importing.mapping import LinearAxisPart, TimesPart
from workbench.importing.neutral import PoseStream, ProfileFrames, TimedPass
from workbench.importing.passes import chosen_poses
from workbench.units import Float, Int

CHORD_MM = 1.0  # the way is summed over chords of this length: over shorter ones the poses' noise would lengthen it


def by_travel(frames: ProfileFrames, poses: PoseStream, part: TimesPart) -> TimedPass:
    """Travel is the flange's way since its first pose, plus the reading there.

    Raises:
        InputError: no travel and no pitch, or travel that runs both ways.
    """
    assert part.start_mm is not None
    travel_mm = _travel(frames, part.pitch_mm) - part.start_mm
    poses = chosen_poses(poses, strides(poses.position_mm, CHORD_MM))
    way_mm = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(poses.position_mm, axis=0), axis=1)))
    note, has_clock = "from travel along the flange's way", poses.time_s is not None
    if poses.time_s is None:
        poses, note = replace(poses, time_s=way_mm), f"{note}; no clock: a mm of it counts as a second"
    assert poses.time_s is not None
    time_s = np.interp(travel_mm, way_mm, poses.time_s)
    over_mm = np.maximum(travel_mm - way_mm[-1], 0.0) + np.minimum(travel_mm, 0.0)
    outside = np.abs(over_mm) > 1e-9 * (1.0 + way_mm[-1])
    time_s += np.where(outside, np.sign(over_mm) + over_mm, 0.0)  # any time beyond the poses' times, rising
    return TimedPass(time_s, poses, note, has_clock)


def strides(position_mm: Float, least_mm: float) -> Int:
    """Indices of positions (K, 3) at least `least_mm` apart, one after another; the first and the last always."""
    kept = [0]
    for i in range(1, len(position_mm)):
        if np.linalg.norm(position_mm[i] - position_mm[kept[-1]]) >= least_mm:
            kept.append(i)
    if kept[-1] != len(position_mm) - 1 and (position_mm[-1] != position_mm[kept[-1]]).any():
        kept.append(len(position_mm) - 1)
    return np.array(kept)


def on_linear_axis(frames: ProfileFrames, axis: LinearAxisPart, part: TimesPart | None) -> TimedPass:
    """A pass of a profiler on a straight axis: a pose a frame, no turn; the base is where the first frame was."""
    travel_mm = _travel(frames, part.pitch_mm if part else None)
    way_mm = travel_mm - travel_mm[0]
    position_mm = way_mm[:, None] * np.array(axis.direction) / np.linalg.norm(axis.direction)
    time_s = np.abs(way_mm) / (axis.speed_mm_s or 1.0)
    quaternion_wxyz = np.tile([1.0, 0.0, 0.0, 0.0], (len(time_s), 1))
    poses = PoseStream(f"{frames.source}: linear axis", position_mm, quaternion_wxyz, time_s)
    direction = ", ".join(f"{v:g}" for v in axis.direction)
    speed = f"at {axis.speed_mm_s:g} mm/s" if axis.speed_mm_s else "no clock: a mm of it counts as a second"
    note = f"from travel along ({direction}) of the profiler's frame, no turn; {speed}"
    return TimedPass(time_s, poses, note, has_clock=axis.speed_mm_s is not None)


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
