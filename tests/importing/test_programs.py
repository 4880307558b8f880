"""Taught positions of robot programs as poses; profiles in OpenCV's file storage; tables told by their numbers."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from workbench.api import pose_from, quaternion_from_rotation, rotation_from_quaternion, rotation_from_vector
from workbench.errors import InputError
from workbench.importing.draft import drafted
from workbench.importing.kinds import read_source
from workbench.importing.mapping import Mapping, no_mapping, read_mapping
from workbench.units import DEG, Float

RNG = np.random.default_rng(11)
POSES = pose_from(rotation_from_vector(RNG.uniform(-1.0, 1.0, (5, 3))), RNG.uniform(-900.0, 900.0, (5, 3)))
TOOL = pose_from(rotation_from_vector(np.array([[0.1, -0.4, 0.7]]))[0], np.array([10.0, -20.0, 180.0]))


def about_fixed_axes(pose: Float) -> Float:
    """Angles in deg about fixed x, y, z: W, P, R of FANUC and Rx, Ry, Rz of Yaskawa; C, B, A of KUKA."""
    r = pose[:3, :3]
    return np.array([np.arctan2(r[2, 1], r[2, 2]), -np.arcsin(r[2, 0]), np.arctan2(r[1, 0], r[0, 0])]) / DEG


def fanuc(poses: Float, tool: str = "0") -> str:
    blocks = []
    for k, pose in enumerate(poses, 1):
        (x, y, z), (w, p, r) = pose[:3, 3], about_fixed_axes(pose)
        blocks.append(
            f"P[{k}]{{\n   GP1:\n\tUF : 0, UT : {tool},\t\tCONFIG : 'N U T, 0, 0, -1',\n"
            f"\tX = {x:.9f}  mm,\tY = {y:.9f}  mm,\tZ = {z:.9f}  mm,\n"
            f"\tW = {w:.9f} deg,\tP = {p:.9f} deg,\tR = {r:.9f} deg\n}};\n"
        )
    return f"/PROG  A\n/MN\n   1:L P[1] 500mm/sec FINE    ;\n/POS\n{''.join(blocks)}/END\n"


def abb(poses: Float, tool: str = "0") -> str:
    lines = []
    for pose in poses:
        place, turn = (",".join(f"{v:.12g}" for v in row) for row in (pose[:3, 3], quaternion_of(pose)))
        name = "tool0" if tool == "0" else tool
        lines.append(f"  MoveL [[{place}],[{turn}],[0,0,-1,0],[9E9,9E9,9E9,9E9,9E9,9E9]],v100,fine,{name};")
    return "MODULE M\n PROC main()\n" + "\n".join(lines) + "\n ENDPROC\nENDMODULE\n"


def kuka(poses: Float, tool: str = "0") -> str:
    lines = []
    for pose in poses:
        (x, y, z), (c, b, a) = pose[:3, 3], about_fixed_axes(pose)
        lines.append(f"LIN {{X {x:.9f},Y {y:.9f},Z {z:.9f},A {a:.9f},B {b:.9f},C {c:.9f},S 2,T 35}}")
    told = "$TOOL=$NULLFRAME" if tool == "0" else f"$TOOL=TOOL_DATA[{tool}]"
    return f"DEF A()\n{told} ; the tool\n$BASE=$NULLFRAME\n" + "\n".join(lines) + "\nEND\n"


def yaskawa(poses: Float, tool: str = "0") -> str:
    rows = [
        f"C{k:05d}=" + ",".join(f"{v:.9f}" for v in (*pose[:3, 3], *about_fixed_axes(pose)))
        for k, pose in enumerate(poses)
    ]
    head = f"/JOB\n//NAME A\n//POS\n///NPOS {len(rows)},0,0,0,0,0\n///TOOL {tool}\n///POSTYPE BASE\n///RECTAN\n"
    return head + "\n".join(rows) + "\n//INST\nNOP\nEND\n"


def ur(poses: Float, tool: str = "0") -> str:
    tcp = "p[0,0,0,0,0,0]" if tool == "0" else "p[0,0,0.1,0,0,0]"
    rows = []
    for pose in poses:
        w, *v = quaternion_of(pose)
        angle = 2.0 * np.arctan2(np.linalg.norm(v), w)
        turn = np.array(v) / np.linalg.norm(v) * angle
        rows.append(
            "  movel(p[" + ", ".join(f"{one:.12f}" for one in (*pose[:3, 3] / 1000.0, *turn)) + "], a=1.2, v=0.1)"
        )
    return f"def a():\n  set_tcp({tcp})\n" + "\n".join(rows) + "\nend\n"


def quaternion_of(pose: Float) -> Float:
    return quaternion_from_rotation(pose[None, :3, :3])[0]


WRITERS = {"a.ls": fanuc, "a.mod": abb, "a.src": kuka, "a.jbi": yaskawa, "a.script": ur}


def poses_of(path: Path, mapping: Mapping | None = None) -> Float:
    stream = read_source(path, mapping or no_mapping()).poses
    assert stream is not None
    return pose_from(rotation_from_quaternion(stream.quaternion_wxyz), stream.position_mm)


@pytest.mark.parametrize("name", WRITERS)
def test_positions_are_the_flanges_poses(tmp_path: Path, name: str) -> None:
    path = tmp_path / name
    path.write_text(WRITERS[name](POSES))
    np.testing.assert_allclose(poses_of(path), POSES, atol=1e-6)


@pytest.mark.parametrize("name", WRITERS)
def test_positions_of_a_tool_need_the_mapping(tmp_path: Path, name: str) -> None:
    path, file = tmp_path / name, tmp_path / "map.json"
    path.write_text(WRITERS[name](POSES @ TOOL, "3"))
    with pytest.raises(InputError, match=r"tool \S+ in frame \S+ .*'program' with flange_from_tool"):
        read_source(path, no_mapping())
    tree, _ = drafted([path])
    assert any("flange_from_tool" in doubt for doubt in tree["uncertain"])
    tree["program"]["flange_from_tool"] = TOOL.tolist()
    file.write_text(json.dumps(tree))
    np.testing.assert_allclose(poses_of(path, read_mapping(file)), POSES, atol=1e-6)


@pytest.mark.parametrize(
    ("name", "told", "instead"),
    [
        ("a.src", "$TOOL=$NULLFRAME", "$TOOL={X 0, Y 0, Z 90, A 0, B 0, C 0}\nFDAT F={TOOL_NO 0,BASE_NO 0}"),
        ("a.src", "$TOOL=$NULLFRAME", "$TOOL = MY_TOOL\nFDAT F={TOOL_NO 0,BASE_NO 0}"),
        ("a.jbi", "///TOOL 0\n", "///POSTYPE PULSE\n///PULSE\nC9=1,2,3,4,5,6\n///TOOL 2\n"),
        ("a.jbi", "///TOOL 0\n", "///POSTYPE PULSE\n///TOOL 2\n///PULSE\nC9=1,2,3,4,5,6\n"),
        ("a.script", "set_tcp(", "set_tcp( p[0,0,9e-2,0,0,0])\n  set_tcp("),
    ],
)
def test_a_tool_told_by_the_way_is_not_missed(tmp_path: Path, name: str, told: str, instead: str) -> None:
    text = WRITERS[name](POSES)
    assert told in text
    (tmp_path / name).write_text(text.replace(told, instead))
    with pytest.raises(InputError, match="flange_from_tool"):
        poses_of(tmp_path / name)


@pytest.mark.parametrize("name", WRITERS)
def test_a_program_without_positions_is_told(tmp_path: Path, name: str) -> None:
    path = tmp_path / name
    path.write_text(WRITERS[name](POSES[:0]).replace("movel", "movel(p[])"))
    with pytest.raises(InputError, match="expected taught positions"):
        read_source(path, no_mapping())


def test_opencv_profiles(tmp_path: Path) -> None:
    (tmp_path / "a.yml").write_text(
        "%YAML:1.0\n---\nprofile: [ 1., 0., -2.5,\n  2., 0., .Nan, 3., 0., -4. ]\nfeature: [ 1., 0., 2. ]\n"
    )
    found = read_source(tmp_path / "a.yml", no_mapping())
    assert found.profiles is not None
    np.testing.assert_allclose(found.profiles.x_mm, [[1, 2, 3]])
    np.testing.assert_allclose(found.profiles.z_mm, [[-2.5, np.nan, -4]])
    assert "left out: feature" in found.notes[0]
    (tmp_path / "a.yml").write_text(
        "%YAML:1.0\nc: !!opencv-matrix\n   rows: 2\n   cols: 2\n   dt: d\n   data: [ 1., 2.,\n 3., 4.]\n"
    )
    found = read_source(tmp_path / "a.yml", no_mapping())
    assert found.profiles is not None
    np.testing.assert_allclose(found.profiles.z_mm, [[2, 4]])
    (tmp_path / "a.yml").write_text("%YAML:1.0\nc: [ 1., 2., 3., 4., 5., 6. ]\n")
    with pytest.raises(InputError, match="y that changes"):
        read_source(tmp_path / "a.yml", no_mapping())


def test_a_column_of_labels_is_no_coordinate(tmp_path: Path) -> None:
    """Profiles of a calibration sphere, x, z, on the sphere or not: taken as a cloud that lay flat."""
    x = np.linspace(70.0, -70.0, 300)
    rows = np.stack([x, 150.0 + 0.001 * x**2, np.abs(x) < 20.0], axis=1)
    path = tmp_path / "18_5.csv"
    np.savetxt(path, rows, delimiter=",", fmt="%.3f")
    tree, _ = drafted([path])
    assert tree["profiles"]["columns"] == {"x": 0, "z": 1}
