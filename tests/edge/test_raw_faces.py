"""What stands beside the end face: a streak of stray returns, or a part of it."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from workbench.artefacts import Cloud
from workbench.edge.raw_faces import lasting
from workbench.units import Bool

RAW = {"kind": "raw", "length_mm": 60.0, "thickness_mm": 8.0}
ABOVE = {"from_mm": 5.0, "to_mm": 55.0}


@pytest.fixture(scope="module")
def cloud(scanned: Any) -> Cloud:
    """251 frames 0.2 mm apart."""
    return scanned(part=RAW, passes=[ABOVE]).cloud  # type: ignore[no-any-return]


def streaks(cloud: Cloud, *runs: range) -> Bool:
    out = np.zeros(len(cloud.keep), bool)
    for run in runs:
        out[list(run)] = True
    return out


@pytest.mark.parametrize(
    ("runs", "expected"),
    [
        ([range(40, 44), range(90, 97)], []),  # some frames: streaks
        ([range(40, 48), range(120, 140)], [range(120, 140)]),  # 4 mm: the part's
        ([range(100, 130, 3)], [range(100, 128)]),  # seen in every third frame
        ([range(100, 105), range(110, 115)], []),  # two streaks
        ([range(0, 250, 3)], [range(251)]),  # a third of all frames
    ],
)
def test_streaks_last_some_frames(cloud: Cloud, runs: list[range], expected: list[range]) -> None:
    found = lasting(streaks(cloud, *runs), np.ones(len(cloud.keep), bool), cloud)
    assert np.array_equal(found, streaks(cloud, *expected))


def test_frames_far_apart_are_a_long_way_soon(cloud: Cloud) -> None:
    """Four frames 4 mm apart are 12 mm of the edge."""
    pose = cloud.base_from_profiler.copy()
    pose[:, :3, 3] = pose[0, :3, 3] + 20.0 * (pose[:, :3, 3] - pose[0, :3, 3])
    far = replace(cloud, base_from_profiler=pose)
    found = lasting(streaks(far, range(40, 42), range(100, 104)), np.ones(len(pose), bool), far)
    assert np.array_equal(found, streaks(far, range(100, 104)))
