"""A recording written as a bag comes back as it was, by every kind of bag and of pose."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rosbags import rosbag1, rosbag2
from scipy.spatial.transform import Rotation

from tests.importing.bag_files import (
    CLOUD,
    JOINTS,
    KINDS,
    ODOMETRY,
    POSE,
    TF,
    TRANSFORM,
    Entry,
    Kind,
    Ros,
    pose_entries,
    profile_entries,
)
from workbench.api import inverse, pose_from, rotation_from_quaternion
from workbench.artefacts import Recording
from workbench.errors import InputError
from workbench.importing import bags
from workbench.importing.mapping import Mapping
from workbench.importing.neutral import Imported
from workbench.scan import read as read_recording

DATA = Path(__file__).parents[2] / "data"


@pytest.fixture(scope="module")
def recording() -> Recording:
    """Thirty frames with a pose each, and intensity."""
    whole = read_recording(recording=DATA / "synthetic" / "milled_arc.h5")
    frames, poses = slice(100, 130), slice(150, 320)
    x_mm, z_mm = whole.x_mm[frames, 200:300], whole.z_mm[frames, 200:300]
    return replace(
        whole,
        time_s=whole.time_s[frames],
        x_mm=np.where(np.isnan(z_mm), np.nan, x_mm),
        z_mm=z_mm,
        pass_index=whole.pass_index[frames],
        intensity=np.arange(3000).reshape(30, 100).astype(np.uint16),
        robot_time_s=whole.robot_time_s[poses],
        robot_position_mm=whole.robot_position_mm[poses],
        robot_quaternion_wxyz=whole.robot_quaternion_wxyz[poses],
        robot_pass=whole.robot_pass[poses],
    )


def imported(path: Path, **bag: Any) -> Imported:
    mapping = Mapping.model_validate({"format": "import-mapping", "version": 1, "bag": bag})
    return bags.read(path, mapping)


def agrees(found: Imported, recording: Recording) -> None:
    """Within what float32 metres and time stamps in ns hold."""
    assert found.profiles is not None
    assert found.poses is not None
    np.testing.assert_allclose(found.profiles.x_mm, recording.x_mm, atol=2e-6)
    np.testing.assert_allclose(found.profiles.z_mm, recording.z_mm, atol=2e-5)
    np.testing.assert_allclose(found.profiles.time_s, recording.time_s, atol=1e-9)
    np.testing.assert_allclose(found.poses.time_s, recording.robot_time_s, atol=1e-9)
    np.testing.assert_allclose(found.poses.position_mm, recording.robot_position_mm, atol=1e-9)
    same = np.abs(np.sum(found.poses.quaternion_wxyz * recording.robot_quaternion_wxyz, axis=1))
    np.testing.assert_allclose(same, 1, atol=1e-12)


def named(tmp_path: Path, kind: Kind) -> Path:
    return tmp_path / ("bag.bag" if kind == "rosbag1" else "bag")


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("name", [POSE, TRANSFORM, ODOMETRY])
def test_every_bag_and_pose_comes_back(recording: Recording, tmp_path: Path, kind: Kind, name: str) -> None:
    ros = Ros(kind)
    path = ros.write(named(tmp_path, kind), [*profile_entries(ros, recording), *pose_entries(ros, recording, name)])
    assert bags.recognises(path, b"", Mapping(format="import-mapping", version=1))
    found = imported(path)
    agrees(found, recording)
    assert found.profiles is not None
    np.testing.assert_array_equal(found.profiles.intensity, recording.intensity)
    assert any("/profiles (PointCloud2, 30)" in note for note in found.notes)


ZSTD = rosbag2.CompressionFormat.ZSTD


@pytest.mark.parametrize(
    ("kind", "compression"),
    [
        ("mcap", (rosbag2.CompressionMode.STORAGE, ZSTD)),
        ("mcap", (rosbag2.CompressionMode.FILE, ZSTD)),
        ("sqlite3", (rosbag2.CompressionMode.MESSAGE, ZSTD)),
        ("sqlite3", (rosbag2.CompressionMode.FILE, ZSTD)),
        ("rosbag1", (rosbag1.Writer.CompressionFormat.BZ2,)),
        ("rosbag1", (rosbag1.Writer.CompressionFormat.LZ4,)),
    ],
)
def test_compressed_bags(recording: Recording, tmp_path: Path, kind: Kind, compression: tuple[Any, ...]) -> None:
    ros = Ros(kind)
    entries = [*profile_entries(ros, recording), *pose_entries(ros, recording)]
    agrees(imported(ros.write(named(tmp_path, kind), entries, compression)), recording)


@pytest.mark.parametrize("kind", KINDS)
def test_a_chain_of_frames_gives_poses_and_hand_eye(recording: Recording, tmp_path: Path, kind: Kind) -> None:
    """base -> (fixed) pedestal -> (moving) tool0 -> (fixed) laser; the flange in the base is what was put in."""
    ros, path = Ros(kind), named(tmp_path, kind)
    pedestal = pose_from(rotation_from_quaternion(np.array([0.6, 0, 0.8, 0])), np.array([10.0, -200.0, 900.0]))
    flange = pose_from(rotation_from_quaternion(recording.robot_quaternion_wxyz), recording.robot_position_mm)
    moved = inverse(pedestal) @ flange
    q = Rotation.from_matrix(moved[:, :3, :3]).as_quat(scalar_first=True)
    moving = replace(recording, robot_position_mm=moved[:, :3, 3], robot_quaternion_wxyz=q)
    entries = [*profile_entries(ros, recording)]
    for _, _, time_ns, transform in pose_entries(ros, moving, TRANSFORM):
        transform.header.frame_id = "pedestal"
        entries.append(("/tf", TF, time_ns, ros.tf(transform)))
    fixed = [
        ros.pose(TRANSFORM, 0.0, np.array([0.01, -0.2, 0.9]), np.array([0.6, 0, 0.8, 0]), "base", "pedestal"),
        ros.pose(TRANSFORM, 0.0, np.array([0.05, 0.0, 0.1]), np.array([0, 1, 0, 0]), "tool0", "laser"),
    ]
    entries.append(("/tf_static", TF, 1, ros.tf(*fixed)))
    found = imported(ros.write(path, entries), base_frame="base", flange_frame="tool0", profiler_frame="laser")
    agrees(found, recording)
    expected = [[1, 0, 0, 50], [0, -1, 0, 0], [0, 0, -1, 100], [0, 0, 0, 1]]
    np.testing.assert_allclose(found.flange_from_profiler, expected, atol=1e-9)


@pytest.mark.parametrize("kind", KINDS)
def test_joint_states_go_through_the_urdf(recording: Recording, tmp_path: Path, kind: Kind) -> None:
    from workbench.robot import inverse_kinematics, read_cell

    ros = Ros(kind)
    flange = pose_from(rotation_from_quaternion(recording.robot_quaternion_wxyz), recording.robot_position_mm)
    joints = inverse_kinematics(read_cell(DATA / "robot" / "cell.json").chain, flange)[:, 0]
    entries = [*profile_entries(ros, recording)]
    for time_s, row in zip(recording.robot_time_s, joints, strict=True):
        state = ros.joints(time_s, {f"joint_{i}": row[i - 1] for i in (3, 1, 2, 6, 5, 4)})
        entries.append(("/joint_states", JOINTS, round(time_s * 1e9), state))
        entries.append(("/joint_states", JOINTS, round(time_s * 1e9) + 1, ros.joints(time_s, {"gripper": 0.0})))
    path = ros.write(named(tmp_path, kind), entries)
    urdf = str(DATA / "robot" / "irb6700_150_320.urdf")
    found = imported(path, urdf=urdf, base_frame="base_link", flange_frame="tool0")
    agrees(found, recording)
    assert any("170 messages of other joints" in note for note in found.notes)


def test_time_of_recording_where_the_mapping_says_so(recording: Recording, tmp_path: Path) -> None:
    ros = Ros("mcap")
    path = ros.write(tmp_path / "bag", [*profile_entries(ros, recording), *pose_entries(ros, recording)])
    found = imported(path, time="message")  # the test bags are recorded 1 ms after the stamps
    assert found.profiles is not None
    assert found.poses is not None
    np.testing.assert_allclose(found.profiles.time_s, recording.time_s + 1e-3, atol=1e-9)
    np.testing.assert_allclose(found.poses.time_s, recording.robot_time_s + 1e-3, atol=1e-9)


def test_units_and_axes_as_the_mapping_says(recording: Recording, tmp_path: Path) -> None:
    """A driver that counts in mm, with range along -x and lateral along y."""
    ros = Ros("mcap")
    entries: list[Entry] = [*pose_entries(ros, recording)]
    for i, time_s in enumerate(recording.time_s):
        fields = {"x": -recording.z_mm[i], "y": recording.x_mm[i], "z": np.zeros(100, np.float32)}
        entries.append(("/profiles", CLOUD, round(time_s * 1e9), ros.cloud(time_s, fields)))
    path = ros.write(tmp_path / "bag", entries)
    agrees(imported(path, length_unit="mm", lateral="y", range="-x"), recording)
    with pytest.raises(InputError, match=r"/profiles\[0\]: expected points in the plane"):
        imported(path, length_unit="mm")


def test_an_organised_cloud_is_many_profiles(recording: Recording, tmp_path: Path) -> None:
    ros, period_s = Ros("mcap"), 0.002
    x, z = recording.x_mm / np.float32(1e3), recording.z_mm / np.float32(1e3)
    entries: list[Entry] = [
        ("/surface", CLOUD, k, ros.cloud(10.0 + k, {"x": x[10 * k : 10 * k + 10], "z": z[10 * k : 10 * k + 10]}))
        for k in range(3)
    ]
    path = ros.write(tmp_path / "bag", entries)
    with pytest.raises(InputError, match=r"10 profiles with one time: expected \$.bag.row_period_s"):
        imported(path)
    found = imported(path, row_period_s=period_s)
    assert found.profiles is not None
    np.testing.assert_allclose(found.profiles.z_mm, recording.z_mm, atol=2e-5)
    expected = [10.0 + k + period_s * row for k in range(3) for row in range(10)]
    np.testing.assert_allclose(found.profiles.time_s, expected)


def test_passes_by_topic_and_by_gap(recording: Recording, tmp_path: Path) -> None:
    """Two topics, the second with a pause after its tenth frame: three passes."""
    ros = Ros("mcap")
    moved = replace(recording, time_s=recording.time_s + np.where(np.arange(30) < 20, 0.0, 5.0))
    entries = [("/left" if i < 10 else "/right", *e[1:]) for i, e in enumerate(profile_entries(ros, moved))]
    path = ros.write(tmp_path / "bag", entries)
    for gap_s, expected in [(None, [0, 1, 1]), (1.0, [0, 1, 2])]:
        found = imported(path, profiles=["/left", "/right"], pass_gap_s=gap_s).profiles
        assert found is not None
        np.testing.assert_array_equal(found.pass_index, np.repeat(expected, 10))
    alone = imported(path, profiles=["/left"], pass_gap_s=1.0).profiles
    assert alone is not None
    assert alone.pass_index is None


def test_zeros_and_infinities_as_the_mapping_says(recording: Recording, tmp_path: Path) -> None:
    ros = Ros("sqlite3")
    x, z = recording.x_mm.copy(), recording.z_mm.copy()
    x[:, 5], z[:, 5] = 0, 0
    z[:, 6] = np.inf
    path = ros.write(tmp_path / "bag", [*profile_entries(ros, replace(recording, x_mm=x, z_mm=z))])
    with pytest.raises(InputError, match=r'/profiles\[0\]: 1 points at 0, 0, 0: expected "zero" in \$.bag.no_return'):
        imported(path)
    with pytest.raises(InputError, match='1 points at an infinite place: expected "inf"'):
        imported(path, no_return=["zero"])
    found = imported(path, no_return=["zero", "inf"])
    assert found.profiles is not None
    assert np.isnan(found.profiles.z_mm[:, [5, 6]]).all()
    z[:, 6] = 100
    path = ros.write(tmp_path / "real", [*profile_entries(ros, replace(recording, x_mm=x, z_mm=z))])
    kept = imported(path, no_return=["nan"]).profiles
    assert kept is not None
    assert (kept.z_mm[:, 5] == 0).all()


@pytest.mark.parametrize("sign", [1, -1])
def test_points_that_a_driver_left_out_leave_their_columns_free(
    recording: Recording, tmp_path: Path, sign: int
) -> None:
    """Only what gave a return is sent, as most drivers do: the grid is what it was, up to its first column."""
    ros = Ros("rosbag1")
    entries: list[Entry] = []
    for x, z, time_s in zip(sign * recording.x_mm, recording.z_mm, recording.time_s, strict=True):
        seen = np.isfinite(z)
        seen[[0, 50, 51]] &= time_s > recording.time_s[3]
        fields = {"x": x[seen] / np.float32(1e3), "z": z[seen] / np.float32(1e3)}
        fields = {name: values[:0] for name, values in fields.items()} if time_s == recording.time_s[7] else fields
        entries.append(("/profiles", CLOUD, round(time_s * 1e9), ros.cloud(time_s, fields)))
    path = ros.write(tmp_path / "ragged.bag", entries)
    found = imported(path)
    assert found.profiles is not None
    expected = recording.z_mm.copy()
    expected[:4, [0, 50, 51]] = np.nan
    expected[7] = np.nan
    begin = int(np.flatnonzero(np.isfinite(expected).any(axis=0))[0])
    end = begin + found.profiles.z_mm.shape[1]
    np.testing.assert_allclose(found.profiles.z_mm, expected[:, begin:end], atol=2e-5)
    assert np.isnan(expected[:, end:]).all()
    assert any("columns by the gaps in x" in note for note in found.notes)
    assert any("1 messages without points" in note for note in found.notes)
    counted = imported(path, ragged="count").profiles
    assert counted is not None
    assert np.isfinite(counted.z_mm[0, :90]).all()
