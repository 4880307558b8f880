"""A synthetic recording written out as other people write theirs, imported, inspected: the same numbers."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from tests.importing.conftest import ORIENTATIONS, poses_part, profiles_part, write_poses, write_profiles
from workbench.api import rotation_from_quaternion
from workbench.artefacts import Recording


def hand_eye(recording: Recording) -> dict[str, list[list[float]]]:
    assert recording.flange_from_profiler is not None
    return {"flange_from_profiler": recording.flange_from_profiler.tolist()}


@pytest.fixture(scope="module")
def scan(tmp_path_factory: pytest.TempPathFactory, milled: Recording) -> Path:
    return write_profiles(tmp_path_factory.mktemp("table") / "scan.csv", milled)


@pytest.mark.parametrize("convention", ORIENTATIONS)
def test_every_convention_gives_the_recording_back(
    convention: str,
    scan: Path,
    tmp_path: Path,
    milled: Recording,
    mapped: Callable[..., Path],
    imported: Callable[..., Recording],
) -> None:
    robot = write_poses(tmp_path / "robot.csv", milled, convention)
    mapping = mapped(profiles=profiles_part(), poses=poses_part(convention), hand_eye=hand_eye(milled))
    made = imported(scan, robot, mapping=mapping)
    np.testing.assert_array_equal(made.x_mm, milled.x_mm)
    np.testing.assert_array_equal(made.z_mm, milled.z_mm)
    np.testing.assert_array_equal(made.time_s, milled.time_s)
    np.testing.assert_allclose(made.robot_position_mm, milled.robot_position_mm, atol=1e-9)
    want, got = (rotation_from_quaternion(one.robot_quaternion_wxyz) for one in (milled, made))
    np.testing.assert_allclose(got, want, atol=1e-12)
    np.testing.assert_array_equal(made.flange_from_profiler, milled.flange_from_profiler)
