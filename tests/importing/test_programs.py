"""Taught positions of robot programs as poses; profiles in OpenCV's file storage; tables told by their numbers."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from workbench.api import pose_from, rotation_from_quaternion, rotation_from_vector
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


def poses_of(path: Path, mapping: Mapping | None = None) -> Float:
    stream = read_source(path, mapping or no_mapping()).poses
    assert stream is not None
    return pose_from(rotation_from_quaternion(stream.quaternion_wxyz), stream.position_mm)


def test_positions_are_the_flanges_poses(tmp_path: Path) -> None:
    path = tmp_path / "a.ls"
    path.write_text(fanuc(POSES))
    np.testing.assert_allclose(poses_of(path), POSES, atol=1e-6)


def test_positions_of_a_tool_need_the_mapping(tmp_path: Path) -> None:
    path, file = tmp_path / "a.ls", tmp_path / "map.json"
    path.write_text(fanuc(POSES @ TOOL, "3"))
    with pytest.raises(InputError, match=r"tool \S+ in frame \S+ .*'program' with flange_from_tool"):
        read_source(path, no_mapping())
    tree, _ = drafted([path])
    assert any("flange_from_tool" in doubt for doubt in tree["uncertain"])
    assert not any("base_from_frame" in doubt for doubt in tree["uncertain"])
    tree["program"]["flange_from_tool"] = TOOL.tolist()
    file.write_text(json.dumps(tree))
    np.testing.assert_allclose(poses_of(path, read_mapping(file)), POSES, atol=1e-6)


@pytest.mark.parametrize("lacks", ["UT : 0,", "UF : 0,"])
def test_a_tool_or_a_frame_that_is_not_stated_needs_the_mapping(tmp_path: Path, lacks: str) -> None:
    path = tmp_path / "a.ls"
    path.write_text(fanuc(POSES).replace(lacks, ""))
    with pytest.raises(InputError, match=r"not stated.*flange_from_tool"):
        poses_of(path)


def test_a_program_without_positions_is_told(tmp_path: Path) -> None:
    path = tmp_path / "a.ls"
    path.write_text(fanuc(POSES[:0]))
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
