"""Frames that a driver stamps as they arrive, in bursts."""

from __future__ import annotations

import numpy as np
import pytest

from bench.recordings import stamped
from bench.score.analytic import sharp as analytic
from bench.score.measure import alone
from tests.seldom import seldom


@pytest.mark.parametrize("burst_s", [0.1, *seldom(0.5)])
def test_frames_that_are_stamped_in_bursts_are_measured_or_refused(burst_s: float) -> None:
    """They ended inside, with a ValueError."""
    part = analytic(18_005_000)
    time = part.recording.time_s
    stamps = np.floor(time / burst_s) * burst_s + 1e-6 * np.arange(time.size)
    found = alone(part._replace(recording=stamped(part.recording, np.maximum(stamps, time[0]))))
    assert not found.crashed
    assert all((np.abs(one.error) < 4.0 * one.u).all() for one in found.found.values())
