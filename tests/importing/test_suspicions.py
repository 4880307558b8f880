"""Units and conventions that make the part implausible are refused with the suspicion named, unless accepted."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.importing.conftest import poses_part, profiles_part, write_poses, write_profiles
from tests.importing.test_times import some_frames
from workbench.artefacts import Recording
from workbench.errors import InputError

Import = Callable[..., Recording]
Mapped = Callable[..., Path]


@pytest.fixture(scope="module")
def light(milled: Recording) -> Recording:
    return some_frames(milled, slice(0, 300, 10))


Write = Callable[[Path, Recording], Path]
CASES: dict[str, tuple[Write, Write, dict[str, Any], dict[str, Any], str, str]] = {
    "metres declared as mm": (
        write_profiles,
        lambda p, r: write_poses(p, r, unit_mm=1000.0),
        {},
        {},
        r"robot.csv: the flange is at most 1\.9\d* mm from the robot's base: m read as mm\?",
        "length_unit",
    ),
    "inches declared as mm": (
        write_profiles,
        lambda p, r: write_poses(p, r, unit_mm=25.4),
        {},
        {},
        r"75\.\d+ mm from .*: inch read as mm\?",
        "length_unit",
    ),
    "mm declared as metres": (
        write_profiles,
        write_poses,
        {},
        {"length_unit": "m"},
        r"1\.9\d*e\+06 mm from .*: mm read as m\?",
        "length_unit",
    ),
    "profiles in mm declared as micrometres": (
        write_profiles,
        write_poses,
        {"length_unit": "um"},
        {},
        r"scan.csv: profiles would be 0\.0\d+ mm wide: .*mm",
        "length_unit",
    ),
    "radians declared as degrees": (
        write_profiles,
        lambda p, r: write_poses(p, r, "ur"),
        {},
        {"angle_unit": "deg"},
        r"all angles are within \d\.\d+ deg of 0: radians declared as deg\?",
        "angle_unit",
    ),
    "milliseconds declared as seconds": (
        lambda p, r: write_profiles(p, replace(r, time_s=r.time_s * 1000)),
        lambda p, r: write_poses(p, replace(r, robot_time_s=r.robot_time_s * 1000)),
        {},
        {},
        r"pass 0: the flange would move at 0\.0126 mm/s: is a unit of time or a rate wrong\?",
        "time_unit",
    ),
    "a flange that stands still": (
        write_profiles,
        lambda p, r: write_poses(p, replace(r, robot_position_mm=np.tile(r.robot_position_mm[:1], (2, 1)))),
        {},
        {},
        r"pass 0: the flange does not move over 30 frames",
        "still",
    ),
    "metres read as mm, far from the base": (
        write_profiles,
        lambda p, r: write_poses(
            p, replace(r, robot_position_mm=500 + (r.robot_position_mm - r.robot_position_mm[0]) / 1000)
        ),
        {},
        {},
        r"pass 0: the flange moves 0\.07\d+ mm over 30 frames: metres or inches read as mm\?",
        "length_unit",
    ),
}


@pytest.mark.parametrize("case", CASES)
def test_suspicions(case: str, tmp_path: Path, light: Recording, imported: Import, mapped: Mapped) -> None:
    scan, robot, profiles, poses, message, what = CASES[case]
    sources = scan(tmp_path / "scan.csv", light), robot(tmp_path / "robot.csv", light)
    convention = "ur" if "angle_unit" in poses else "quaternion_wxyz"
    parts = {"profiles": profiles_part(**profiles), "poses": poses_part(convention, **poses)}
    with pytest.raises(InputError, match=message) as caught:
        imported(*sources, mapping=mapped(**parts))
    assert f'"accept": ["{what}"]' in str(caught.value)
    assert not (tmp_path / "imported.h5").exists()
    accepted = ["length_unit", "time_unit", "direction", "still", "angle_unit"]
    if case != "mm declared as metres":  # a kilometre is more than any recording may hold
        assert len(imported(*sources, mapping=mapped(**parts, accept=accepted)).time_s) == 30


def test_degrees_declared_as_radians(tmp_path: Path, light: Recording, imported: Import, mapped: Mapped) -> None:
    scan, robot = write_profiles(tmp_path / "scan.csv", light), write_poses(tmp_path / "robot.csv", light, "kuka_abc")
    parts = {"profiles": profiles_part(), "poses": poses_part("kuka_abc", angle_unit="rad")}
    with pytest.raises(InputError, match=r"an angle of 1\d\d\.\d+ rad is more than a turn: degrees declared as rad\?"):
        imported(scan, robot, mapping=mapped(**parts))


def test_a_wrong_convention_turns_the_motion_into_the_laser_plane(
    tmp_path: Path, light: Recording, imported: Import, mapped: Mapped
) -> None:
    """Where the profiler moves along its own laser line, orientation or hand-eye is wrong: it would scan nothing."""
    assert light.flange_from_profiler is not None
    quarter = np.array([[0, -1, 0, 0], [1, 0, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1.0]])
    scan, robot = write_profiles(tmp_path / "scan.csv", light), write_poses(tmp_path / "robot.csv", light)
    parts = {"profiles": profiles_part(), "poses": poses_part()}
    for pose in (light.flange_from_profiler, light.flange_from_profiler @ quarter):
        mapping = mapped(**parts, hand_eye={"flange_from_profiler": pose.tolist()})
        if pose is light.flange_from_profiler:
            imported(scan, robot, mapping=mapping)
            continue
        with pytest.raises(InputError, match="moves in its own laser plane"):
            imported(scan, robot, mapping=mapping)
