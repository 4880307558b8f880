"""What is taken of a recording that grows: whole frames, with the poses about them."""

from __future__ import annotations

import time
from pathlib import Path

import h5py
import numpy as np

from tests.pipeline.test_follow import SOURCE, writing
from workbench.pipeline.follow import copy_complete_frames
from workbench.scan import read


def test_only_whole_frames_are_copied(tmp_path: Path) -> None:
    """Data sets grow one after another; a frame counts when all of them have it, and a pose behind it."""
    grown, copy = tmp_path / "grown.h5", tmp_path / "copy.h5"
    with writing(grown, last=24) as process:
        process.stdout.readline()
        deadline = time.monotonic() + 300.0
        while copy_complete_frames(grown, copy, 24) != 24:
            assert time.monotonic() < deadline
        assert copy_complete_frames(grown, copy, 25) == 0
    whole, some = read(recording=SOURCE), read(recording=copy)
    np.testing.assert_array_equal(some.z_mm, whole.z_mm[:24])
    with h5py.File(copy) as file:
        assert file.attrs["format"] == "profile-recording"
