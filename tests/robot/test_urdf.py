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
from workbench.robot import forward_kinematics, read_cell, turntable_pose

URDFS, DATA = Path(__file__).parent / "urdf", Path(__file__).parents[2] / "data/robot"
ROBOTS = {"kr210": "base_link", "m20ia": "base", "gp25": "base", "ur10e": "base", "puma": "base_link"}
ROBOTS |= dict.fromkeys(("oblique", "irb6700_150_320"), "base_link")


def urdf_of(name: str) -> str:
    return next(one for folder in (URDFS, DATA) if (one := folder / f"{name}.urdf").is_file()).read_text()


def cell_with(folder: Path, urdf: str, text: str | None = None, track: Any = None, **robot: Any) -> Path:
    (folder / "robot.urdf").write_text(text or urdf_of(urdf))
    tree = {
        "format": "robot-cell",
        "version": 1,
        "tool": {"flange_from_cutter": {"position_mm": [100, 0, 100]}},
        "robot": {"urdf": "robot.urdf", **robot},
        "track": track,
    }
    (folder / "cell.json").write_text(json.dumps(tree))
    return folder / "cell.json"


@pytest.mark.parametrize("name", ROBOTS)
def test_robots_of_other_makers_are_pins(tmp_path: Path, name: str) -> None:
    """Forward kinematics equal to pin's own of the same file."""
    chain = read_cell(cell_with(tmp_path, name, base_frame=ROBOTS[name])).chain
    model = pin.buildModelFromUrdf(str(tmp_path / "robot.urdf"))
    data = model.createData()
    q = np.random.default_rng(7).uniform(chain.limits[:, 0], chain.limits[:, 1], (50, 6))
    for row, ours in zip(q, forward_kinematics(chain, q), strict=True):
        pin.framesForwardKinematics(model, data, row)
        base, flange = (data.oMf[model.getFrameId(frame)] for frame in (ROBOTS[name], "tool0"))
        theirs = (base.inverse() * flange).homogeneous
        assert np.abs(ours[:3, :3] - theirs[:3, :3]).max() < 1e-12
        assert np.abs(ours[:3, 3] / 1000 - theirs[:3, 3]).max() < 1e-12


def test_a_track_stands_where_the_cell_says(tmp_path: Path) -> None:
    cell = read_cell(cell_with(tmp_path, "track", held={"track": 2500}, base_frame="world"))
    alone = read_cell(cell_with(tmp_path, "kr210")).chain
    q = np.radians([20, -60, 80, 10, 30, 5])
    shifted = forward_kinematics(alone, q)
    shifted[:3, 3] += [0, 2500, 400]
    assert np.abs(forward_kinematics(cell.chain, q) - shifted).max() < 1e-9
    assert cell.shapes[0].pose[1, 3] == pytest.approx(2500)
    assert any("track at 2500" in said for said in cell.unchecked)


def test_a_track_moves_by_its_joint(tmp_path: Path) -> None:
    """The floor and the rail go the other way past the robot; what its joint tells, the cell file need not."""
    rail = '<collision><origin xyz="0 3 0.1"/><geometry><box size="0.5 8 0.2"/></geometry></collision>'
    text = urdf_of("track").replace('<link name="world"/>', f'<link name="world">{rail}</link>')
    assert rail in text
    cell = read_cell(cell_with(tmp_path, "track", text, track={"joint": "track", "speed_mm_s": 700}))
    alone = read_cell(cell_with(tmp_path, "kr210")).chain
    q = np.radians([20, -60, 80, 10, 30, 5])
    assert np.abs(forward_kinematics(cell.chain, q) - forward_kinematics(alone, q)).max() < 1e-9
    assert np.degrees(cell.turntable.limits) == pytest.approx([0, 6000])
    assert np.degrees(cell.turntable.speed) == pytest.approx(700)
    (body,) = (shape for shape in cell.shapes if shape.body == "world")
    for place in (0.0, 2500.0):
        assert (turntable_pose(cell, np.radians(place)) @ body.pose)[:3, 3] == pytest.approx([0, 3000 - place, -300])
    assert not any("nothing moves them" in said for said in cell.unchecked)


@pytest.mark.parametrize(
    ("track", "robot", "message"),
    [
        ({"joint": "trck"}, {}, r"unknown joint.*track"),
        ({"joint": "joint_2"}, {}, "expected a prismatic joint"),
        ({"joint": "track"}, {"base_frame": "world"}, "base_frame to be carried by the track, found 'world'"),
        ({"joint": "track"}, {"held": {"track": 0}}, "expected a joint that moves"),
        (
            {"direction": [1, 0, 0]},
            {"held": {"track": 0}},
            "expected direction, limits_mm and speed_mm_s, or the joint",
        ),
    ],
)
def test_a_track_that_no_joint_tells_is_refused(tmp_path: Path, track: Any, robot: Any, message: str) -> None:
    with pytest.raises(InputError, match=message):
        read_cell(cell_with(tmp_path, "track", track=track, **robot))


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
    beside = urdf_of("parallelogram").replace('<child link="elbow"/>', '<child link="rod"/>')
    beside = beside.replace('<link name="elbow"/>', '<link name="rod"/>').replace(
        '<parent link="elbow"/><child link="link_3"/><origin xyz="0 0 0"',
        '<parent link="link_2"/><child link="link_3"/><origin xyz="1.15 0 0"',
    )
    with pytest.raises(InputError, match=r"bar: a mimic joint .* or this one in \$.robot.held"):
        read_cell(cell_with(tmp_path, "parallelogram", beside))
    cell = read_cell(cell_with(tmp_path, "parallelogram", beside, held={"bar": 0}))
    assert any("bar at 0" in said for said in cell.unchecked)


GRIPPER = """
  <link name="finger"/><link name="thumb"/><link name="tip"/>
  <joint name="grip" type="prismatic"><parent link="flange_link"/><child link="finger"/><axis xyz="1 0 0"/>
    <limit lower="0" upper="0.05" effort="1" velocity="1"/></joint>
  <joint name="grip_mimic" type="prismatic"><parent link="flange_link"/><child link="thumb"/><axis xyz="1 0 0"/>
    <limit lower="-0.05" upper="0.05" effort="1" velocity="1"/>
    <mimic joint="grip" multiplier="-1" offset="0.002"/></joint>
  <joint name="tip_mimic" type="revolute"><parent link="thumb"/><child link="tip"/><axis xyz="0 0 1"/>
    <limit lower="-3" upper="3" effort="1" velocity="1"/><mimic joint="grip_mimic" multiplier="10"/></joint>
"""


def test_joints_that_mimic_one_that_stands_stand(tmp_path: Path) -> None:
    """A gripper beside the flange: its free joint must be held, what mimics it follows, in metres and radians."""
    text = urdf_of("kr210")
    last = re.findall(r'<link name="([^"]+)"', text)[-1]
    text = text.replace("</robot>", GRIPPER.replace("flange_link", last) + "</robot>")
    for name in ("finger", "thumb", "tip"):
        box = '<collision><geometry><box size="0.01 0.02 0.03"/></geometry></collision>'
        text = text.replace(f'<link name="{name}"/>', f'<link name="{name}">{box}</link>')
    cell = read_cell(cell_with(tmp_path, "kr210", text, held={"grip": 30}))
    finger, thumb, tip = cell.shapes[-3:]
    assert finger.pose[:3, 3] - thumb.pose[:3, 3] == pytest.approx(finger.pose[:3, 0] * (30 + 28), abs=1e-9)
    turned = np.arccos((np.trace(thumb.pose[:3, :3].T @ tip.pose[:3, :3]) - 1) / 2)
    assert turned == pytest.approx(0.28)
    with pytest.raises(InputError, match=r"a mimic joint .* \(or what it mimics\)|grip: expected"):
        read_cell(cell_with(tmp_path, "kr210", text))


def test_pairs_that_an_srdf_disables_may_touch(tmp_path: Path) -> None:
    pairs = '<disable_collisions link1="{}" link2="{}" reason="{}"/>'
    links = [shape.body for shape in read_cell(cell_with(tmp_path, "kr210")).shapes]
    said = pairs.format(links[0], links[-1], "User") + pairs.format(links[1], links[-1], "Never")
    (tmp_path / "kr210.srdf").write_text(f'<robot name="kr210">{said}{pairs.format("a", "b", "User")}</robot>')
    cell = read_cell(cell_with(tmp_path, "kr210", srdf="kr210.srdf"))
    assert cell.may_touch == ((links[0], links[-1]), (links[1], links[-1]))
    assert cell.unseen == (f"collision of {links[0]} and {links[-1]}: the SRDF lets them touch (User)",)
    (tmp_path / "kr210.srdf").write_text('<robot name="kr210"/>')
    with pytest.raises(InputError, match="expected an SRDF"):
        read_cell(cell_with(tmp_path, "kr210", srdf="kr210.srdf"))


def test_packages_are_found_by_their_manifests(tmp_path: Path) -> None:
    """The URDF in one package, its meshes in that and in one beside it, whose folder has another name."""
    mesh = open3d.geometry.TriangleMesh.create_box(0.1, 0.2, 0.3)
    mesh.compute_triangle_normals()
    for folder, name in (("own", "own_support"), ("kuka", "kuka_support")):
        (tmp_path / folder / "meshes").mkdir(parents=True)
        (tmp_path / folder / "package.xml").write_text(f"<package><name>{name}</name></package>")
        assert open3d.io.write_triangle_mesh(tmp_path / folder / "meshes/link.stl", mesh)
    (tmp_path / "own/urdf").mkdir()
    for name, known in (("own_support", True), ("kuka_support", True), ("abb_support", False)):
        inside = f'<mesh filename="package://{name}/meshes/link.stl"/>'
        text = urdf_of("kr210").replace('<cylinder radius="0.06" length="0.1"/>', inside)
        file = cell_with(tmp_path / "own/urdf", "kr210", text)
        if known:
            assert [shape.kind for shape in read_cell(file).shapes][-1] == "mesh"
        else:
            with pytest.raises(InputError, match="the mesh is in the package 'abb_support'"):
                read_cell(file)


def test_a_continuous_joint_turns_twice_either_way(tmp_path: Path) -> None:
    text = urdf_of("kr210")
    begin = text.index('<joint name="joint_6"')
    without = re.sub(r'lower="\S+" upper="\S+" ', "", text[begin:].replace('type="revolute"', 'type="continuous"', 1))
    cell = read_cell(cell_with(tmp_path, "kr210", text[:begin] + without))
    assert cell.chain.limits[5] == pytest.approx([-4 * np.pi, 4 * np.pi])
    alone = read_cell(cell_with(tmp_path, "kr210")).chain
    q = np.radians([20, -60, 80, 10, 30, 500])
    assert np.abs(forward_kinematics(cell.chain, q) - forward_kinematics(alone, q)).max() < 1e-9
    with pytest.raises(InputError, match="joint_6: expected a limit with a velocity above 0"):
        read_cell(cell_with(tmp_path, "kr210", text[:begin] + re.sub(r"<limit [^>]*>", "", without, count=1)))


def test_a_continuous_joint_is_held_anywhere(tmp_path: Path) -> None:
    """A motor beside the flange, and what turns a hundred times as far behind its gear."""
    text = urdf_of("kr210")
    last = re.findall(r'<link name="([^"]+)"', text)[-1]
    box = '<collision><geometry><box size="0.01 0.02 0.03"/></geometry></collision>'
    for name, gear in (("motor", ""), ("spindle", '<mimic joint="motor_turns" multiplier="100"/>')):
        joint = f'<parent link="{last}"/><child link="{name}"/><axis xyz="0 0 1"/>{gear}'
        text = text.replace(
            "</robot>",
            f'<link name="{name}">{box}</link><joint name="{name}_turns" type="continuous">{joint}</joint></robot>',
        )
    placed = [read_cell(cell_with(tmp_path, "kr210", text, held={"motor_turns": at})).shapes for at in (0, 10, 3610)]
    for (*_, still, other), (*_, motor, spindle) in zip(placed[:1] * 2, placed[1:], strict=True):
        for one, turned, deg in ((still, motor, 10), (other, spindle, 80)):  # of 1000 deg and 361,000
            cosine = (np.trace(one.pose[:3, :3].T @ turned.pose[:3, :3]) - 1) / 2
            assert np.degrees(np.arccos(cosine)) == pytest.approx(deg)


def test_one_velocity_in_degrees_a_second_is_refused(tmp_path: Path) -> None:
    text = urdf_of("irb6700_150_320")
    one = re.sub(r'velocity="([.0-9]+)"', lambda m: f'velocity="{float(m[1]) * 57.3}"', text, count=1)
    with pytest.raises(InputError, match=r"expected a velocity in rad/s like those of the other joints"):
        read_cell(cell_with(tmp_path, "irb6700_150_320", one))


@pytest.mark.parametrize("joint", [1, 2, 3, 5])
def test_limits_of_one_joint_in_degrees_are_refused(tmp_path: Path, joint: int) -> None:
    text = urdf_of("irb6700_150_320")
    begin = text.index(f'<joint name="joint_{joint}"')
    wrong = re.sub(r'(lower|upper)="([-.0-9]+)"', lambda m: f'{m[1]}="{float(m[2]) * 57.3}"', text[begin:], count=2)
    with pytest.raises(InputError, match=f"joint_{joint}: expected limits in radians"):
        read_cell(cell_with(tmp_path, "irb6700_150_320", text[:begin] + wrong))
