"""Sources to scanning passes, and these to one recording that `scan.read` would accept."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from workbench.artefacts import LINEAR_AXIS, UNKNOWN_PART, Part, Recording
from workbench.errors import InputError
from workbench.geometry.moves import arc_lengths_mm
from workbench.importing import tracker
from workbench.importing.joints import NO_ROBOT
from workbench.importing.mapping import LinearAxisPart, Mapping, TimesPart
from workbench.importing.neutral import Imported, PoseStream, ProfileFrames, TimedPass
from workbench.importing.suspicions import check_motion, check_poses, check_profiles
from workbench.scan.checks import checked, read_hand_eye
from workbench.units import AnyArray, Bool, Float, Int


def assemble(sources: Sequence[Imported], mapping: Mapping) -> tuple[Recording, tuple[str, ...]]:
    """One recording of all sources, and lines that say how it came about.

    Raises:
        InputError: something is missing, contradictory or implausible, with the source and what was expected.
    """
    for source in sources:
        if source.tracker is not None:
            raise InputError(source.tracker.source, f"{tracker.NAME}: {tracker.INTO_A_TABLE}")
    profiles = [source.profiles for source in sources if source.profiles is not None]
    frames = joined(profiles, each_a_pass=mapping.sphere_diameter_mm is not None)
    check_profiles(frames, mapping)
    streams = [source.poses for source in sources if source.poses is not None]
    for source in sources:
        if source.joints is not None and not streams:
            raise InputError(source.joints.source, NO_ROBOT)
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
    axis = mapping.linear_axis
    if axis is not None and streams:
        raise InputError(streams[0].source, "holds poses, but the mapping names a linear_axis: expected one of them")
    if axis is None and not streams and frames.travel_mm is not None and mapping.hand_eye is None:
        axis = LinearAxisPart()  # what the file says: it went its travel along its own y
    if axis is not None:
        return {int(n): on_linear_axis(_of_pass(frames, int(n)), axis, mapping.times) for n in numbers}
    if not streams:
        raise InputError(frames.source, "expected poses too: a file of poses, or linear_axis in the mapping")
    for stream in streams:
        check_poses(stream, mapping)
    pose_each = mapping.times is not None and mapping.times.source == "pose_each"
    each = poses_by_pass(streams, frames, pose_each)
    return {number: timed(_of_pass(frames, number), poses, mapping) for number, poses in each.items()}


def _of_pass(frames: ProfileFrames, number: int) -> ProfileFrames:
    """Times and travel of one pass's frames; their points, which are large, stay where they are."""
    chosen = np.asarray(frames.pass_index == number)
    return replace(
        frames,
        x_mm=frames.x_mm[chosen, :0],
        z_mm=frames.z_mm[chosen, :0],
        time_s=_some(frames.time_s, chosen),
        travel_mm=_some(frames.travel_mm, chosen),
        intensity=None,
        pass_index=None,
    )


def _some(values: Float | None, chosen: Bool | Int | slice) -> Float | None:
    return None if values is None else values[chosen]


def _hand_eye(sources: Sequence[Imported], mapping: Mapping) -> tuple[Float | None, str]:
    """Pose of the profiler on the flange and where it came from."""
    if mapping.hand_eye is not None:
        if mapping.hand_eye.file is not None:
            path = mapping.base_dir / mapping.hand_eye.file
            return read_hand_eye(path).flange_from_profiler, f"from {path}"
        convention = f" ({mapping.hand_eye.convention})" if mapping.hand_eye.convention else ""
        return mapping.hand_eye.pose(), f"from the mapping{convention}"
    if mapping.linear_axis is not None or not any(source.poses is not None for source in sources):
        return np.eye(4), "none needed on a linear axis: the profiler's frame is the flange's"
    return None, "none: a pipeline must name one (input hand_eye)"


def _part(frames: ProfileFrames, mapping: Mapping, axis: bool) -> Part:
    """What the mapping says of the part; the sensor as the profiles name it where the mapping does not."""
    said = UNKNOWN_PART.with_names(mapping.names())
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
    inside = list(zip(passes.items(), kept, strict=True))
    order = np.concatenate([np.flatnonzero(frames.pass_index == n)[k] for (n, _), k in inside])
    whole = len(order) == len(frames.z_mm) and (np.diff(order) == 1).all()
    pick = slice(None) if whole else order
    poses = [around(one, k) for (_, one), k in inside]
    values = {
        "time_s": np.concatenate([one.time_s[k] for (_, one), k in inside]),
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
        f'({one.note}; another clock or unit, or "outside": "trim" in the mapping)',
    )


def around(one: TimedPass, inside: Bool) -> PoseStream:
    """The poses from the last before the first frame to the first after the last one."""
    pose_time_s = one.poses.time_s
    assert pose_time_s is not None
    time_s = one.time_s[inside]
    begin = max(0, int(np.searchsorted(pose_time_s, time_s.min(), side="right")) - 1)
    end = int(np.searchsorted(pose_time_s, time_s.max(), side="left")) + 1
    return chosen_poses(one.poses, slice(begin, max(end, begin + 1)))


# When each frame of a pass was taken, on the robot's clock, and the poses around it.

FAR_FUTURE_S = 1e10  # what is beyond was not counted in the unit that is declared


def timed(frames: ProfileFrames, poses: PoseStream, mapping: Mapping) -> TimedPass:
    """The times of a pass's frames by the mapping's way; by the file's own times where both sides have some.

    Raises:
        InputError: the way needs something that the files lack; pose times that do not rise.
    """
    part = mapping.times or TimesPart(source="file")
    if mapping.times is None and (frames.time_s is None or poses.time_s is None):
        ways = "rate, pose_each" + (", travel" if frames.travel_mm is not None else "")
        what = f"has no times: expected 'times' in the mapping, with source one of {ways}"
        raise InputError(frames.source if frames.time_s is None else poses.source, what)
    _check_rising(poses)
    if part.source == "travel":
        return by_travel(frames, poses, part)
    if part.source == "pose_each":
        return _by_pose(frames, poses)
    if poses.time_s is None:
        raise InputError(poses.source, "has no times: expected poses with times, or 'times' from travel or pose_each")
    return _by_clock(frames, poses, poses.time_s, part)


def _by_clock(frames: ProfileFrames, poses: PoseStream, pose_time_s: Float, part: TimesPart) -> TimedPass:
    if part.source == "rate":
        from_pose = part.start_s == "first_pose"
        start_s = float(pose_time_s[0] if from_pose else part.start_s)  # type: ignore[arg-type]  # the part has one
        note = f"{part.rate_hz:g} frames a second from {'the first pose' if from_pose else start_s} on"
        return TimedPass(start_s + np.arange(len(frames.z_mm)) / part.rate_hz, poses, note)  # type: ignore[operator]
    if frames.time_s is None:
        raise InputError(frames.source, "has no times: expected another 'times.source' than 'file' in the mapping")
    offset = f", {part.clock_offset_s:g} s taken off" if part.clock_offset_s else ", taken as the robot's clock"
    return TimedPass(frames.time_s - part.clock_offset_s, poses, f"the file's{offset}")


def _by_pose(frames: ProfileFrames, poses: PoseStream) -> TimedPass:
    count = len(frames.z_mm)
    if len(poses.position_mm) != count:
        raise InputError(poses.source, f"expected a pose for each of {count} frames, found {len(poses.position_mm)}")
    if poses.time_s is not None:
        return TimedPass(poses.time_s, poses, "the poses' own, one pose per frame")
    time_s = np.arange(float(count))
    return TimedPass(time_s, replace(poses, time_s=time_s), "none: frames counted, one pose per frame", has_clock=False)


def _check_rising(poses: PoseStream) -> None:
    if poses.time_s is None:
        return
    if (largest := np.abs(poses.time_s).max()) > FAR_FUTURE_S:
        what = f"expected times in {poses.time_unit}, found {largest:.4g} s: is the unit wrong?"
        raise InputError(poses.source, what)
    stuck = np.flatnonzero(np.diff(poses.time_s) <= 0)
    if len(stuck):
        what = f"expected times that rise, found {poses.time_s[stuck[0] + 1]:.9g} s again"
        raise InputError(f"{poses.source}: pose {stuck[0] + 2}", what)


# Frames placed by the way that has been gone: an encoder's reading, or the y of a surface.

CHORD_MM = 1.0  # the way is summed over chords of this length: over shorter ones the poses' noise would lengthen it


def by_travel(frames: ProfileFrames, poses: PoseStream, part: TimesPart) -> TimedPass:
    """The flange's way since its first pose is by how much travel has moved, up or down, since its reading there.

    Raises:
        InputError: no travel and no pitch, or travel that runs both ways.
    """
    assert part.start_mm is not None
    travel_mm = _travel(frames, part.pitch_mm) - part.start_mm
    travel_mm = np.negative(travel_mm) if travel_mm[-1] < travel_mm[0] else travel_mm  # it may count down
    poses = chosen_poses(poses, strides(poses.position_mm, CHORD_MM))
    way_mm = arc_lengths_mm(poses.position_mm)
    reading = f"{travel_mm.min():.4g} to {travel_mm.max():.4g} mm on its {way_mm[-1]:.4g} mm"
    note, has_clock = f"from travel along the flange's way, {reading}", poses.time_s is not None
    if poses.time_s is None:
        poses, note = replace(poses, time_s=way_mm), f"{note}; no clock: a mm of it counts as a second"
    assert poses.time_s is not None
    time_s = np.interp(travel_mm, way_mm, poses.time_s)
    over_mm = np.maximum(travel_mm - way_mm[-1], 0.0) + np.minimum(travel_mm, 0.0)
    outside = np.abs(over_mm) > 1e-3  # encoders and poses are written with three digits and more
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
    """A pass of a profiler on a straight axis: one pose per frame, no turn; the base is where the first frame was."""
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
        before, after = frames.travel_mm[wrong[0] : wrong[0] + 2]
        raise InputError(
            f"{frames.source}: frame {wrong[0] + 2}",
            f"expected travel that runs one way, found {after:.6g} mm after {before:.6g}: "
            "did the counter wrap, or lose counts?",
        )
    return frames.travel_mm


def joined(sources: Sequence[ProfileFrames], each_a_pass: bool = False) -> ProfileFrames:
    """All frames: a source is a pass; sources of one frame each are the frames of one pass, in the order given.

    Args:
        sources: frames of each source.
        each_a_pass: sources of one frame each are passes too (postures held still, for calibration).

    Raises:
        InputError: no source, frames alone among whole passes, times or travel in some sources only.
    """
    if not sources:
        raise InputError("sources", "expected a file of profiles, found none among them")
    counts = [len(source.z_mm) for source in sources]
    if min(counts) == 1 and max(counts) > 1:
        lone = sources[counts.index(1)]
        raise InputError(lone.source, "holds a single frame beside sources of several: import them one by one")
    first = sources[0]
    if len(sources) == 1:
        number = np.zeros(counts[0], np.int64) if first.pass_index is None else np.asarray(first.pass_index)
        return replace(first, pass_index=number)
    width = max(source.z_mm.shape[1] for source in sources)
    light = all(source.intensity is not None for source in sources)
    return replace(
        first,
        x_mm=_stacked(sources, "x_mm", width, np.nan),
        z_mm=_stacked(sources, "z_mm", width, np.nan),
        intensity=_stacked(sources, "intensity", width, 0) if light else None,
        time_s=_all_or_none(sources, "time_s", "times"),
        travel_mm=_all_or_none(sources, "travel_mm", "travel"),
        pass_index=(np.zeros(len(sources), np.int64) if max(counts) == 1 and not each_a_pass else _numbered(sources)),
    )


def _stacked(sources: Sequence[ProfileFrames], name: str, width: int, filler: float) -> AnyArray:
    """The grids of all sources, one below the other; narrower ones are filled up to `width`."""
    grids = [getattr(source, name) for source in sources]
    return np.concatenate(
        [np.pad(grid, ((0, 0), (0, width - grid.shape[1])), constant_values=filler) for grid in grids]
    )


def _all_or_none(sources: Sequence[ProfileFrames], name: str, what: str) -> Float | None:
    having = [source for source in sources if getattr(source, name) is not None]
    lacking = [source for source in sources if getattr(source, name) is None]
    if having and lacking:
        raise InputError(lacking[0].source, f"has no {what}, but {having[0].source} has")
    return np.concatenate([getattr(source, name) for source in having]) if having else None


def _numbered(sources: Sequence[ProfileFrames]) -> Int:
    """Pass numbers from 0; a source's own passes follow each other."""
    numbers, begin = [], 0
    for source in sources:
        own = np.zeros(len(source.z_mm), np.int64)
        if source.pass_index is not None:
            own = np.unique(source.pass_index, return_inverse=True)[1]
        numbers.append(begin + own)
        begin += int(own.max()) + 1
    return np.concatenate(numbers)


def poses_by_pass(streams: Sequence[PoseStream], frames: ProfileFrames, pose_each: bool) -> dict[int, PoseStream]:
    """The poses of each pass.

    One stream serves all passes (by its own pass numbers where it has them; in order, where `pose_each` says that it
    has one pose per frame); as many streams as passes serve one each, in the order given.

    Raises:
        InputError: another number of streams, or a pass without poses.
    """
    assert frames.pass_index is not None
    numbers = [int(number) for number in np.unique(frames.pass_index)]
    alone = streams[0] if len(streams) == 1 else None
    if alone and pose_each and alone.pass_index is None and len(alone.position_mm) == len(frames.pass_index):
        return {n: chosen_poses(alone, np.flatnonzero(frames.pass_index == n)) for n in numbers}
    if alone:
        return {number: _frames_of(alone, number) for number in numbers}
    if len(streams) != len(numbers):
        what = f"expected poses once for all or once for each of {len(numbers)} passes, found {len(streams)} sources"
        raise InputError(streams[-1].source if streams else frames.source, what)
    for stream in streams:
        if stream.pass_index is not None:
            raise InputError(stream.source, "has pass numbers of its own: expected it to be the only source of poses")
    return dict(zip(numbers, streams, strict=True))


def _frames_of(stream: PoseStream, number: int) -> PoseStream:
    if stream.pass_index is None:
        return stream
    chosen = stream.pass_index == number
    if not chosen.any():
        known = ", ".join(map(str, np.unique(stream.pass_index)[:12]))
        raise InputError(stream.source, f"expected poses of pass {number}, found passes {known}")
    return chosen_poses(stream, np.flatnonzero(chosen))


def chosen_poses(stream: PoseStream, index: Int | slice) -> PoseStream:
    """Some poses of a stream."""
    return replace(
        stream,
        position_mm=stream.position_mm[index],
        quaternion_wxyz=stream.quaternion_wxyz[index],
        time_s=_some(stream.time_s, index),
        pass_index=None,
    )
