"""An inspection of a recording that went through a bag gives the numbers of the original."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.conftest import Outcome
from tests.importing.bag_files import JOINTS, POSE, TF, TRANSFORM, Entry, Kind, Ros, pose_entries, profile_entries
from workbench.artefacts import Recording
from workbench.cloud.denoise import denoise
from workbench.edge.segment import segment
from workbench.geometry.poses import pose_from, rotation_from_quaternion
from workbench.inspect.sections import sections
from workbench.robot import inverse_kinematics, read_cell
from workbench.scan.fuse import fuse
from workbench.scan.read import read as read_recording
from workbench.units import Float

DATA = Path(__file__).parents[2] / "data"


@pytest.fixture(scope="module")
def original() -> Recording:
    """A milled edge with a pose every 10 ms."""
    return read_recording(recording=DATA / "synthetic" / "milled_arc.h5")


@pytest.fixture(scope="module")
def expected(original: Recording) -> Float:
    return inspected(original)


def inspected(recording: Recording) -> Float:
    """Root face and bevel angle of nine sections with their uncertainties, and where they lie."""
    found = sections(segment(denoise(fuse(recording))))
    return np.array(
        [[s.root_mm, s.bevel_deg, s.root_u_mm, s.bevel_u_deg, s.arc_length_mm] for s in found.sections], float
    )


def by_pose(ros: Ros, recording: Recording) -> tuple[list[Entry], dict[str, Any]]:
    return list(pose_entries(ros, recording, POSE)), {}


def by_frames(ros: Ros, recording: Recording) -> tuple[list[Entry], dict[str, Any]]:
    """/tf with the flange, /tf_static with the profiler on it."""
    transforms = pose_entries(ros, recording, TRANSFORM)
    entries = [("/tf", TF, time_ns, ros.tf(transform)) for _, _, time_ns, transform in transforms]
    assert recording.flange_from_profiler is not None
    from scipy.spatial.transform import Rotation

    q = Rotation.from_matrix(recording.flange_from_profiler[:3, :3]).as_quat(scalar_first=True)
    fixed = ros.pose(TRANSFORM, 0.0, recording.flange_from_profiler[:3, 3] / 1000, q, "tool0", "laser")
    bag = {"base_frame": "base_link", "flange_frame": "tool0", "profiler_frame": "laser"}
    return [*entries, ("/tf_static", TF, 0, ros.tf(fixed))], bag


def by_joints(ros: Ros, recording: Recording) -> tuple[list[Entry], dict[str, Any]]:
    """The shipped robot's joints at every pose."""
    flange = pose_from(rotation_from_quaternion(recording.robot_quaternion_wxyz), recording.robot_position_mm)
    chain = read_cell(DATA / "robot" / "cell.json").chain
    joints = inverse_kinematics(chain, flange)[:, 0]
    entries: list[Entry] = [
        ("/joint_states", JOINTS, round(t * 1e9), ros.joints(t, dict(zip(chain.joint_names, row, strict=True))))
        for t, row in zip(recording.robot_time_s, joints, strict=True)
    ]
    urdf = str(DATA / "robot" / "irb6700_150_320.urdf")
    return entries, {"urdf": urdf, "base_frame": "base_link", "flange_frame": "tool0"}


@pytest.mark.parametrize(("kind", "write"), [("mcap", by_pose), ("sqlite3", by_frames), ("rosbag1", by_joints)])
def test_the_inspection_is_the_same(
    original: Recording,
    expected: Float,
    tmp_path: Path,
    command: Callable[..., Outcome],
    kind: Kind,
    write: Callable[[Ros, Recording], tuple[list[Entry], dict[str, Any]]],
) -> None:
    """The profiler's clock is 1,000 s ahead, and the mapping says so. All numbers agree to 1e-5 mm and deg."""
    ros = Ros(kind)
    entries, bag = write(ros, original)
    ahead = replace(original, time_s=original.time_s + 1000)
    path = ros.write(tmp_path / ("b.bag" if kind == "rosbag1" else "b"), [*profile_entries(ros, ahead), *entries])
    mapping: dict[str, Any] = {"format": "import-mapping", "version": 1, "part_id": "arc"}
    mapping |= {"times": {"source": "file", "clock_offset_s": 1000}, "bag": bag}
    if write is not by_frames:
        assert original.flange_from_profiler is not None
        mapping["hand_eye"] = {"flange_from_profiler": original.flange_from_profiler.tolist()}
    (tmp_path / "map.json").write_text(json.dumps(mapping))
    outcome = command("import", path, "--mapping", tmp_path / "map.json", "--out", tmp_path / "r.h5")
    assert (outcome.status, outcome.err) == (0, "")
    assert "325 frames of 600 columns" in outcome.out
    found = inspected(read_recording(recording=tmp_path / "r.h5"))
    difference = np.abs(found - expected).max(axis=0)
    assert difference.max() < 1e-5, difference  # times 1,000 s ahead are rounded to 1e-13 s


def test_frames_outside_the_poses_are_refused_or_trimmed(
    original: Recording, tmp_path: Path, command: Callable[..., Outcome]
) -> None:
    ros, keep = Ros("mcap"), slice(100, 551)  # poses of the middle only
    middle = replace(
        original,
        robot_time_s=original.robot_time_s[keep],
        robot_position_mm=original.robot_position_mm[keep],
        robot_quaternion_wxyz=original.robot_quaternion_wxyz[keep],
        robot_pass=original.robot_pass[keep],
    )
    path = ros.write(tmp_path / "b", [*profile_entries(ros, original), *pose_entries(ros, middle)])
    arguments = ("import", path, "--out", tmp_path / "r.h5")
    refused = command(*arguments)
    assert refused.status == 2
    lost = int(np.sum((original.time_s < middle.robot_time_s[0]) | (original.time_s > middle.robot_time_s[-1])))
    assert f"{lost} of 325 frames lie outside the poses" in refused.err
    assert not (tmp_path / "r.h5").exists()
    (tmp_path / "map.json").write_text(json.dumps({"format": "import-mapping", "version": 1, "outside": "trim"}))
    trimmed = command(*arguments, "--mapping", tmp_path / "map.json")
    assert trimmed.status == 0
    assert f"left out: {lost} of 325 frames" in trimmed.out
    assert len(read_recording(recording=tmp_path / "r.h5").time_s) == 325 - lost


def test_a_mapping_with_an_unknown_key_is_refused(tmp_path: Path, command: Callable[..., Outcome]) -> None:
    mapping = {"format": "import-mapping", "version": 1, "bag": {"pose": "/flange"}}
    (tmp_path / "map.json").write_text(json.dumps(mapping))
    (tmp_path / "b.mcap").write_bytes(b"")
    outcome = command("import", tmp_path / "b.mcap", "--out", tmp_path / "r.h5", "--mapping", tmp_path / "map.json")
    assert outcome.status == 2
    assert "$.bag.pose" in outcome.err
    assert "poses" in outcome.err
