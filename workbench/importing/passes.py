"""Sources to scanning passes: which frames belong together, and which poses belong to them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from workbench.errors import InputError
from workbench.importing.neutral import PoseStream, ProfileFrames
from workbench.units import Float, Float32, Int


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
    light = [source.intensity for source in sources if source.intensity is not None]
    return replace(
        first,
        x_mm=np.concatenate([_widened(source.x_mm, width) for source in sources]),
        z_mm=np.concatenate([_widened(source.z_mm, width) for source in sources]),
        intensity=_light(light, width) if len(light) == len(sources) else None,
        time_s=_all_or_none(sources, "time_s", "times"),
        travel_mm=_all_or_none(sources, "travel_mm", "travel"),
        pass_index=(np.zeros(len(sources), np.int64) if max(counts) == 1 and not each_a_pass else _numbered(sources)),
    )


def _widened(grid: Float32, width: int) -> Float32:
    return np.pad(grid, ((0, 0), (0, width - grid.shape[1])), constant_values=np.nan)


def _light(grids: Sequence[np.ndarray], width: int) -> np.ndarray:
    return np.concatenate([np.pad(grid, ((0, 0), (0, width - grid.shape[1]))) for grid in grids])


def _all_or_none(sources: Sequence[ProfileFrames], name: str, what: str) -> Float | None:
    values = [getattr(source, name) for source in sources]
    present = [value is not None for value in values]
    if any(present) and not all(present):
        lone = sources[present.index(False)]
        raise InputError(lone.source, f"has no {what}, but {sources[present.index(True)].source} has")
    return np.concatenate(values) if all(present) else None


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


def poses_by_pass(
    streams: Sequence[PoseStream], frames: ProfileFrames, pose_each: bool = False
) -> dict[int, PoseStream]:
    """The poses of each pass.

    One stream serves all passes (by its own pass numbers where it has them; in order, where `pose_each` says that it
    has one pose a frame); as many streams as passes serve one each, in the order given.

    Raises:
        InputError: another number of streams, or a pass without poses.
    """
    assert frames.pass_index is not None
    numbers = [int(number) for number in np.unique(frames.pass_index)]
    alone = streams[0] if len(streams) == 1 else None
    if alone and pose_each and alone.pass_index is None and len(alone.position_mm) == len(frames.pass_index):
        return {n: chosen_poses(alone, np.flatnonzero(frames.pass_index == n)) for n in numbers}
    if alone:
        return {number: _of_pass(alone, number) for number in numbers}
    if len(streams) != len(numbers):
        what = f"expected poses once for all or once for each of {len(numbers)} passes, found {len(streams)} sources"
        raise InputError(streams[-1].source if streams else frames.source, what)
    for stream in streams:
        if stream.pass_index is not None:
            raise InputError(stream.source, "has pass numbers of its own: expected it to be the only source of poses")
    return dict(zip(numbers, streams, strict=True))


def _of_pass(stream: PoseStream, number: int) -> PoseStream:
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
        time_s=None if stream.time_s is None else stream.time_s[index],
        pass_index=None,
    )
