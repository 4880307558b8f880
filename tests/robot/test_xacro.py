"""Robots out of xacro: packages, macros, arguments and properties as ROS has them; what a file may not make it do."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import open3d
import pytest

from workbench.errors import InputError
from workbench.robot import read_cell

PUMA = Path(__file__).parent / "urdf" / "puma.urdf"
ROBOT = '<robot name="r" xmlns:xacro="http://www.ros.org/wiki/xacro">{}<link name="a"/></robot>'
MACRO = """<robot xmlns:xacro="http://wiki.ros.org/xacro">
  <xacro:macro name="turn" params="prefix number xyz axis:=^|'0 1 0' **at">
    <link name="${prefix}link_${number}"><xacro:insert_block name="at"/></link>
    <joint name="${prefix}joint_${number}" type="revolute">
      <origin xyz="${xyz}"/>
      <parent link="${prefix}${'base_link' if number == 1 else 'link_%d' % (number - 1)}"/>
      <child link="${prefix}link_${number}"/>
      <axis xyz="${axis}"/>
      <xacro:property name="most" value="${limits['joint_%d' % number].upper}"/>
      <limit lower="${-most}" upper="${most}" effort="100" velocity="${radians(speed_deg)}"/>
    </joint>
  </xacro:macro>
  <xacro:macro name="arm" params="prefix">
    <xacro:property name="limits" value="${xacro.load_yaml('$(find arm_support)/config/limits.yaml')}"/>
    <xacro:property name="speed_deg" value="${540 / pi}"/>
    <link name="${prefix}base_link"/>
    <xacro:turn prefix="${prefix}" number="1" xyz="0 0 0.67" axis="0 0 1"><at/></xacro:turn>
    <xacro:turn prefix="${prefix}" number="2" xyz="0 0.2435 0"><at/></xacro:turn>
    <xacro:turn prefix="${prefix}" number="3" xyz="${432 / 1000 - 0.0002} -0.0934 0"><at>
      <collision><geometry><mesh filename="package://arm_support/meshes/link.stl"/></geometry></collision></at>
    </xacro:turn>
    <xacro:turn prefix="${prefix}" number="4" xyz="-0.0203 0 0.4331" axis="0 0 1"><at/></xacro:turn>
    <xacro:turn prefix="${prefix}" number="5" xyz="0 0 0"><at/></xacro:turn>
    <xacro:turn prefix="${prefix}" number="6" xyz="0 0 0" axis="0 0 1"><at/></xacro:turn>
    <link name="${prefix}tool0"/>
    <joint name="${prefix}flange" type="fixed"><origin xyz="0 0 0.0558" rpy="0 ${pi / 2} 0"/>
      <parent link="${prefix}link_6"/><child link="${prefix}tool0"/></joint>
  </xacro:macro>
</robot>"""
CELL = """<robot name="cell" xmlns:xacro="http://wiki.ros.org/xacro">
  <xacro:arg name="prefix" default=""/>
  <xacro:arg name="stand" default="true"/>
  <xacro:include filename="$(find arm_support)/urdf/arm_macro.xacro"/>
  <xacro:arm prefix="$(arg prefix)"/>
  <xacro:if value="$(arg stand)">
    <link name="stand"/>
    <joint name="on" type="fixed"><parent link="stand"/><child link="$(arg prefix)base_link"/></joint>
  </xacro:if>
</robot>"""


def package(folder: Path, name: str, files: dict[str, str]) -> Path:
    for file, text in {"package.xml": f"<package><name>{name}</name></package>", **files}.items():
        (folder / file).parent.mkdir(parents=True, exist_ok=True)
        (folder / file).write_text(text)
    return folder


@pytest.fixture
def workspace(tmp_path: Path) -> Path:
    """Two repositories: a maker's, with the arm, whose folder has another name, and the user's own."""
    limits = "\n".join(
        f"joint_{k}: {{upper: {mean}}}" for k, mean in enumerate((2.79, 3.92, 2.35, 3.14, 1.75, 4.64), 1)
    )
    files = {"urdf/arm_macro.xacro": MACRO, "config/limits.yaml": limits, "urdf/arm.xacro": CELL}
    arm = package(tmp_path / "maker/an_arm", "arm_support", files)
    mesh = open3d.geometry.TriangleMesh.create_box(0.1, 0.2, 0.3)
    mesh.compute_triangle_normals()
    (arm / "meshes").mkdir()
    assert open3d.io.write_triangle_mesh(arm / "meshes/link.stl", mesh)
    package(tmp_path / "own/my_cell", "my_cell", {"urdf/cell.urdf.xacro": CELL})
    (tmp_path / "own/broken").mkdir()
    (tmp_path / "own/broken/package.xml").write_text("<package")
    return tmp_path


def cell_file(folder: Path, **robot: object) -> Path:
    tool = {"flange_from_cutter": {"position_mm": [100, 0, 100]}}
    (folder / "cell.json").write_text(json.dumps({"format": "robot-cell", "version": 1, "tool": tool, "robot": robot}))
    return folder / "cell.json"


def test_a_robot_of_macros_is_the_robot_written_out(workspace: Path) -> None:
    """Include, macro, block, property, argument, condition, table of limits, `$(find)`; against the plain URDF."""
    file = cell_file(workspace / "own/my_cell", urdf="urdf/cell.urdf.xacro")
    cell = read_cell(file)
    plain = read_cell(cell_file(workspace, urdf=str(PUMA))).chain
    for one in ("axes", "points_mm", "base_from_flange_at_zero", "limits", "speeds"):
        assert getattr(cell.chain, one) == pytest.approx(getattr(plain, one), abs=1e-9), one
    assert [(shape.body, shape.kind) for shape in cell.shapes] == [("link_3", "mesh")]
    assert np.ptp(cell.shapes[0].vertices_mm, axis=0) == pytest.approx([100, 200, 300])


def test_arguments_of_the_cell_are_the_xacros(workspace: Path) -> None:
    folder = workspace / "own/my_cell"
    named = {"base_frame": "left_base_link", "flange_frame": "left_tool0"}
    cell = read_cell(cell_file(folder, urdf="urdf/cell.urdf.xacro", arguments={"prefix": "left_"}, **named))
    assert cell.chain.joint_names[0] == "left_joint_1"
    with pytest.raises(InputError, match=r"cell.urdf.xacro: .*no argument 'prefx'; did you mean 'prefix'\?"):
        read_cell(cell_file(folder, urdf="urdf/cell.urdf.xacro", arguments={"prefx": "left_"}))
    (folder / "plain.urdf").write_text(PUMA.read_text())
    with pytest.raises(InputError, match=r"expected xacro, which takes arguments \(\$.robot.arguments\)"):
        read_cell(cell_file(folder, urdf="plain.urdf", arguments={"prefix": "left_"}))


def test_a_package_elsewhere_is_named_by_the_cell(workspace: Path, tmp_path_factory: pytest.TempPathFactory) -> None:
    alone = tmp_path_factory.mktemp("alone")
    (alone / "cell.xacro").write_text(CELL)
    with pytest.raises(InputError, match=r"the package 'arm_support' is nowhere around .*\$.robot.packages"):
        read_cell(cell_file(alone, urdf="cell.xacro"))
    stated = {"arm_support": str(workspace / "maker/an_arm")}
    assert read_cell(cell_file(alone, urdf="cell.xacro", packages=stated)).chain.joint_names[5] == "joint_6"


def test_a_file_of_macros_alone_names_the_one_that_calls_them(workspace: Path) -> None:
    with pytest.raises(InputError, match=r"macros that nothing calls: .* \(arm.xacro\)"):
        read_cell(cell_file(workspace, urdf="maker/an_arm/urdf/arm_macro.xacro"))


@pytest.mark.parametrize(
    ("body", "message"),
    [
        ("<b c='${(lambda: ().__class__)()}'/>", "an expression may not hold __"),
        ("<b c='${(x for x in [1]).gi_frame}'/>", "an expression may not hold gi_"),
        ("<b c='${().\uff3f\uff3fclass\uff3f\uff3f}'/>", "an expression may not hold __"),
        ("<b c='${python.vars(xacro.load_yaml)}'/>", "name 'vars' is not defined"),
        ("<b c='${python.type(1)}'/>", "name 'type' is not defined"),
        ("<b c=\"${xacro.load_yaml('/etc/hostname')}\"/>", "it may read no file outside its packages: /etc/hostname"),
        ("<xacro:include filename='../../../../etc/passwd'/>", "it may read no file outside its packages"),
        ("<b c='$(env HOME)'/>", "environment variable 'HOME' is not set"),
        ("<b c='${[0] * 10**10}'/>", "MemoryError"),
        ("<xacro:macro name='m'><xacro:m/></xacro:macro><xacro:m/>", "recursion"),
        ("<b c='${1 +}'/>", "when evaluating expression '1 \\+'"),
        ("<xacro:include filename='none.xacro'/>", "No such file or directory: .*none.xacro"),
        ("<xacro:arm/>", "unknown macro name: xacro:arm"),
    ],
)
def test_what_a_file_may_not_do_is_refused(tmp_path: Path, body: str, message: str) -> None:
    (tmp_path / "robot.xacro").write_text(ROBOT.format(body))
    with pytest.raises(InputError, match=rf"robot.xacro: expected xacro that a URDF is made of: .*{message}"):
        read_cell(cell_file(tmp_path, urdf="robot.xacro"))
