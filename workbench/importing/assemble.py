"""Frames and poses of all sources to one recording that `scan.read` would accept."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields, replace
from typing import Any

import numpy as np

from workbench.artefacts import LINEAR_AXIS, Part, PartNames, Recording
from workbench.errors import InputError
from workbench.importing.mapping import LinearAxisPart, Mapping
from workbench.importing.neutral import Imported, PoseStream, ProfileFrames, TimedPass
from workbench.importing.passes import chosen_poses, joined, poses_by_pass
from workbench.importing.stamps import stamped
from workbench.importing.suspicions import check_motion, check_poses, check_profiles
from workbench.importing.times import timed
from workbench.importing.travel import on_linear_axis
from workbench.scan.checks import checked
from workbench.scan.hand_eye import read_hand_eye
from workbench.units import Bool, Float


def assemble(sources: Sequence[Imported], mapping: Mapping) -> tuple[Recording, tuple[str, ...]]:
    """One recording of all sources, and lines that say how it came about.

    Raises:
        InputError: something is missing, contradictory or implausible, with the source and what was expected.
    """
    sources = stamped(sources, mapping)
    profiles = [source.profiles for source in sources if source.profiles is not None]
    frames = joined(profiles, each_a_pass=mapping.sphere_diameter_mm is not None)
    check_profiles(frames, mapping)
    streams = [source.poses for source in sources if source.poses is not None]
    passes = _passes(frames, streams, mapping)
    kept = [within(one, mapping, frames.source) for one in passes.values()]
    lost = sum(int((~inside).sum()) for inside in kept)
    flange_from_profiler, origin = _hand_eye(sources, mapping)
    recording = _recording(frames, passes, kept, flange_from_profiler, mapping, axis=not streams)
    if any(source.poses is not None for source in sources) and mapping.sphere_diameter_mm is None:
        check_motion(recording, all(one.has_clock for one in passes.values()), mapping)
    notes = [f"times: {'; '.join(dict.fromkeys(one.note for one in passes.values()))}", f"hand-eye: {origin}"]
    if lost:
        notes.insert(1, f"left out: {lost} of {len(frames.z_mm)} frames, outside the poses' times")
    return recording, tuple(notes)


def _passes(frames: ProfileFrames, streams: list[PoseStream], mapping: Mapping) -> dict[int, TimedPass]:
    """Every pass on the robot's clock, by number."""
    assert frames.pass_index is not None
    numbers = np.unique(frames.pass_index)
    if mapping.linear_axis is not None:
        if streams:
            raise InputError(
                streams[0].source, "holds poses, but the mapping names a linear_axis: expected one of them"
            )
        axis = mapping.linear_axis
        return {int(n): on_linear_axis(_of_pass(frames, int(n)), axis, mapping.times) for n in numbers}
    if not streams and frames.travel_mm is not None and mapping.hand_eye is None:
        axis = LinearAxisPart()  # what the file says: it went its travel along its own y
        return {int(n): on_linear_axis(_of_pass(frames, int(n)), axis, mapping.times) for n in numbers}
    if not streams:
        raise InputError(frames.source, "expected poses too: a file of poses, or linear_axis in the mapping")
    for stream in streams:
        check_poses(stream, mapping)
    pose_each = mapping.times is not None and mapping.times.source == "pose_each"
    return {
        number: timed(_of_pass(frames, number), poses, mapping)
        for number, poses in poses_by_pass(streams, frames, pose_each).items()
    }


def _of_pass(frames: ProfileFrames, number: int) -> ProfileFrames:
    """Times and travel of one pass's frames; their points, which are large, stay where they are."""
    assert frames.pass_index is not None
    chosen = frames.pass_index == number
    return replace(
        frames,
        x_mm=frames.x_mm[chosen, :0],
        z_mm=frames.z_mm[chosen, :0],
        time_s=None if frames.time_s is None else frames.time_s[chosen],
        travel_mm=None if frames.travel_mm is None else frames.travel_mm[chosen],
        intensity=None,
        pass_index=None,
    )


def _hand_eye(sources: Sequence[Imported], mapping: Mapping) -> tuple[Float | None, str]:
    """Pose of the profiler on the flange and where it came from."""
    if mapping.hand_eye is not None:
        if mapping.hand_eye.file is not None:
            path = mapping.base_dir / mapping.hand_eye.file
            return read_hand_eye(path).flange_from_profiler, f"from {path}"
        told = f" ({mapping.hand_eye.convention})" if mapping.hand_eye.convention else ""
        return mapping.hand_eye.pose(), f"from the mapping{told}"
    own = [source.flange_from_profiler for source in sources if source.flange_from_profiler is not None]
    if any(not np.allclose(pose, own[0], atol=1e-9) for pose in own):
        raise InputError("sources", "carry different hand-eye poses: expected one, or hand_eye in the mapping")
    if own:
        return own[0], "from the source"
    if mapping.linear_axis is not None or not any(source.poses is not None for source in sources):
        return np.eye(4), "none needed on a linear axis: the profiler's frame is the flange's"
    return None, "none: a pipeline must name one (input hand_eye)"


def _part(frames: ProfileFrames, mapping: Mapping, axis: bool) -> Part:
    """What the mapping says of the part; the sensor as the profiles name it where the mapping does not."""
    try:
        said = Part(**{field.name: getattr(mapping, field.name) for field in fields(PartNames)})
    except ValueError as error:
        raise InputError("mapping", str(error)) from None
    said = replace(said, robot=LINEAR_AXIS) if axis and said.robot is None else said
    return said if said.sensor is not None else replace(said, sensor=frames.sensor)


def _recording(
    frames: ProfileFrames,
    passes: dict[int, TimedPass],
    kept: list[Bool],
    flange_from_profiler: Float | None,
    mapping: Mapping,
    axis: bool,
) -> Recording:
    """The recording, checked as scan.read checks it."""
    assert frames.pass_index is not None
    order = np.concatenate([np.flatnonzero(frames.pass_index == n)[k] for n, k in zip(passes, kept, strict=True)])
    whole = len(order) == len(frames.z_mm) and (np.diff(order) == 1).all()
    pick = slice(None) if whole else order
    time_s = np.concatenate([one.time_s[k] for one, k in zip(passes.values(), kept, strict=True)])
    poses = [around(one, k) for one, k in zip(passes.values(), kept, strict=True)]
    values = {
        "time_s": time_s,
        "pass_index": frames.pass_index[pick],
        "robot_time_s": np.concatenate([stream.time_s for stream in poses if stream.time_s is not None]),
        "robot_position_mm": np.concatenate([stream.position_mm for stream in poses]),
        "robot_quaternion_wxyz": np.concatenate([stream.quaternion_wxyz for stream in poses]),
        "robot_pass": np.repeat(list(passes), [len(stream.position_mm) for stream in poses]),
    }
    if flange_from_profiler is not None:
        values["flange_from_profiler"] = flange_from_profiler
    fields: dict[str, Any] = checked(frames.source, values, mapping.sphere_diameter_mm is not None, "robot")
    return Recording(
        source=frames.source,
        x_mm=frames.x_mm[pick],
        z_mm=frames.z_mm[pick],
        intensity=None if frames.intensity is None else frames.intensity[pick],
        sphere_diameter_mm=mapping.sphere_diameter_mm,
        part=_part(frames, mapping, axis),
        **fields,
    )


# Frames and the poses around them in time.


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
