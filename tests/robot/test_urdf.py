"""What URDFs of other makers have: packages, continuous and mimic joints, tracks, joints that stand."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import open3d
import pinocchio as pin
import pytest

from workbench.errors import InputError
from workbench.robot import forward_kinematics, read_cell
from workbench.robot.urdf import read_urdf

URDFS = Path(__file__).parent / "urdf"
ROBOTS = {"kr210": "base_link", "m20ia": "base", "gp25": "base", "ur10e": "base", "puma": "base_link"}


def cell_with(folder: Path, urdf: str, text: str | None = None, **robot: Any) -> Path:
    (folder / "robot.urdf").write_text(text or (URDFS / f"{urdf}.urdf").read_text())
    tree = {
        "format": "robot-cell",
        "version": 1,
        "tool": {"flange_from_cutter": {"position_mm": [100, 0, 100]}},
        "robot": {"urdf": "robot.urdf", **robot},
    }
    (folder / "cell.json").write_text(json.dumps(tree))
    return folder / "cell.json"


@pytest.mark.parametrize("name", ROBOTS)
def test_robots_of_other_makers_are_pins(name: str) -> None:
    """Forward kinematics equal to pin's own of the same file."""
    path = URDFS / f"{name}.urdf"
    chain, _ = read_urdf(path, ROBOTS[name], "tool0")
    model = pin.buildModelFromUrdf(str(path))
    data = model.createData()
    q = np.random.default_rng(7).uniform(chain.limits[:, 0], chain.limits[:, 1], (50, 6))
    for row, ours in zip(q, forward_kinematics(chain, q), strict=True):
        pin.framesForwardKinematics(model, data, row)
        base, flange = (data.oMf[model.getFrameId(frame)] for frame in (ROBOTS[name], "tool0"))
        theirs = (base.inverse() * flange).homogeneous
        assert np.abs(ours[:3, :3] - theirs[:3, :3]).max() < 1e-9
        assert np.abs(ours[:3, 3] / 1000 - theirs[:3, 3]).max() < 1e-9


def test_ur10e_stands_at_zero_where_the_maker_says() -> None:
    """The sums of the maker's own lengths: a2 + a3 to the side, d4 + d6, d1 - d5."""
    chain, _ = read_urdf(URDFS / "ur10e.urdf", "base", "tool0")
    at = forward_kinematics(chain, np.zeros(6))[:3, 3]
    assert at == pytest.approx([-1184.25, -290.7, 60.85], abs=1e-6)


def test_a_track_stands_where_the_cell_says(tmp_path: Path) -> None:
    cell = read_cell(cell_with(tmp_path, "track", held={"track": 2500}, base_frame="world"))
    alone, _ = read_urdf(URDFS / "kr210.urdf", "base_link", "tool0")
    q = np.radians([20, -60, 80, 10, 30, 5])
    shifted = forward_kinematics(alone, q)
    shifted[:3, 3] += [0, 2500, 400]
    assert np.abs(forward_kinematics(cell.chain, q) - shifted).max() < 1e-9
    assert cell.shapes[0].pose[1, 3] == pytest.approx(2500)
    assert any("track at 2500" in said for said in cell.unchecked)


@pytest.mark.parametrize(
    ("held", "message"),
    [
        ({}, 'track: expected a revolute joint, found a prismatic one: a linear track stands.*"held": {"track": 1200}'),
        ({"track": 7000}, "track: expected a place within its limits"),
        ({"trck": 1}, r"'trck': unknown joint.*track"),
        ({"track": 0, "flange": 0}, "flange: expected a joint that could move"),
        ({"track": 0, "joint_6": 0}, "expected six revolute joints in a row, found 5 joints: joint_1, .*joint_5"),
    ],
)
def test_what_is_held_wrongly_is_refused_by_its_name(tmp_path: Path, held: dict[str, float], message: str) -> None:
    with pytest.raises(InputError, match=message):
        read_cell(cell_with(tmp_path, "track", held=held))


def test_a_parallelogram_is_refused_by_its_joints_name(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"bar: a mimic joint \(a parallelogram or another linkage\)"):
        read_cell(cell_with(tmp_path, "parallelogram"))
    with pytest.raises(InputError, match="bar: a mimic joint"):  # held it would be another robot
        read_cell(cell_with(tmp_path, "parallelogram", held={"bar": 0}))
    beside = (URDFS / "parallelogram.urdf").read_text().replace('<child link="elbow"/>', '<child link="rod"/>')
    beside = beside.replace('<link name="elbow"/>', '<link name="rod"/>').replace(
        '<parent link="elbow"/><child link="link_3"/><origin xyz="0 0 0"',
        '<parent link="link_2"/><child link="link_3"/><origin xyz="1.15 0 0"',
    )
    with pytest.raises(InputError, match=r"bar: a mimic joint .* or this one in \$.robot.held"):
        read_cell(cell_with(tmp_path, "parallelogram", beside))
    cell = read_cell(cell_with(tmp_path, "parallelogram", beside, held={"bar": 0}))
    assert any("bar at 0" in said for said in cell.unchecked)


def test_a_continuous_joint_turns_twice_either_way(tmp_path: Path) -> None:
    text = (URDFS / "kr210.urdf").read_text()
    begin = text.index('<joint name="joint_6"')
    without = re.sub(r'lower="\S+" upper="\S+" ', "", text[begin:].replace('type="revolute"', 'type="continuous"', 1))
    cell = read_cell(cell_with(tmp_path, "kr210", text[:begin] + without))
    assert cell.chain.limits[5] == pytest.approx([-4 * np.pi, 4 * np.pi])
    alone, _ = read_urdf(URDFS / "kr210.urdf", "base_link", "tool0")
    q = np.radians([20, -60, 80, 10, 30, 500])
    assert np.abs(forward_kinematics(cell.chain, q) - forward_kinematics(alone, q)).max() < 1e-9
    with pytest.raises(InputError, match="joint_6: expected a limit with a velocity above 0"):
        read_cell(cell_with(tmp_path, "kr210", text[:begin] + re.sub(r"<limit [^>]*>", "", without, count=1)))


def test_meshes_of_packages(tmp_path: Path) -> None:
    (tmp_path / "vendor/kuka_support/meshes").mkdir(parents=True)
    mesh = open3d.geometry.TriangleMesh.create_box(0.1, 0.2, 0.3)
    mesh.compute_triangle_normals()
    assert open3d.io.write_triangle_mesh(tmp_path / "vendor/kuka_support/meshes/link.stl", mesh)
    inside = '<mesh filename="package://kuka_support/meshes/link.stl"/>'
    text = (URDFS / "kr210.urdf").read_text().replace('<cylinder radius="0.06" length="0.1"/>', inside)
    cell = read_cell(cell_with(tmp_path, "kr210", text, packages={"kuka_support": "vendor/kuka_support"}))
    assert [shape.kind for shape in cell.shapes][-1] == "mesh"
    with pytest.raises(
        InputError, match=r"link 'link_6': the mesh is in the package 'kuka_support'.*\$.robot.packages"
    ):
        read_cell(cell_with(tmp_path, "kr210", text))
    with pytest.raises(InputError, match="no such file"):
        read_cell(cell_with(tmp_path, "kr210", text, packages={"kuka_support": "vendor"}))


def test_limits_in_degrees_are_refused(tmp_path: Path) -> None:
    text = (Path(__file__).parents[2] / "data" / "robot" / "irb6700_150_320.urdf").read_text()
    wrong = re.sub(r'(lower|upper)="([-.0-9]+)"', lambda m: f'{m[1]}="{float(m[2]) * 57.3}"', text)
    (tmp_path / "robot.urdf").write_text(wrong)
    with pytest.raises(InputError, match="joint_1: expected limits in radians"):
        read_urdf(tmp_path / "robot.urdf", "base_link", "tool0")


def test_one_velocity_in_degrees_a_second_is_refused(tmp_path: Path) -> None:
    text = (Path(__file__).parents[2] / "data" / "robot" / "irb6700_150_320.urdf").read_text()
    one = re.sub(r'velocity="([.0-9]+)"', lambda m: f'velocity="{float(m[1]) * 57.3}"', text, count=1)
    (tmp_path / "robot.urdf").write_text(one)
    with pytest.raises(InputError, match=r"expected a velocity in rad/s like those of the other joints"):
        read_urdf(tmp_path / "robot.urdf", "base_link", "tool0")


@pytest.mark.parametrize("joint", [1, 2, 3, 5])
def test_limits_of_one_joint_in_degrees_are_refused(tmp_path: Path, joint: int) -> None:
    text = (Path(__file__).parents[2] / "data" / "robot" / "irb6700_150_320.urdf").read_text()
    begin = text.index(f'<joint name="joint_{joint}"')
    wrong = re.sub(r'(lower|upper)="([-.0-9]+)"', lambda m: f'{m[1]}="{float(m[2]) * 57.3}"', text[begin:], count=2)
    (tmp_path / "robot.urdf").write_text(text[:begin] + wrong)
    with pytest.raises(InputError, match=f"joint_{joint}: expected limits in radians"):
        read_urdf(tmp_path / "robot.urdf", "base_link", "tool0")
