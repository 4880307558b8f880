"""What the benchmark's page says of what was measured."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import h5py
import numpy as np
import pytest

from bench.speed import recordings
from bench.speed.table import cells, document, line
from bench.speed.timing import Row
from workbench.scan import read


def test_a_line_and_the_page(tmp_path: Path) -> None:
    missed = cells(Row("fuse; copy", "2 ms", "1 ms", 0.5, "{:.2f} of its speed", goal=0.8))
    assert line(missed) == "| fuse; copy | 2 ms | 1 ms | 0.50 of its speed | at least 0.8 | **no** |"
    first = cells(Row("an inspection report, processor time", "1 s", "", 1.0, "{:.1f} s", goal=1, at_most=True))
    other = cells(Row("something else", "1 s", "", 1.0, "{:.1f} s"))
    text = document([missed, first, other], ["--sizes", "1"], tmp_path / "page.md")
    assert "python -m bench.speed --sizes 1" in text
    assert "1 of 2 goals are met" in text
    before, after = text.split("## Goals not met")
    assert "| an inspection report, processor time | 1.0 s | at most 1 |" in before
    assert "| fuse; copy | 0.50 of its speed | at least 0.8 |" in after
    assert "something else" not in text
    assert "something else,1 s" in (tmp_path / "tables" / "page_all_rows.csv").read_text()


def test_recordings_are_read_in_both_storages(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(recordings, "COLUMNS", 8000)  # few frames make a million points
    packed = recordings.simulated(1, tmp_path)
    plain = recordings.unpacked(packed)
    with h5py.File(plain) as file:
        assert file["profiles/z"].chunks is None
    a, b = read(recording=packed), read(recording=plain)
    assert a.z_mm.shape == (125, 8000)
    np.testing.assert_array_equal(a.z_mm, b.z_mm)
    np.testing.assert_array_equal(a.robot_position_mm, b.robot_position_mm)


def test_peak_memory_is_that_of_the_process_alone() -> None:
    """A parent's 300 MB do not count for the child, as they would in `resource.getrusage` after a fork."""
    ballast = np.ones(300_000_000, np.uint8)
    command = [sys.executable, "-c", "from bench.speed.ours import peak_bytes; print(peak_bytes())"]
    done = subprocess.run(command, check=True, capture_output=True, text=True, cwd=Path(__file__).parents[2])
    assert 5e6 < int(done.stdout) < ballast.size
