"""Recordings small enough to write by the dozen: two passes of a profiler on a turning flange."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from workbench.api import pose_from, rotation_from_rpy

FRAMES, COLUMNS, POSES = 12, 7, 4


def tables() -> dict[str, Any]:
    """A good recording's data sets by path: passes -5 and 70 interleaved in the file, x falling with the column."""
    rng = np.random.default_rng(11)
    pose_pass = np.repeat([70, -5], POSES // 2)
    frame_pass = np.tile([-5, 70], FRAMES // 2)
    z = rng.uniform(200, 210, (FRAMES, COLUMNS))
    z[3, 2], z[5] = np.nan, np.nan
    quaternion = np.array([[1, 0, 0, 0], [-0.6, -0.8, 0, 0], [0, 0, 1, 0], [0, 0, -0.96, 0.28]])
    return {
        "/profiles/time": np.where(frame_pass == -5, 0.0, 100.0) + np.arange(FRAMES) // 2 * 0.02,
        "/profiles/x": np.broadcast_to(np.linspace(30, -30, COLUMNS), z.shape).astype(np.float32),
        "/profiles/z": z.astype(np.float32),
        "/profiles/intensity": rng.integers(0, 65536, z.shape, dtype=np.uint16),
        "/profiles/pass": frame_pass.astype(np.int32),
        "/robot/time": np.array([100.0, 100.1, 0.0, 0.1]),
        "/robot/position": np.array([[1000.0, 0, 500], [1010, 1, 500], [900, -30, 400], [910, -30, 400]]),
        "/robot/quaternion_wxyz": quaternion,
        "/robot/pass": pose_pass.astype(np.int32),
        "/hand_eye/flange_from_profiler": pose_from(rotation_from_rpy(1.0, -0.07, -0.03), np.array([127.0, 9.4, 41.5])),
    }


@pytest.fixture
def good() -> dict[str, Any]:
    return tables()


@pytest.fixture
def build(tmp_path: Path) -> Callable[..., Path]:
    """Write a good recording, `storage` for the grid's data sets, after `edit(file)` has had its way with it."""

    def written(edit: Callable[[Any], None] | None = None, name: str = "part.h5", **storage: Any) -> Path:
        path = tmp_path / name
        with h5py.File(path, "w") as file:
            file.attrs.update(format="profile-recording", version=1, length_unit="mm", time_unit="s", part_id="A-7")
            for place, values in tables().items():
                on_the_grid = place in ("/profiles/x", "/profiles/z", "/profiles/intensity")
                file.create_dataset(place, data=values, **(storage if on_the_grid else {}))
            if edit is not None:
                edit(file)
        return path

    return written
