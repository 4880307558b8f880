"""Scanning passes: profiles told apart by topic and by gaps in time, poses dealt out to them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from workbench.importing.neutral import PoseStream, ProfileFrames
from workbench.units import Int


def passes_by_gaps(profiles: ProfileFrames, gap_s: float | None) -> Int | None:
    """Passes (N,) from 0: a new one with each topic and after each gap longer than `gap_s`; None: there is one."""
    assert profiles.time_s is not None
    assert profiles.pass_index is not None
    begins = np.diff(profiles.pass_index) != 0
    if gap_s is not None:
        begins |= np.diff(profiles.time_s) > gap_s
    return np.concatenate([[0], np.cumsum(begins)]) if begins.any() else None


def poses_by_pass(poses: PoseStream, profiles: ProfileFrames, clock_offset_s: float) -> PoseStream:
    """One stream of poses dealt out to the passes of the profiles: of each pass, those from before it to after it.

    Neighbouring passes may share a pose. `clock_offset_s`: profile time = robot time + offset.
    """
    if profiles.pass_index is None or poses.time_s is None:
        return poses
    assert profiles.time_s is not None
    rows, numbers, last = [], [], len(poses.time_s) - 1
    for number in np.unique(profiles.pass_index):
        time_s = profiles.time_s[profiles.pass_index == number] - clock_offset_s
        start = int(np.searchsorted(poses.time_s, time_s.min(), side="right")) - 1
        end = int(np.searchsorted(poses.time_s, time_s.max(), side="left"))
        taken = np.arange(min(max(start, 0), last), min(end, last) + 1)
        rows.append(taken)
        numbers.append(np.full(len(taken), number))
    index = np.concatenate(rows)
    return replace(
        poses, time_s=poses.time_s[index], position_mm=poses.position_mm[index],
        quaternion_wxyz=poses.quaternion_wxyz[index], pass_index=np.concatenate(numbers),
    )  # fmt: skip
