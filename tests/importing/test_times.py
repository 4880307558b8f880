"""Frame times, passes and poses: every way in which a shop's files can belong together."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tests.importing import makers
from tests.importing.conftest import ORIENTATIONS, poses_part, profiles_part, turned, write_poses, write_profiles
from workbench.api import interpolate_poses, quaternion_from_rotation
from workbench.artefacts import Recording
from workbench.errors import InputError

Import = Callable[..., Recording]
Mapped = Callable[..., Path]
NO_TIME = {"columns": {"x": "X [µm]", "z": "Z", "frame": "profile"}, "time_unit": None}
NO_CLOCK = {"time": None, "time_unit": None}
OF_FRAMES = ("time_s", "pass_index")
OF_POSES = ("robot_time_s", "robot_position_mm", "robot_quaternion_wxyz", "robot_pass")


def some_frames(recording: Recording, frames: Any) -> Recording:
    """A lighter recording: some frames, every 20th column."""
    grids = {name: getattr(recording, name)[frames, ::20] for name in ("x_mm", "z_mm")}
    return replace(recording, **grids, **{name: getattr(recording, name)[frames] for name in OF_FRAMES})


def one_pass(recording: Recording, number: int) -> Recording:
    poses = {name: getattr(recording, name)[recording.robot_pass == number] for name in OF_POSES}
    return replace(some_frames(recording, recording.pass_index == number), **poses)


def with_poses(recording: Recording, time_s: Any, position_mm: Any, quaternion_wxyz: Any) -> Recording:
    return replace(
        recording,
        robot_time_s=time_s,
        robot_position_mm=position_mm,
        robot_quaternion_wxyz=quaternion_wxyz,
        robot_pass=np.zeros(len(time_s), np.int64),
    )


def frame_poses(recording: Recording) -> np.ndarray:
    """Pose of the flange at every frame, pass after pass."""
    passes = [one_pass(recording, number) for number in np.unique(recording.pass_index)]
    poses = [interpolate_poses(one.time_s, *(getattr(one, name) for name in OF_POSES[:3])) for one in passes]
    return np.concatenate(poses)


def pitch_mm(recording: Recording) -> float:
    """From frame to frame."""
    return float(np.linalg.norm(np.diff(frame_poses(recording)[:, :3, 3], axis=0), axis=1).mean())


@pytest.fixture(scope="module")
def light(milled: Recording) -> Recording:
    return some_frames(milled, slice(0, 300, 10))


@pytest.mark.parametrize("convention", ORIENTATIONS)
def test_every_convention_gives_the_recording_back(convention: str, light: Recording, shop: Import) -> None:
    assert light.flange_from_profiler is not None
    made = shop(light, light, convention, hand_eye={"flange_from_profiler": light.flange_from_profiler.tolist()})
    for name in ("x_mm", "z_mm", "time_s", "flange_from_profiler"):
        np.testing.assert_array_equal(getattr(made, name), getattr(light, name))
    np.testing.assert_allclose(frame_poses(made), frame_poses(light), atol=1e-9)


def test_clock_offset_is_taken_off(light: Recording, shop: Import) -> None:
    """profile time = robot time + offset."""
    late = replace(light, time_s=light.time_s + 0.75)
    made = shop(late, light, times={"source": "file", "clock_offset_s": 0.75})
    np.testing.assert_allclose(made.time_s, light.time_s, atol=1e-12)


@pytest.mark.parametrize("start", ["first_pose", 1.0])  # the recording begins at 1 s, 0.2 s from frame to frame here
def test_frame_rate(start: Any, light: Recording, shop: Import) -> None:
    made = shop(light, light, profiles=NO_TIME, times={"source": "rate", "rate_hz": 5, "start_s": start})
    np.testing.assert_allclose(frame_poses(made), frame_poses(light), atol=1e-9)


@pytest.mark.parametrize("clock", [{}, NO_CLOCK])
def test_travel_of_an_encoder(clock: dict[str, Any], light: Recording, shop: Import) -> None:
    """Frames at known ways along the flange's path, whether the poses carry times or not."""
    times = {"source": "travel", "start_mm": 0.0, "pitch_mm": pitch_mm(light)}
    made = shop(light, light, profiles=NO_TIME, poses=clock, times=times)
    np.testing.assert_allclose(frame_poses(made)[:, :3, 3], frame_poses(light)[:, :3, 3], atol=1e-6)
    if not clock:
        np.testing.assert_allclose(made.time_s, light.time_s, atol=1e-9)


def test_travel_is_not_lengthened_by_noise_or_waiting(light: Recording, shop: Import) -> None:
    """250 poses a second with 0.01 mm of noise, and two seconds of waiting at both ends."""
    time_s = np.arange(-2.0, 9.16, 0.004)
    moving_s = np.clip(time_s + 1.0, light.robot_time_s[0], light.robot_time_s[-1])
    first, last = light.robot_position_mm
    place = first + ((moving_s - moving_s[0]) / np.ptp(moving_s))[:, None] * (last - first)
    noise = np.random.default_rng(8).normal(0, 0.01, place.shape)
    dense = with_poses(light, time_s, place + noise, np.tile(light.robot_quaternion_wxyz[:1], (len(time_s), 1)))
    made = shop(
        light, dense, profiles=NO_TIME, times={"source": "travel", "start_mm": 0.0, "pitch_mm": pitch_mm(light)}
    )
    np.testing.assert_allclose(frame_poses(made)[:, :3, 3], frame_poses(light)[:, :3, 3], atol=0.06)


def test_one_pose_a_frame(light: Recording, shop: Import) -> None:
    """Stop and go: no times anywhere, a pose for each frame."""
    pose = frame_poses(light)
    still = with_poses(light, light.time_s, pose[:, :3, 3], quaternion_from_rotation(pose[:, :3, :3]))
    parts = {"profiles": NO_TIME, "poses": NO_CLOCK, "times": {"source": "pose_each"}}
    np.testing.assert_allclose(frame_poses(shop(light, still, **parts)), pose, atol=1e-12)
    with pytest.raises(InputError, match=r"robot.csv: expected a pose for each of 30 frames, found 2"):
        shop(light, light, **parts)


@pytest.mark.parametrize("layout", ["one", "each", "numbered"])
def test_two_passes(layout: str, tmp_path: Path, two_pass: Recording, imported: Import, mapped: Mapped) -> None:
    """Two profile files are two passes; poses come once for both, by time or by number, or once for each."""
    first, second = one_pass(two_pass, 0), one_pass(two_pass, 1)
    scans = [write_profiles(tmp_path / f"scan{i}.csv", one) for i, one in enumerate((first, second))]
    if layout == "each":
        robots = [write_poses(tmp_path / f"robot{i}.csv", one) for i, one in enumerate((first, second))]
    else:
        robots = [write_poses(tmp_path / "robot.csv", two_pass, with_pass=layout == "numbered")]
    poses = poses_part(**({"scan_pass": "n"} if layout == "numbered" else {}))
    made = imported(*scans, *robots, mapping=mapped(profiles=profiles_part(), poses=poses))
    np.testing.assert_array_equal(made.pass_index, two_pass.pass_index)
    np.testing.assert_allclose(frame_poses(made), frame_poses(two_pass), atol=1e-9)
    np.testing.assert_array_equal(made.robot_pass, [0, 0, 1, 1])


def test_frames_outside_the_poses(light: Recording, shop: Import) -> None:
    late = replace(light, time_s=light.time_s + 1.0)  # the last of 5.8 s then run past the poses' 7.16 s
    with pytest.raises(InputError, match=r"frame 27: 4 of 30 frames lie outside the poses of .*robot.csv"):
        shop(late, light)
    np.testing.assert_array_equal(shop(late, light, outside="trim").time_s, late.time_s[:26])


POSES, TRAVEL = {"poses": poses_part()}, {"times": {"source": "travel", "start_mm": 0}}


@pytest.mark.parametrize(
    ("files", "parts", "asked"),
    [
        (["scan", "robot"], POSES, r"scan.csv: has no times: expected 'times' in the mapping, with source one of"),
        (["scan", "robot"], POSES | TRAVEL, r"scan.csv: has no travel: expected 'times.pitch_mm'"),
        (["scan"], {}, r"scan.csv: expected poses too"),
        (["robot"], POSES | {"profiles": None}, r"expected a file of profiles, found none"),
        (
            ["scan", "robot", "robot2"],
            POSES | {"profiles": profiles_part()},
            r"expected poses once for all or once for each of 1 passes, found 2",
        ),
    ],
)
def test_what_is_missing_is_asked_for(
    files: list[str],
    parts: dict[str, Any],
    asked: str,
    tmp_path: Path,
    light: Recording,
    imported: Import,
    mapped: Mapped,
) -> None:
    write = {"scan": write_profiles, "robot": write_poses, "robot2": write_poses}
    sources = [write[name](tmp_path / f"{name}.csv", light) for name in files]
    told = {"profiles": profiles_part(**NO_TIME)} | parts
    with pytest.raises(InputError, match=asked):
        imported(*sources, mapping=mapped(**{name: part for name, part in told.items() if part}))


def test_pose_times_rise(light: Recording, shop: Import) -> None:
    with pytest.raises(InputError, match=r"robot.csv: pose 2: expected times that rise"):
        shop(light, replace(light, robot_time_s=light.robot_time_s[::-1]))


def matrices(translation: Any, rotation: Rotation) -> np.ndarray:
    pose = np.broadcast_to(np.eye(4), (*np.shape(translation)[:-1], 4, 4)).copy()
    pose[..., :3, :3], pose[..., :3, 3] = rotation.as_matrix(), translation
    return pose


def test_poses_of_a_tool_in_a_user_frame(light: Recording, shop: Import) -> None:
    """base_from_flange = base_from_frame @ frame_from_tool @ inverse(flange_from_tool)."""
    tool = matrices([120.0, -30.0, 250.0], Rotation.from_euler("xyz", [10, 70, -30], degrees=True))
    frame = matrices([900.0, 400.0, -80.0], Rotation.from_euler("xyz", [5, -3, 140], degrees=True))
    flange = matrices(light.robot_position_mm, turned(light.robot_quaternion_wxyz))
    logged = np.linalg.inv(frame) @ flange @ tool
    turns = np.roll(Rotation.from_matrix(logged[:, :3, :3]).as_quat(), 1, axis=1)
    told = with_poses(light, light.robot_time_s, logged[:, :3, 3], turns)
    made = shop(light, told, "fanuc_wpr", poses={"flange_from_tool": tool.tolist(), "base_from_frame": frame.tolist()})
    np.testing.assert_allclose(frame_poses(made), frame_poses(light), atol=1e-9)


def test_postures_of_a_calibration(tmp_path: Path, imported: Import, mapped: Mapped) -> None:
    """A file a posture, a pose a posture: a pass each."""
    scans = [makers.write_gopxl(tmp_path / f"{i}.csv", i) for i in range(3)]
    (tmp_path / "robot.csv").write_text("X,Y,Z,o0,o1,o2,o3\n" + "".join(f"{900 + i},0,500,0,1,0,0\n" for i in range(3)))
    poses = poses_part(time=None, time_unit=None)
    mapping = mapped(poses=poses, times={"source": "pose_each"}, sphere_diameter_mm=25.4)
    made = imported(*scans, tmp_path / "robot.csv", mapping=mapping)
    np.testing.assert_array_equal(made.pass_index, [0, 1, 2])
    np.testing.assert_array_equal(made.robot_pass, [0, 1, 2])
    np.testing.assert_array_equal(made.robot_position_mm[:, 0], [900, 901, 902])
    assert made.sphere_diameter_mm == 25.4
