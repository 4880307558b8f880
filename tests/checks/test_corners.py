"""Which frames the checks of corners look at."""

from __future__ import annotations

import numpy as np

from workbench.checks.corners import frames_with


def test_frames_with_are_found_though_few_show_a_face() -> None:
    """Of a long recording a part is looked at, unless that shows too few."""
    labels = np.zeros((40_000, 3), np.uint8)
    assert len(frames_with(labels, [1], 20)) == 0
    labels[30_001:30_009, 1] = 1
    assert frames_with(labels, [1], 20).tolist() == list(range(30_001, 30_009))
    assert len(frames_with(labels, [1, 2], 20)) == 0
    labels[10_000:20_000] = 1
    found = frames_with(labels, [1], 20)
    assert len(found) == 20
    assert (labels[found] == 1).any(axis=1).all()
    assert np.ptp(np.diff(found)) < 0.6 * np.diff(found).mean()
    assert set(found % 2) == {0, 1}
