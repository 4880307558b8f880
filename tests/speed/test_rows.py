"""What the benchmark measures is what its rows say, and the page says what was measured."""

from __future__ import annotations

from argparse import Namespace
from pathlib import Path

import numpy as np
import pytest

from bench.speed import recordings
from bench.speed.__main__ import report
from bench.speed.timing import Row, peak_gb
from workbench.scan import read


def test_a_row_and_the_page() -> None:
    missed = Row("fuse; copy", 0.5, "of its speed", goal=0.8, at_least=True)
    assert missed.cells == ["fuse; copy", "**0.5 of its speed**", "at least 0.8"]
    met = Row("an inspection report, processor time", 0.712, goal=1)
    assert met.cells == ["an inspection report, processor time", "0.712 s", "at most 1"]
    text = "\n".join(report([[missed, met], [Row("something else", 1.0)]], Namespace()))
    assert "1 of 2 goals are met" in text
    assert "| something else | 1 s |  |" in text


def test_recordings_have_as_many_points_as_asked_for(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(recordings, "COLUMNS", 8000)  # few frames make a million points
    assert read(recording=recordings.simulated(1, tmp_path)).z_mm.shape == (125, 8000)
    first, second = (read(recording=path) for path in recordings.small_parts(2, tmp_path))
    assert first.z_mm.shape == second.z_mm.shape == (121, 300)
    assert not np.array_equal(first.z_mm, second.z_mm, equal_nan=True)


def test_peak_memory_is_that_of_the_process_alone() -> None:
    """A parent's 400 MB do not count for the child, as they would in `resource.getrusage` after a fork."""
    ballast = np.ones(400_000_000, np.uint8)
    assert 5e-3 < peak_gb("--version") < ballast.size / 1e9
