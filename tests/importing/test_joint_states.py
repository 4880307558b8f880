"""Joints through a URDF, against the robot's closed-form kinematics and a robot made by hand."""

from pathlib import Path

import numpy as np
import pytest

from workbench.errors import InputError
from workbench.importing.joints import JointModel

ROBOT = Path(__file__).parents[2] / "data" / "robot"
URDF = ROBOT / "irb6700_150_320.urdf"

# A linear axis, a continuous table, an arm of one joint with a mesh that is not there, and a gripper beside it.
GANTRY = """<robot name="gantry">
  <link name="world"/><link name="carriage"/><link name="table"/><link name="finger"/>
  <link name="arm"><visual><geometry><mesh filename="package://nowhere/arm.dae"/></geometry></visual>
    <collision><geometry><mesh filename="package://nowhere/arm.stl"/></geometry></collision></link>
  <joint name="rail" type="prismatic"><parent link="world"/><child link="carriage"/>
    <axis xyz="1 0 0"/><limit lower="0" upper="5" velocity="1" effort="1"/></joint>
  <joint name="swing" type="continuous"><parent link="carriage"/><child link="arm"/>
    <origin xyz="0 0 2"/><axis xyz="0 0 1"/></joint>
  <joint name="grip" type="prismatic"><parent link="arm"/><child link="finger"/>
    <axis xyz="0 1 0"/><limit lower="0" upper="0.1" velocity="1" effort="1"/></joint>
  <joint name="turn" type="continuous"><parent link="world"/><child link="table"/><axis xyz="0 0 1"/></joint>
</robot>"""


def test_a_rail_and_a_continuous_joint_move_the_flange(tmp_path: Path) -> None:
    path = tmp_path / "gantry.urdf"
    path.write_text(GANTRY)
    model = JointModel.read(path, "world", "arm")
    assert model.names == ("rail", "swing")
    pose = model.base_from_flange(np.array([[1.5, np.pi / 2 + 2 * np.pi]]))[0]
    np.testing.assert_allclose(pose, [[0, -1, 0, 1500], [1, 0, 0, 0], [0, 0, 1, 2000], [0, 0, 0, 1]], atol=1e-9)
    on_table = JointModel.read(path, "table", "arm")
    assert set(on_table.names) == {"rail", "swing", "turn"}
    values = {"rail": 1.0, "swing": 0.0, "turn": np.pi / 2}
    pose = on_table.base_from_flange(np.array([[values[name] for name in on_table.names]]))[0]
    np.testing.assert_allclose(pose[:3, 3], [0, -1000, 2000], atol=1e-9)


@pytest.mark.parametrize(
    ("value", "said"), [(45.0, "-1.13446 to 1.48353 rad, found 45 .deg declared"), (np.nan, "found nan")]
)
def test_a_joint_beyond_its_limits_is_refused(value: float, said: str) -> None:
    model = JointModel.read(URDF, "base_link", "tool0")
    with pytest.raises(InputError, match=f"'joint_2': .*{said}"):
        model.check(np.array([[0, value, 0, 0, 0, 0]]), "rad", lambda _: "row 1")


@pytest.mark.parametrize(
    ("base", "flange", "said"),
    [
        ("base", "tool0", "unknown link"),
        ("base_link", "tool", "'tool'"),
        ("link_6", "tool0", "expected joints between"),
    ],
)
def test_frames_must_be_links_with_joints_between(base: str, flange: str, said: str) -> None:
    with pytest.raises(InputError, match=said):
        JointModel.read(URDF, base, flange)


def test_what_is_not_a_urdf_is_told(tmp_path: Path) -> None:
    for text in ("<robot", "<model/>", "<robot name='r'><joint name='j' type='revolute'/></robot>"):
        path = tmp_path / "r.urdf"
        path.write_text(text)
        with pytest.raises(InputError, match="URDF"):
            JointModel.read(path, "a", "b")
    with pytest.raises(InputError, match="no such file"):
        JointModel.read(tmp_path / "none.urdf", "a", "b")
