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
from workbench.recording_file import write
from workbench.scan import read

Import = Callable[..., Recording]
Mapped = Callable[..., Path]


@pytest.fixture(scope="module")
def light(milled: Recording) -> Recording:
    return some_frames(milled, slice(0, 300, 10))


def poses_with(**columns: Any) -> Callable[[Path, Recording], Path]:
    return lambda path, made: write_poses(path, replace(made, **{name: new(made) for name, new in columns.items()}))


def in_unit(unit_mm: float) -> Callable[[Path, Recording], Path]:
    return lambda path, made: write_poses(path, made, unit_mm=unit_mm)


def short_way(made: Recording) -> Any:
    return 500 + (made.robot_position_mm - made.robot_position_mm[0]) / 1000


MS = (
    lambda path, made: write_profiles(path, replace(made, time_s=made.time_s * 1000)),
    poses_with(robot_time_s=lambda made: made.robot_time_s * 1000),
)
STILL = poses_with(robot_position_mm=lambda made: np.tile(made.robot_position_mm[:1], (2, 1)))
CASES: dict[str, tuple[Any, dict[str, Any], str]] = {  # the files, what is declared of them, what is told
    "m read as mm": (
        in_unit(1000.0),
        {},
        r"robot.csv: the flange is at most 1\.9\d* mm from the robot's base: m read as",
    ),
    "inch read as mm": (in_unit(25.4), {}, r"75\.\d+ mm from .*: inch read as mm\?"),
    "mm read as m": (write_poses, {"poses": {"length_unit": "m"}}, r"1\.9\d*e\+06 mm from .*: mm read as m\?"),
    "um": (write_poses, {"profiles": {"length_unit": "um"}}, r"scan.csv: profiles would be 0\.0\d+ mm wide: .*mm"),
    "far from the base": (
        poses_with(robot_position_mm=short_way),
        {},
        r"pass 0: the flange moves 0\.07\d+ mm over 30 frames: metres or inches read as mm\?",
    ),
    "radians as deg": (
        lambda path, made: write_poses(path, made, "ur"),
        {"poses": {"angle_unit": "deg"}},
        r"all angles are within \d\.\d+ deg of 0: radians declared as deg\?",
    ),
    "ms as s": (MS, {}, r"pass 0: the flange would move at 0\.0126 mm/s: is a unit of time or a rate wrong\?"),
    "still": (STILL, {}, r"pass 0: the flange does not move over 30 frames"),
}
WHAT = {"radians as deg": "angle_unit", "ms as s": "time_unit", "still": "still"}  # else length_unit


@pytest.mark.parametrize("case", CASES)
def test_suspicions(case: str, tmp_path: Path, light: Recording, imported: Import, mapped: Mapped) -> None:
    written, declared, message = CASES[case]
    scan, robot = written if isinstance(written, tuple) else (write_profiles, written)
    sources = scan(tmp_path / "scan.csv", light), robot(tmp_path / "robot.csv", light)
    poses = declared.get("poses", {})
    convention = "ur" if "angle_unit" in poses else "quaternion_wxyz"
    parts = {"profiles": profiles_part(**declared.get("profiles", {})), "poses": poses_part(convention, **poses)}
    with pytest.raises(InputError, match=message) as caught:
        imported(*sources, mapping=mapped(**parts))
    assert f'"accept": ["{WHAT.get(case, "length_unit")}"]' in str(caught.value)
    assert not (tmp_path / "imported.h5").exists()
    accepted = ["length_unit", "time_unit", "direction", "still", "angle_unit"]
    if case != "mm read as m":  # a kilometre is more than any recording may hold
        assert len(imported(*sources, mapping=mapped(**parts, accept=accepted)).time_s) == 30


def test_micrometres_read_as_mm(light: Recording, shop: Import, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"expected mm or no return, found z = \d+ in column 1: um read as mm\?"):
        shop(replace(light, z_mm=light.z_mm * 1000), light)
    write(replace(light, z_mm=light.z_mm * 1000), tmp_path / "um.h5")
    with pytest.raises(InputError, match=r"expected mm, NaN where nothing came back, found \d+: um read as mm\?"):
        read(recording=tmp_path / "um.h5")


def test_degrees_declared_as_radians(light: Recording, shop: Import) -> None:
    with pytest.raises(InputError, match=r"an angle of 1\d\d\.\d+ rad is more than a turn: degrees declared as rad\?"):
        shop(light, light, "kuka_abc", poses={"angle_unit": "rad"})


def test_a_wrong_convention_turns_the_motion_into_the_laser_plane(light: Recording, shop: Import) -> None:
    """Where the profiler moves along its own laser line, orientation or hand-eye is wrong: it would scan nothing."""
    right = light.flange_from_profiler
    assert right is not None
    quarter = np.array([[0, -1, 0, 0], [1, 0, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1.0]])
    shop(light, light, hand_eye={"flange_from_profiler": right.tolist()})
    with pytest.raises(InputError, match="moves in its own laser plane"):
        shop(light, light, hand_eye={"flange_from_profiler": (right @ quarter).tolist()})
