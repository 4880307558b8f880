"""Arrays, joints, clouds, trackers: each comes in as it was made."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.importing.conftest import MAPPING
from tests.seldom import seldom
from workbench.artefacts import Recording
from workbench.cli import main
from workbench.errors import InputError

ROOT = Path(__file__).parents[2]
SHARED = ROOT.parent / "shared" / "data"
Imported = Callable[..., Recording]


def mapping(tmp_path: Path, **parts: Any) -> Path:
    path = tmp_path / "m.json"
    path.write_text(json.dumps({**MAPPING, **parts}))
    return path


@pytest.mark.parametrize("name", ["a.dat", "a.xml", "a.tif", "a.npy"])
def test_heights_without_a_form_of_their_own_become_arrays(name: str, tmp_path: Path, imported: Imported) -> None:
    (tmp_path / name).write_bytes(b"<icon_data_format>" if name == "a.xml" else b"\0\0\x80?")
    with pytest.raises(InputError, match=r"make arrays of it \(docs/importing\.md#other-forms\)"):
        imported(tmp_path / name)


def test_arrays(tmp_path: Path, milled: Recording, imported: Imported) -> None:
    every = slice(None, None, 20)
    np.savez(tmp_path / "scan.npz", x=milled.x_mm[every], z=milled.z_mm[every], time=milled.time_s[every])
    poses = {"position": milled.robot_position_mm, "quaternion_wxyz": milled.robot_quaternion_wxyz}
    np.savez(tmp_path / "robot.npz", **poses, time=milled.robot_time_s)
    got = imported(tmp_path / "scan.npz", tmp_path / "robot.npz", mapping=mapping(tmp_path))
    np.testing.assert_array_equal(got.z_mm, milled.z_mm[every])
    np.testing.assert_array_equal(got.time_s, milled.time_s[every])
    np.testing.assert_array_equal(got.robot_position_mm, milled.robot_position_mm)


@pytest.mark.parametrize(("axis", "other"), [("x", "z"), ("z", "x")])
def test_a_code_beside_a_lost_return_is_refused(
    axis: str, other: str, tmp_path: Path, milled: Recording, imported: Imported
) -> None:
    grids = {"x": np.array(milled.x_mm), "z": np.array(milled.z_mm)}
    grids[axis][5, 7], grids[other][5, 7] = -1e6, np.nan
    np.savez(tmp_path / "scan.npz", **grids, time=milled.time_s, travel=np.arange(float(len(milled.time_s))))
    with pytest.raises(InputError, match=f"frame 6: expected mm or no return, found {axis} = -1e\\+06 in column 8"):
        imported(tmp_path / "scan.npz", mapping=mapping(tmp_path))


def test_joints_in_arrays_are_not_left_out_in_silence(tmp_path: Path, milled: Recording, imported: Imported) -> None:
    joints = np.zeros((len(milled.time_s), 6))
    np.savez(tmp_path / "scan.npz", x=milled.x_mm, z=milled.z_mm, time=milled.time_s, joints=joints)
    with pytest.raises(InputError, match="joints come as a table"):
        imported(tmp_path / "scan.npz", mapping=mapping(tmp_path))
    with pytest.raises(InputError, match=r"arrays\.joints: joints come as a table"):
        imported(tmp_path / "scan.npz", mapping=mapping(tmp_path, arrays={"joints": "q"}))


def test_arrays_of_objects_are_not_unpickled(tmp_path: Path, imported: Imported) -> None:
    np.savez(tmp_path / "a.npz", z=np.array([{"a": 1}], dtype=object), allow_pickle=True)
    with pytest.raises(InputError, match="expected whole arrays of numbers"):
        imported(tmp_path / "a.npz")


def test_a_linear_joint_is_counted_in_its_own_unit(tmp_path: Path, milled: Recording, imported: Imported) -> None:
    limit = '<axis xyz="0 0 1"/><limit lower="-1" upper="2" effort="1" velocity="1"/>'
    links = "".join(f'<link name="{name}"/>' for name in ("base", "cart", "flange"))
    rail = f'<joint name="rail" type="prismatic"><parent link="base"/><child link="cart"/>{limit}</joint>'
    turn = f'<joint name="turn" type="revolute"><parent link="cart"/><child link="flange"/>{limit}</joint>'
    (tmp_path / "r.urdf").write_text(f'<robot name="r">{links}{rail}{turn}</robot>')
    joints = np.stack([np.linspace(1200, 1300, len(milled.time_s)), np.full(len(milled.time_s), 30.0)], axis=1)
    np.savetxt(tmp_path / "q.csv", joints, delimiter=",", header="e1,j1", comments="")
    np.savez(tmp_path / "scan.npz", x=milled.x_mm, z=milled.z_mm, time=milled.time_s)
    part = {"columns": ["e1", "j1"], "angle_unit": "deg", "length_unit": "mm", "urdf": "r.urdf"}
    part |= {"base_frame": "base", "flange_frame": "flange"}
    sources = [tmp_path / "scan.npz", tmp_path / "q.csv"]
    parts = {"joints": part, "times": {"source": "pose_each"}, "accept": ["direction"]}
    got = imported(*sources, mapping=mapping(tmp_path, **parts))
    np.testing.assert_allclose(got.robot_position_mm[:, 2], joints[:, 0])
    parts["joints"] = {**part, "length_unit": "m"}
    with pytest.raises(InputError, match="line 2: joint 'rail': expected -1 to 2 m, found 1200"):
        imported(*sources, mapping=mapping(tmp_path, **parts))


@pytest.mark.parametrize("name", ["c.ply", "c.xyz"])
def test_a_cloud_is_sent_to_the_stages_of_clouds(name: str, tmp_path: Path, imported: Imported) -> None:
    rows = np.random.default_rng(8).normal(size=(200, 3))
    head = "ply\nformat ascii 1.0\nelement vertex 200\n" + "".join(f"property float {axis}\n" for axis in "xyz")
    text = "".join(f"{a:.4f} {b:.4f} {c:.4f}\n" for a, b, c in rows)
    (tmp_path / name).write_text((head + "end_header\n" if name == "c.ply" else "") + text)
    with pytest.raises(InputError, match=r"inspect_cloud\.json --input cloud=FILE"):
        imported(tmp_path / name)


def test_a_line_of_a_tracker_scanner_is_a_profile(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A count that goes on where nothing came back, then x and z: INVALID is no return, the count no coordinate."""
    x = np.arange(-20.0, 20.0, 0.2)
    z = 5.0 + 0.5 * np.abs(x) + np.random.default_rng(9).normal(0, 0.01, len(x))
    rows = [
        f"{21.3 + 0.01 * k:.5f}\t" + ("INVALID\tINVALID" if 60 <= k < 70 else f"{a:8.5f}\t{b:8.5f}")
        for k, (a, b) in enumerate(zip(x, z, strict=True))
    ]
    (tmp_path / "line.asc").write_text("\n".join(rows) + "\n")
    assert main(["look", str(tmp_path / "line.asc")]) == 0
    told = capsys.readouterr().out
    assert "table: x = 1, z = 2" in told
    assert "5.0 % missing" in told
    assert re.search(r"corner 1: x -?0\.0\d+ ", told)


def test_readings_of_a_tracker_are_told_by_position(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    reading = "Cnt=1  X={:.3f} Y=-40.000 Z= 12.500 RotX=    1.530\n"
    text = "".join(f"Pos {n}\n" + reading.format(100 * n - 0.03) + reading.format(100 * n + 0.03) for n in range(1, 6))
    (tmp_path / "t.txt").write_text(text)
    assert main(["look", str(tmp_path / "t.txt")]) == 0
    told = capsys.readouterr().out
    assert "positions: 5 with 10 readings" in told
    assert "standard deviation 0.02449 mm an axis, 0.03 off the mean" in told  # sqrt(10 * 0.03^2 / (3 * 5))
    assert main(["import", str(tmp_path / "t.txt"), "--out", str(tmp_path / "t.h5")]) == 2
    assert "calibrate.tracker" in capsys.readouterr().err
    (tmp_path / "t.txt").write_text(text + "Pos 6\nX=1 Y=2\n")
    assert main(["look", str(tmp_path / "t.txt")]) == 2
    assert "line 17: expected 'Pos n', or a reading" in capsys.readouterr().err


REAL = {  # of the foreign sets; cam.txt is a table of numbers
    "vendor/gocator_surface_v2.csv": "428 frames of 452 columns",
    "vendor/gopxl_profile.csv": "single profile",
    "vendor/scancontrol_2925.csv": "140 frames of 1143 columns",
    "real/lps_profile.csv": "single profile",
    "real/vgroove_lds_scan1.csv": "groove: V",
    "real/kistler_dynoware_f300.csv": "strongest at 199.98 Hz",
    "real/adaptio_ABW_head.csv": "rows: 836, 836 with the torch's place",
    "real/trispector_table.pcd": "coordinates taken as m: in mm it would be no part; inch would be possible too",
    "real/nist_SPH105_metres.xyz": "coordinates taken as m: in mm it would be no part",
    "real/akig_ur5_poses.txt": "poses: 27",
    "real/akig_ur5_joints.txt": "postures: 27, joints: 6",
    "real/akig_tscan_values.txt": "positions: 27 with 130 readings",
    "real/rabkkk_3smr_joints.csv": "36 with 108 readings of 3 targets",
    "real/gocator_gage_rr_minitab_ready.csv": "C13A_TP: 0.019 to 0.478, 64 different",
    "real/edge_calibration/calib_edge.ls": "26 positions of a FANUC program (tool 0, frame 0), fanuc_wpr",
    "real/edge_calibration/p2.yml": "1109 points of 'profile'",
    "real/sphere_profiles/18_5.csv": "table: x = 0, z = 1",
    "real/weld_line/egm.txt": "poses: 4, 5, 6, 1, 2, 3, 0; orientation euler_xyz_extrinsic",
    "real/weld_line/data.txt": "points: 189",
    "real/weld_line/data_line.txt": "points: 53",
    "sphere_r12.7.h5": "calibration recording",
}
LONG = ("real/vgroove_lds_scan1.csv", "real/weld_line/egm.txt")  # two seconds each


@pytest.mark.parametrize("name", [*(one for one in REAL if one not in LONG), *seldom(*LONG)])
def test_real_files_can_be_looked_at(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    if not (SHARED / name).is_file():
        pytest.skip(f"no {name}: data of others, for local tests only")
    assert main(["look", str(SHARED / name)]) == 0
    assert REAL[name] in capsys.readouterr().out
