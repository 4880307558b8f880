"""Drafted mappings: what a stranger's files are is found, written as a mapping, and what is uncertain marked."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tests.importing import makers
from tests.importing.conftest import ORIENTATIONS, rows_of, turned
from workbench.artefacts import Recording
from workbench.checks import judge_recording, refuse_failed
from workbench.cli import main
from workbench.errors import InputError
from workbench.robot import forward_kinematics, read_cell
from workbench.scan import read

NAMES = {  # convention -> names of the columns as its controller's users write them
    "kuka_abc": ["A", "B", "C"],
    "fanuc_wpr": ["W", "P", "R"],
    "quaternion_wxyz": ["qw", "qx", "qy", "qz"],
    "abb": ["q1", "q2", "q3", "q4"],
    "ur": ["rx", "ry", "rz"],
}


def drafted(tmp_path: Path, capsys: Any, *sources: Path) -> tuple[dict[str, Any], str]:
    out = tmp_path / "map.json"
    assert main(["import", "--draft", *map(str, sources), "--out", str(out)]) == 0, capsys.readouterr().err
    return json.loads(out.read_text()), capsys.readouterr().out


def write(tmp_path: Path, recording: Recording, convention: str, delimiter: str, decimal: str, unit_mm: float) -> Any:
    every = slice(None, None, 20)
    frames, columns = recording.z_mm[every].shape
    table = zip(
        np.repeat(np.arange(frames), columns).tolist(),
        np.repeat(recording.time_s[every] * 1e3 + 7000.0, columns).tolist(),
        recording.x_mm[every].astype(float).ravel().tolist(),
        np.nan_to_num(recording.z_mm[every].astype(float), nan=-999.999).ravel().tolist(),
        strict=True,
    )
    scan = tmp_path / "scan.csv"
    scan.write_text(
        delimiter.join(["Profile", "Timestamp [ms]", "X (mm)", "Z (mm)"]) + "\n" + rows_of(table, delimiter, decimal)
    )
    values = ORIENTATIONS[convention](turned(recording.robot_quaternion_wxyz))
    rows = np.hstack([recording.robot_time_s[:, None], recording.robot_position_mm / unit_mm, values])
    robot = tmp_path / "robot.txt"
    header = delimiter.join(["time_s", "X", "Y", "Z", *NAMES[convention]])
    robot.write_text("# log of the robot\n\n" + header + "\n" + rows_of(rows.tolist(), delimiter, decimal))
    return scan, robot


FORMS = [(",", ".", 1.0), (";", ",", 1000.0), ("\t", ".", 1.0)]


@pytest.mark.parametrize(
    ("convention", "delimiter", "decimal", "unit_mm"), [(one, *FORMS[k % 3]) for k, one in enumerate(NAMES)]
)
def test_a_drafted_mapping_brings_it_in(
    convention: str,
    delimiter: str,
    decimal: str,
    unit_mm: float,
    milled: Recording,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    imported: Callable[..., Recording],
) -> None:
    sources = write(tmp_path, milled, convention, delimiter, decimal, unit_mm)
    tree, _ = drafted(tmp_path, capsys, *sources)
    assert tree["poses"]["convention"] == convention
    assert tree["poses"]["length_unit"] == ("mm" if unit_mm == 1 else "m")
    assert (tree["profiles"]["time_unit"], tree["profiles"]["missing"]) == ("ms", [-999.999])
    assert tree["times"] == {"source": "file", "clock_offset_s": pytest.approx(7.0, abs=0.05)}
    assert any("clock" in text for text in tree["uncertain"])
    assert any("hand_eye" in text for text in tree["lacking"])
    got = imported(*sources, mapping=tmp_path / "map.json")
    np.testing.assert_allclose(got.z_mm, milled.z_mm[::20], atol=1e-4)
    np.testing.assert_allclose(got.robot_position_mm, milled.robot_position_mm, atol=1e-6)
    same = np.abs((got.robot_quaternion_wxyz * milled.robot_quaternion_wxyz).sum(axis=1))  # q and -q are equal
    np.testing.assert_allclose(same, 1.0, atol=1e-9)


def test_units_below_the_header_and_a_log_that_lasts_as_long(
    milled: Recording, tmp_path: Path, capsys: pytest.CaptureFixture[str], imported: Callable[..., Recording]
) -> None:
    """Steps of 25 could be seconds: the frames would then last a thousandth of the log."""
    scan, robot = write(tmp_path, milled, "quaternion_wxyz", ";", ".", 1.0)
    rows = scan.read_text().split("\n")[1:]
    scan.write_text("\n".join(["profile;timestamp;x;z", "-;ms;[mm];[mm]", *rows]))
    every = slice(None, None, int(np.ceil(0.025 / np.median(np.diff(milled.robot_time_s)))))
    values = [milled.robot_time_s[:, None] * 1e3, milled.robot_position_mm, milled.robot_quaternion_wxyz]
    robot.write_text("timestamp,x,y,z,qw,qx,qy,qz\n" + rows_of(np.hstack(values)[every].tolist(), ","))
    tree, _ = drafted(tmp_path, capsys, scan, robot)
    assert tree["poses"]["time_unit"] == "ms"
    assert any("poses.time_unit: ms" in text and "s would be possible" in text for text in tree["uncertain"])
    assert not [text for text in tree["uncertain"] if "profiles.length_unit" in text or "profiles.time_unit" in text]
    got = imported(scan, robot, mapping=tmp_path / "map.json")
    np.testing.assert_allclose(got.z_mm, milled.z_mm[::20], atol=1e-4)
    for other in ("-;ms;[mm];[um]", "-;us;[mm];[mm]"):
        scan.write_text("\n".join(["profile;timestamp;x;z", other, *rows]))
        with pytest.raises(InputError, match=r"as the mapping says, found u[ms] below the header"):
            imported(scan, robot, mapping=tmp_path / "map.json")
    scan.write_text("profile;timestamp;x;z")
    with pytest.raises(InputError, match="expected rows of numbers"):
        imported(scan, robot, mapping=tmp_path / "map.json")


def test_what_nobody_has_confirmed_is_not_measured_by(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], imported: Callable[..., Recording]
) -> None:
    """A pitch that stands in for the sensor's makes every length wrong: refused until its line is taken away."""
    z = np.tile(np.nan_to_num(makers.heights_mm()), (1, 2))
    (tmp_path / "rows.csv").write_text(rows_of([[*range(z.shape[1])], *z.tolist()], ","))
    tree, _ = drafted(tmp_path, capsys, tmp_path / "rows.csv")
    got = imported(tmp_path / "rows.csv", mapping=tmp_path / "map.json")
    assert got.not_confirmed == tuple(tree["uncertain"])
    failed = [check for check in judge_recording(got) if check.name == "not_confirmed"]
    assert [(check.passed, check.value) for check in failed] == [(False, len(tree["uncertain"]))]
    assert "profiles.x_pitch" in failed[0].finding
    with pytest.raises(InputError, match="take their lines out of its list 'uncertain'"):
        refuse_failed(failed, "rows.csv")
    (tmp_path / "map.json").write_text(json.dumps({**tree, "uncertain": []}))
    got = imported(tmp_path / "rows.csv", mapping=tmp_path / "map.json")
    assert not [check for check in judge_recording(got) if check.name == "not_confirmed"]


def test_files_that_explain_themselves_need_nothing(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    tree, told = drafted(tmp_path, capsys, makers.write_gocator(tmp_path / "a.csv"))
    assert tree == {"format": "import-mapping", "version": 1}
    assert "Gocator CSV surface" in told


def test_frames_that_start_anew(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    z = makers.heights_mm()
    rows = [
        (float(x), -999.99 if np.isnan(v) else float(v)) for row in z for x, v in zip(makers.X_MM, row, strict=True)
    ]
    (tmp_path / "s.txt").write_text(rows_of(rows, " "))
    tree, _ = drafted(tmp_path, capsys, tmp_path / "s.txt")
    assert tree["profiles"]["frames"] == "restart"
    assert tree["profiles"]["missing"] == [-999.99]
    out = tmp_path / "a.h5"
    assert main(["import", str(tmp_path / "s.txt"), "--out", str(out), "--mapping", str(tmp_path / "map.json")]) == 0
    told = capsys.readouterr().out
    assert "6 frames of 40 columns" in told
    assert "not confirmed: times.pitch_mm" in told


POSE_NAMES = "time_s,x_mm,y_mm,z_mm,qw,qx,qy,qz,pass"


def log_of(recording: Recording) -> str:
    """The poses with their passes' numbers."""
    columns = (recording.robot_time_s[:, None], recording.robot_position_mm, recording.robot_quaternion_wxyz)
    return f"{POSE_NAMES}\n" + rows_of(np.hstack([*columns, recording.robot_pass[:, None]]).tolist())


def points_of(recording: Recording) -> np.ndarray:
    """Pass, number of the frame (from 7), time, x, z and whether it returned, of every 20th frame; a number for z."""
    every = slice(None, None, 20)
    z, x = recording.z_mm[every].astype(float), recording.x_mm[every].astype(float)
    frame = (recording.pass_index[every], np.arange(len(z)) + 7, recording.time_s[every])
    columns = [np.repeat(one, z.shape[1]) for one in frame]
    lost = np.isnan(z)
    return np.column_stack([*columns, x.ravel(), np.where(lost, 140.5, z).ravel(), ~lost.ravel()])


def test_columns_are_told_by_what_they_do(
    tmp_path: Path, two_pass: Recording, capsys: pytest.CaptureFixture[str]
) -> None:
    """Both passes in one table; a count of frames by no known name; what did not return says so."""
    scan, robot, out = tmp_path / "scan.csv", tmp_path / "robot.csv", tmp_path / "a.h5"
    scan.write_text("pass,shot,time_s,x_mm,z_mm,valid\n" + rows_of(points_of(two_pass).tolist()))
    robot.write_text(log_of(two_pass))
    tree, _ = drafted(tmp_path, capsys, scan, robot)
    assert tree["profiles"]["columns"]["frame"] == "shot"
    assert any("shot" in doubt for doubt in tree["uncertain"])
    assert main(["import", str(scan), str(robot), "--mapping", str(tmp_path / "map.json"), "--out", str(out)]) == 0
    made = read(recording=out)
    np.testing.assert_array_equal(made.pass_index, two_pass.pass_index[::20])
    np.testing.assert_array_equal(made.z_mm, two_pass.z_mm[::20])


def test_passes_with_logs_of_their_own_share_a_clock(
    tmp_path: Path, two_pass: Recording, capsys: pytest.CaptureFixture[str]
) -> None:
    """The second pass lies after the first log, in its own: no offset is made up."""
    points, log = points_of(two_pass), log_of(two_pass).splitlines()
    sources = []
    for k in (0, 1):
        sources += [tmp_path / f"scan{k}.csv", tmp_path / f"robot{k}.csv"]
        sources[-2].write_text("frame,time_s,x_mm,z_mm\n" + rows_of(points[points[:, 0] == k, 1:5].tolist()))
        rows = [row.rsplit(",", 1)[0] for row in log[1:] if float(row.rsplit(",", 1)[1]) == k]
        sources[-1].write_text("\n".join([POSE_NAMES[:-5], *rows]) + "\n")
    assert "times" not in drafted(tmp_path, capsys, *sources)[0]


def test_an_encoder_may_count(tmp_path: Path, two_pass: Recording, capsys: pytest.CaptureFixture[str]) -> None:
    """A way without a unit is a doubt; beyond the flange's way it is refused by both."""
    points = points_of(two_pass)
    points = points[points[:, 0] == 0]
    points[:, 2] = 400 * (points[:, 1] - 7)
    scan, robot = tmp_path / "scan.csv", tmp_path / "robot.csv"
    scan.write_text("frame,encoder,x_mm,z_mm\n" + rows_of(points[:, 1:5].tolist()))
    robot.write_text("\n".join(log_of(two_pass).splitlines()[:3]) + "\n")
    tree, _ = drafted(tmp_path, capsys, scan, robot)
    assert any("'encoder' is taken as mm" in doubt for doubt in tree["uncertain"])
    assert any("mm on its" in text for text in tree["lacking"])


NO_TABLES = {
    "dates": ("t,x,y\n2026-03-01T10:00:00,1,2\n2026-03-01T10:00:01,1,2\n2026-03-01T10:00:02,1,2\n", "is no number"),
    "uneven rows": ("1,2,3\n" * 3 + "1,2,3,4\n" * 9, "line 1 has another number of cells than line 11 with 4"),
    "two units": (
        "frame,X [mm],Z [um]\n" + "".join(f"{k // 4},{k % 4},3\n" for k in range(16)),
        r"'X \[mm\]' and 'Z \[um\]'",
    ),
}


@pytest.mark.parametrize("case", NO_TABLES)
def test_what_keeps_a_table_from_being_read_is_named(
    case: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text, words = NO_TABLES[case]
    (tmp_path / "a.csv").write_text(text)
    assert main(["import", "--draft", str(tmp_path / "a.csv"), "--out", str(tmp_path / "m.json")]) == 2
    assert re.search(words, capsys.readouterr().err)


@pytest.mark.parametrize("text", ["", "hello\n", "a,b\n1,2\n3,4\n", "\0\0\0\0", "1\n2\n3\n"])
def test_what_is_no_table_ends_in_one_line(text: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "a.csv").write_text(text)
    assert main(["import", "--draft", str(tmp_path / "a.csv"), "--out", str(tmp_path / "m.json")]) == 2
    assert capsys.readouterr().err.count("\n") == 1
    assert not (tmp_path / "m.json").exists()


@pytest.mark.parametrize(
    "scale", [1.0, 0.1]
)  # of two points a row in mm, as a seam tracker writes: in no robot's reach
def test_two_points_a_row_are_no_poses(scale: float, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    time = 27.6 * np.arange(60)
    point = scale * np.stack([0.03 * np.sin(time), 20 * np.sin(time / 900), -130 + 9 * np.cos(time / 700)], axis=1)
    source = tmp_path / "seam.txt"
    np.savetxt(source, np.column_stack([time, point, point - np.array([0.0, 11.0 * scale, 0.4])]), fmt="%.6g")
    assert main(["import", "--draft", str(source), "--out", str(tmp_path / "m.json")]) == 2
    assert "expected columns x and z of points" in capsys.readouterr().err


def test_a_controllers_stream_without_names_is_in_ms(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """External guidance writes a pose every 4 ms; 600 poses 4 s apart would take 40 minutes."""
    time = 4.0 * np.arange(600)
    turn = 0.05 * np.sin(time[:, None] / [300.0, 400.0, 500.0])
    place = np.array([2100.0, 0.0, 1000.0]) + 50 * np.sin(time[:, None] / [310.0, 420.0, 530.0])
    source = tmp_path / "egm.txt"
    np.savetxt(source, np.column_stack([time, turn, place]), fmt="%.6g")
    tree, _ = drafted(tmp_path, capsys, source)
    assert (tree["poses"]["time_unit"], tree["poses"]["length_unit"]) == ("ms", "mm")
    assert any("logarithm" in text for text in tree["uncertain"])


JOINTS_RAD = np.radians(
    [[0, 10, 20, -30, 45, 0], [5, 15, 18, 30, 50, 100.0], [9, 21, 17, 3, 52, 110], [1, 2, 3, 4, 5, 6]]
)


@pytest.mark.parametrize(
    ("header", "unit", "sure"),
    [
        ("time_s,j1,j2,j3,j4,j5,j6", "deg", False),
        ("time_s,q1_deg,q2_deg,q3_deg,q4_deg,q5_deg,q6_deg", "deg", True),
        ("t,axis1,axis2,axis3,axis4,axis5,axis6", "rad", False),
        ("time,A1 [deg],A2 [deg],A3 [deg],A4 [deg],A5 [deg],A6 [deg]", "deg", True),
        ("timestamp,actual_q_0,actual_q_1,actual_q_2,actual_q_3,actual_q_4,actual_q_5", "rad", False),
        (
            "time,elbow_joint,shoulder_lift_joint,shoulder_pan_joint,wrist_1_joint,wrist_2_joint,wrist_3_joint",
            "rad",
            False,
        ),
        ("time,S,L,U,R,B,T", "deg", False),
    ],
)
def test_joints_are_drafted_without_their_robot(
    header: str, unit: str, sure: bool, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The draft names what is lacking; with the robot's URDF in it the poses follow."""
    names = header.split(",")
    order = [2, 1, 0, 3, 4, 5] if "elbow" in header else [*range(6)]  # the robot's order, not the file's
    table = JOINTS_RAD[:, order] * (1.0 if unit == "rad" else 180 / np.pi)
    rows = [header, *(",".join(f"{v:.9g}" for v in [0.1 * k, *row]) for k, row in enumerate(table))]
    source = tmp_path / "q.csv"
    source.write_text("\n".join(rows) + "\n")
    tree, told = drafted(tmp_path, capsys, source)
    part = tree["joints"]
    assert (part["angle_unit"], part["time"], part["time_unit"]) == (unit, names[0], "s")
    assert part["columns"] == [names[1 + k] for k in order]
    assert any("joints.angle_unit" in text for text in tree.get("uncertain", [])) != sure
    assert "lacking: joints.urdf" in told
    assert main(["look", str(source)]) == 0
    shown = capsys.readouterr().out
    assert "joint angles of a robot" in shown
    assert "postures: 4" in shown
    assert (" 0 to 9 deg" if unit == "deg" else " 0 to 0.15708 rad") in shown
    z = np.tile(np.linspace(80.0, 90.0, 40), (4, 1))
    np.savez(tmp_path / "scan.npz", x=np.tile(np.linspace(-20.0, 20.0, 40), (4, 1)), z=z, time=0.09 * np.arange(4))
    arguments = [str(tmp_path / "scan.npz"), str(source), "--out", str(tmp_path / "a.h5"), "--mapping"]
    assert main(["import", *arguments, str(tmp_path / "map.json")]) == 2
    assert "expected urdf, base_frame and flange_frame" in capsys.readouterr().err
    robot = Path(__file__).parents[2] / "data" / "robot"
    part |= {"urdf": str(robot / "irb6700_150_320.urdf"), "base_frame": "base_link", "flange_frame": "tool0"}
    tree["accept"] = ["length_unit", "direction", "time_unit"]
    (tmp_path / "map.json").write_text(json.dumps(tree))
    assert main(["import", *arguments, str(tmp_path / "map.json")]) == 0
    expected = forward_kinematics(read_cell(robot / "cell.json").chain, JOINTS_RAD)
    np.testing.assert_allclose(read(tmp_path / "a.h5").robot_position_mm, expected[:, :3, 3], atol=1e-3)


@pytest.mark.parametrize(("unit", "mm"), [("mm", 1.0), ("m", 1000.0), ("inch", 25.4)])
def test_the_units_of_arrays_are_told_by_their_numbers(
    unit: str, mm: float, tmp_path: Path, capsys: pytest.CaptureFixture[str], imported: Callable[..., Recording]
) -> None:
    poses = np.tile(np.eye(4), (25, 1, 1))
    poses[:, :3, 3] = np.linspace([900, 0, 500], [900, 60, 500], 25) / mm
    np.savez(tmp_path / "poses.npz", base_from_flange=poses)
    tree, _ = drafted(tmp_path, capsys, tmp_path / "poses.npz")
    assert tree["arrays"]["length_unit"] == unit
    assert any("arrays.length_unit" in text for text in tree["uncertain"])
    assert main(["look", str(tmp_path / "poses.npz")]) == 0
    shown = capsys.readouterr().out
    np.savez(tmp_path / "flat.npz", base_from_flange=poses[:1].reshape(1, 16))  # as a row of a table
    assert drafted(tmp_path, capsys, tmp_path / "flat.npz")[0]["arrays"]["length_unit"] == unit
    assert "flange: x 900 to 900 mm, y 0 to 60 mm" in shown
    assert f"arrays.length_unit: {unit}, by the size of the numbers" in shown
    x = np.linspace(-120.0, 120.0, 90) / mm  # that wide alone a profile may be in inch too
    np.savez(tmp_path / "scan.npz", x=x, z=np.full((25, 90), 300.0 / mm))
    drafted(tmp_path, capsys, tmp_path / "scan.npz", tmp_path / "poses.npz")
    got = imported(tmp_path / "scan.npz", tmp_path / "poses.npz", mapping=tmp_path / "map.json")
    np.testing.assert_allclose(got.x_mm[0], x * mm, atol=1e-4)
    np.testing.assert_allclose(got.robot_position_mm, poses[:, :3, 3] * mm)


def test_arrays_that_hold_no_profile_are_refused_by_what_they_hold(tmp_path: Path, capsys: Any) -> None:
    source = tmp_path / "numbers.npz"
    np.savez(source, a=np.ones((5, 5)), b=np.arange(4.0))
    assert main(["import", "--draft", str(source), "--out", str(tmp_path / "map.json")]) == 2
    assert "a (5, 5), b (4,)" in capsys.readouterr().err
    assert not (tmp_path / "map.json").exists()


def test_a_log_of_poses_and_joints_beside_profiles(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], imported: Callable[..., Recording]
) -> None:
    """As ScanBot's folders: TCP poses in m and rotation vectors, joints in rad, Unix seconds; the poses say more."""
    time = 1746226188.685462 + np.arange(60) / 30
    place = np.array([0.063694, 0.179662, 0.450726]) + np.outer(np.arange(60), [1e-3, 0, 0])
    poses = np.column_stack([time, place, np.tile([0.021055, -3.1183, -0.24339], (60, 1))])
    joints = np.column_stack([time, np.tile([1.881769, -1.14364, -1.24418, -2.17118, 1.530733, 3.43612], (60, 1))])
    profile = np.column_stack([np.repeat(time[3:50], 20), np.tile(np.arange(20.0), 47), np.full(940, 200.0)])
    tables = {"robot_tcp_poses": ("x,y,z,rx,ry,rz", poses), "robot_joint_states": ("j1,j2,j3,j4,j5,j6", joints)}
    tables["laser_profiles"] = ("x_mm,z_mm", profile)
    files = [tmp_path / f"{name}.csv" for name in tables]
    for file, (names, rows) in zip(files, tables.values(), strict=True):
        np.savetxt(file, rows, "%.6f", ",", header=f"timestamp,{names}", comments="")
    tree, _ = drafted(tmp_path, capsys, *files)
    assert any(doubt.startswith("poses.flange_from_tool") for doubt in tree["uncertain"])
    got = imported(*files, mapping=tmp_path / "map.json")
    np.testing.assert_allclose(got.robot_position_mm[:, 0], 63.694 + np.arange(3, 50))  # while profiles were taken
    turned_by = Rotation.from_rotvec([0.021055, -3.1183, -0.24339]).inv()
    assert (turned_by * Rotation.from_quat(got.robot_quaternion_wxyz, scalar_first=True)).magnitude().max() < 1e-6


@pytest.mark.parametrize(
    ("header", "convention"),
    [
        (
            "tm,cartesian.pos.x,cartesian.pos.y,cartesian.pos.z,orient.u0,orient.u1,orient.u2,orient.u3",
            "quaternion_wxyz",
        ),
        ("IPOC,RIst.X,RIst.Y,RIst.Z,RIst.A,RIst.B,RIst.C", "kuka_abc"),
    ],
)
def test_streams_of_controllers_go_by_their_own_names(
    header: str, convention: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """EGM's and RSI's; the first was told as one profile on its way along y."""
    rows = np.column_stack([4.0 * np.arange(600), 1200 + 0.1 * np.arange(600), 0.2 * np.arange(600), np.full(600, 800)])
    rows = np.column_stack([rows, np.full((600, header.count(",") - 3), 0.5)])
    path = tmp_path / "log.csv"
    np.savetxt(path, rows, "%.4f", ",", header=header, comments="")
    tree, _ = drafted(tmp_path, capsys, path)
    assert (tree["poses"]["convention"], tree["poses"]["length_unit"]) == (convention, "mm")
    if "IPOC" in header:
        assert (tree["poses"]["time"], tree["poses"]["time_unit"]) == ("IPOC", "ms")
    np.savetxt(path, rows[:, [1, 4, 3, 2]], "%.4f", ",", header="x,y,z,other", comments="")
    assert any(doubt.startswith("profiles.columns") for doubt in drafted(tmp_path, capsys, path)[0]["uncertain"])
