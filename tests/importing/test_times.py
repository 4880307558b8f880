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
from workbench.api import interpolate_poses
from workbench.artefacts import Recording
from workbench.errors import InputError

Import = Callable[..., Recording]
Mapped = Callable[..., Path]
NO_TIME = {"columns": {"x": "X [µm]", "z": "Z", "frame": "profile"}, "time_unit": None}


def some_frames(recording: Recording, frames: slice) -> Recording:
    """A lighter recording: some frames, every 20th column."""
    return replace(
        recording,
        time_s=recording.time_s[frames],
        x_mm=recording.x_mm[frames, ::20],
        z_mm=recording.z_mm[frames, ::20],
        pass_index=recording.pass_index[frames],
    )


def one_pass(recording: Recording, number: int) -> Recording:
    frame, pose = recording.pass_index == number, recording.robot_pass == number
    return replace(
        recording,
        time_s=recording.time_s[frame],
        x_mm=recording.x_mm[frame, ::20],
        z_mm=recording.z_mm[frame, ::20],
        pass_index=recording.pass_index[frame],
        robot_time_s=recording.robot_time_s[pose],
        robot_position_mm=recording.robot_position_mm[pose],
        robot_quaternion_wxyz=recording.robot_quaternion_wxyz[pose],
        robot_pass=recording.robot_pass[pose],
    )


def frame_poses(recording: Recording) -> np.ndarray:
    """Pose of the flange at every frame, pass after pass."""
    return np.concatenate(
        [
            interpolate_poses(
                recording.time_s[recording.pass_index == n],
                *(
                    values[recording.robot_pass == n]
                    for values in (recording.robot_time_s, recording.robot_position_mm, recording.robot_quaternion_wxyz)
                ),
            )
            for n in np.unique(recording.pass_index)
        ]
    )


@pytest.fixture(scope="module")
def light(milled: Recording) -> Recording:
    return some_frames(milled, slice(0, 300, 10))


@pytest.mark.parametrize("convention", ORIENTATIONS)
def test_every_convention_gives_the_recording_back(
    convention: str, tmp_path: Path, light: Recording, imported: Import, mapped: Mapped
) -> None:
    scan, robot = write_profiles(tmp_path / "scan.csv", light), write_poses(tmp_path / "robot.csv", light, convention)
    assert light.flange_from_profiler is not None
    hand_eye = {"flange_from_profiler": light.flange_from_profiler.tolist()}
    made = imported(
        scan, robot, mapping=mapped(profiles=profiles_part(), poses=poses_part(convention), hand_eye=hand_eye)
    )
    for name in ("x_mm", "z_mm", "time_s", "flange_from_profiler"):
        np.testing.assert_array_equal(getattr(made, name), getattr(light, name))
    np.testing.assert_allclose(frame_poses(made), frame_poses(light), atol=1e-9)


def test_clock_offset_is_taken_off(tmp_path: Path, light: Recording, imported: Import, mapped: Mapped) -> None:
    """profile time = robot time + offset."""
    scan = write_profiles(tmp_path / "scan.csv", replace(light, time_s=light.time_s + 0.75))
    robot = write_poses(tmp_path / "robot.csv", light)
    times = {"source": "file", "clock_offset_s": 0.75}
    made = imported(scan, robot, mapping=mapped(profiles=profiles_part(), poses=poses_part(), times=times))
    np.testing.assert_allclose(made.time_s, light.time_s, atol=1e-12)


def test_frame_rate(tmp_path: Path, light: Recording, imported: Import, mapped: Mapped) -> None:
    scan, robot = write_profiles(tmp_path / "scan.csv", light), write_poses(tmp_path / "robot.csv", light)
    parts = {"profiles": profiles_part(**NO_TIME), "poses": poses_part()}
    for start in ("first_pose", 1.0):  # the recording begins at 1 s, 0.2 s from frame to frame here
        times = {"source": "rate", "rate_hz": 5, "start_s": start}
        made = imported(scan, robot, mapping=mapped(**parts, times=times))
        np.testing.assert_allclose(frame_poses(made), frame_poses(light), atol=1e-9)


@pytest.mark.parametrize("with_clock", [True, False])
def test_travel_of_an_encoder(
    with_clock: bool, tmp_path: Path, light: Recording, imported: Import, mapped: Mapped
) -> None:
    """Frames at known ways along the flange's path, whether the poses carry times or not."""
    scan, robot = write_profiles(tmp_path / "scan.csv", light), write_poses(tmp_path / "robot.csv", light)
    way_mm = np.linalg.norm(np.diff(frame_poses(light)[:, :3, 3], axis=0), axis=1)
    times = {"source": "travel", "start_mm": 0.0, "pitch_mm": float(way_mm.mean())}
    poses = poses_part() if with_clock else poses_part(time=None, time_unit=None)
    made = imported(scan, robot, mapping=mapped(profiles=profiles_part(**NO_TIME), poses=poses, times=times))
    np.testing.assert_allclose(frame_poses(made)[:, :3, 3], frame_poses(light)[:, :3, 3], atol=1e-6)
    if with_clock:
        np.testing.assert_allclose(made.time_s, light.time_s, atol=1e-9)


def test_travel_is_not_lengthened_by_noise_or_waiting(
    tmp_path: Path, light: Recording, imported: Import, mapped: Mapped
) -> None:
    """250 poses a second with 0.01 mm of noise, and two seconds of waiting at both ends."""
    rng = np.random.default_rng(8)
    time_s = np.arange(-2.0, 9.16, 0.004)
    moving_s = np.clip(time_s + 1.0, light.robot_time_s[0], light.robot_time_s[-1])
    first, last = light.robot_position_mm
    share = (moving_s - moving_s[0]) / np.ptp(moving_s)
    dense = replace(
        light,
        robot_time_s=time_s,
        robot_position_mm=first + share[:, None] * (last - first) + rng.normal(0, 0.01, (len(time_s), 3)),
        robot_quaternion_wxyz=np.tile(light.robot_quaternion_wxyz[:1], (len(time_s), 1)),
        robot_pass=np.zeros(len(time_s), np.int64),
    )
    scan, robot = write_profiles(tmp_path / "scan.csv", light), write_poses(tmp_path / "robot.csv", dense)
    exact = frame_poses(light)[:, :3, 3]
    way_mm = np.linalg.norm(np.diff(exact, axis=0), axis=1)
    times = {"source": "travel", "start_mm": 0.0, "pitch_mm": float(way_mm.mean())}
    made = imported(scan, robot, mapping=mapped(profiles=profiles_part(**NO_TIME), poses=poses_part(), times=times))
    np.testing.assert_allclose(frame_poses(made)[:, :3, 3], exact, atol=0.06)


def test_one_pose_a_frame(tmp_path: Path, light: Recording, imported: Import, mapped: Mapped) -> None:
    """Stop and go: no times anywhere, a pose for each frame."""
    from workbench.api import quaternion_from_rotation

    pose = frame_poses(light)
    still = replace(
        light,
        robot_time_s=light.time_s,
        robot_position_mm=pose[:, :3, 3],
        robot_quaternion_wxyz=quaternion_from_rotation(pose[:, :3, :3]),
        robot_pass=np.zeros(len(pose), np.int64),
    )
    scan, robot = write_profiles(tmp_path / "scan.csv", light), write_poses(tmp_path / "robot.csv", still)
    parts = {"profiles": profiles_part(**NO_TIME), "poses": poses_part(time=None, time_unit=None)}
    made = imported(scan, robot, mapping=mapped(**parts, times={"source": "pose_each"}))
    np.testing.assert_allclose(frame_poses(made), pose, atol=1e-12)
    with pytest.raises(InputError, match=r"robot2.csv: expected a pose for each of 30 frames, found 2"):
        imported(
            scan, write_poses(tmp_path / "robot2.csv", light), mapping=mapped(**parts, times={"source": "pose_each"})
        )


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


def test_frames_outside_the_poses(tmp_path: Path, light: Recording, imported: Import, mapped: Mapped) -> None:
    late = replace(light, time_s=light.time_s + 1.0)  # the last of 5.8 s then run past the poses' 7.16 s
    scan, robot = write_profiles(tmp_path / "scan.csv", late), write_poses(tmp_path / "robot.csv", light)
    parts: dict[str, Any] = {"profiles": profiles_part(), "poses": poses_part()}
    with pytest.raises(InputError, match=r"frame 27: 4 of 30 frames lie outside the poses of .*robot.csv"):
        imported(scan, robot, mapping=mapped(**parts))
    made = imported(scan, robot, mapping=mapped(**parts, outside="trim"))
    np.testing.assert_array_equal(made.time_s, late.time_s[:26])


def test_what_is_missing_is_asked_for(tmp_path: Path, light: Recording, imported: Import, mapped: Mapped) -> None:
    scan, robot = write_profiles(tmp_path / "scan.csv", light), write_poses(tmp_path / "robot.csv", light)
    poses, profiles = poses_part(), profiles_part(**NO_TIME)
    with pytest.raises(
        InputError, match=r"scan.csv: has no times: expected 'times' in the mapping, with source one of"
    ):
        imported(scan, robot, mapping=mapped(profiles=profiles, poses=poses))
    times = {"source": "travel", "start_mm": 0}
    with pytest.raises(InputError, match=r"scan.csv: has no travel: expected 'times.pitch_mm'"):
        imported(scan, robot, mapping=mapped(profiles=profiles, poses=poses, times=times))
    with pytest.raises(InputError, match=r"scan.csv: expected poses too"):
        imported(scan, mapping=mapped(profiles=profiles))
    with pytest.raises(InputError, match=r"expected a file of profiles, found none"):
        imported(robot, mapping=mapped(poses=poses))
    with pytest.raises(InputError, match=r"expected poses once for all or once for each of 1 passes, found 2"):
        imported(
            scan,
            robot,
            write_poses(tmp_path / "robot2.csv", light),
            mapping=mapped(profiles=profiles_part(), poses=poses),
        )


def test_pose_times_rise(tmp_path: Path, light: Recording, imported: Import, mapped: Mapped) -> None:
    back = replace(light, robot_time_s=light.robot_time_s[::-1])
    scan, robot = write_profiles(tmp_path / "scan.csv", light), write_poses(tmp_path / "robot.csv", back)
    with pytest.raises(InputError, match=r"robot.csv: pose 2: expected times that rise"):
        imported(scan, robot, mapping=mapped(profiles=profiles_part(), poses=poses_part()))


def matrices(translation: Any, rotation: Rotation) -> np.ndarray:
    pose = np.broadcast_to(np.eye(4), (*np.shape(translation)[:-1], 4, 4)).copy()
    pose[..., :3, :3], pose[..., :3, 3] = rotation.as_matrix(), translation
    return pose


def test_poses_of_a_tool_in_a_user_frame(tmp_path: Path, light: Recording, imported: Import, mapped: Mapped) -> None:
    """base_from_flange = base_from_frame @ frame_from_tool @ inverse(flange_from_tool)."""
    tool = matrices([120.0, -30.0, 250.0], Rotation.from_euler("xyz", [10, 70, -30], degrees=True))
    frame = matrices([900.0, 400.0, -80.0], Rotation.from_euler("xyz", [5, -3, 140], degrees=True))
    flange = matrices(light.robot_position_mm, turned(light.robot_quaternion_wxyz))
    logged = np.linalg.inv(frame) @ flange @ tool
    told = replace(
        light,
        robot_position_mm=logged[:, :3, 3],
        robot_quaternion_wxyz=np.roll(Rotation.from_matrix(logged[:, :3, :3]).as_quat(), 1, axis=1),
    )
    scan, robot = write_profiles(tmp_path / "scan.csv", light), write_poses(tmp_path / "robot.csv", told, "fanuc_wpr")
    poses = poses_part("fanuc_wpr", flange_from_tool=tool.tolist(), base_from_frame=frame.tolist())
    made = imported(scan, robot, mapping=mapped(profiles=profiles_part(), poses=poses))
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
