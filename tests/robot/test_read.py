"""The cell file: what it makes, and what is refused."""

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import open3d
import pytest

from workbench.errors import InputError
from workbench.robot import Cell, CollisionModel, inverse_kinematics, read_cell

DATA = Path(__file__).parents[2] / "data" / "robot"


def test_coaxial_spindle_is_pointed_out(cell_file: Any) -> None:
    straight = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 200], [0, 0, 0, 1]]
    made = read_cell(cell_file(lambda tree: tree["tool"].update(flange_from_cutter=straight)))
    assert "coaxial" in made.warnings[0]
    offset = [[1, 0, 0, 80], *straight[1:]]
    assert read_cell(cell_file(lambda tree: tree["tool"].update(flange_from_cutter=offset))).warnings == ()


CUTTER = [[0, 0, 1, 260], [0, -1, 0, 0], [1, 0, 0, 140], [0, 0, 0, 1]]


def cutter(*place_mm: float) -> list[list[float]]:
    return [[*row[:3], at] for row, at in zip(CUTTER, (*place_mm, 1), strict=True)]


def at(*place_mm: float) -> dict[str, Any]:
    return {"position_mm": list(place_mm)}


def put(tree: Any, place: str, value: Any) -> None:
    """Put a value at a place like `fixtures.0.box_mm`; `+` behind a list's end, GONE takes it out."""
    *way, last = place.split(".")
    for key in way:
        tree = tree[int(key) if key.isdigit() else key]
    key = int(last) if last.lstrip("-").isdigit() else last
    if last == "+":
        tree.append(value)
    elif value is GONE:
        tree.pop(key)
    else:
        tree[key] = value


GONE = object()
SMALL = {"name": "clamp", "box_mm": [0.04, 0.04, 0.1]}
TILT = {"base_from_tilt": at(100, 0, 200), "shapes": [{"box_mm": [200, 200, 200]}]}
TURNED = {"position_mm": [230, 0, 150], "quaternion_wxyz": [0.8, 0.4, 0.4, 0.2]}
HOME = {"joints_deg": [0, -20, 20, 0, 30, 0]}
REFUSED: list[tuple[str, Any, str]] = [
    ("robot.flange_frame", "tool1", "unknown frame; did you mean 'tool0'?"),
    ("robot.urdf", "none.urdf", "none.urdf: no such file"),
    ("robot.urdf", "cell.json", "expected a URDF"),
    ("workpiece.mesh", "plate.stl", "plate.stl': no such file"),
    ("turntabel", {}, "did you mean 'turntable'?"),
    ("tool.flange_from_cutter.0.2", 2, "expected a rigid motion"),
    ("fixtures.0.sphere_mm", 3, "exactly one of box_mm"),
    ("fixtures.0.box_mm", [1, -1, 1], "$.fixtures"),
    ("fixtures.0.on", "tilt", "the cell has no tilt"),
    ("may_touch", [["link_1", "flor"]], "did you mean 'floor'?"),
    ("loading.force_noise_n", 0, "$.loading.force_noise_n"),
    # In another unit or sense, or left out.
    (
        "tool.flange_from_cutter",
        cutter(0.26, 0, 0.14),
        "at least 5 mm from the flange, found 0.26, 0, 0.14: is it in m",
    ),
    ("tool.flange_from_cutter", cutter(0, 0, 0), "found 0, 0, 0: was it left out?"),
    ("tool.flange_from_cutter", cutter(26, 0, 14), "14 mm within $.tool.shapes[0]"),
    ("tool.flange_from_cutter", cutter(210, 0, 140), "found one 20 mm beyond it: another cutter"),
    (
        "tool.flange_from_cutter",
        [[0, 0, -1, 260], [0, 1, 0, 0], [1, 0, 0, 140], [0, 0, 0, 1]],
        "is z flipped?",
    ),
    (
        "tool.flange_from_cutter",
        [[1, 0, 0, 260], [0, -1, 0, 0], [0, 0, -1, 140], [0, 0, 0, 1]],
        "found no body of the tool 20 mm back from the tip",
    ),
    ("tool.shapes", [{"sphere_mm": 60, "pose": TURNED}], "28 mm within $.tool.shapes[0]"),
    ("tool.shapes.0.cylinder_mm", [0.08, 0.09], "$.tool.shapes[0]: expected a body of mm"),
    ("tool.mass_kg", 0.032, "$.tool.mass_kg"),
    ("tool.mass_kg", 0, "$.tool.mass_kg: expected greater than 0"),
    ("tool.centre_of_gravity_mm", [0.03, 0, 0.11], "$.tool.centre_of_gravity_mm"),
    ("tool.centre_of_gravity_mm", [3000, 0, 110], "$.tool.centre_of_gravity_mm: expected a place"),
    ("robot.repeatability_mm", 5e-5, "$.robot.repeatability_mm"),
    ("robot.joint_stiffness_nm_per_rad", [1.8e9] * 6, "$.robot.joint_stiffness_nm_per_rad"),
    ("robot.acceleration_deg_s2", [1.57] * 6, "$.robot.acceleration_deg_s2"),
    ("turntable.acceleration_deg_s2", 1.05, "$.turntable.acceleration_deg_s2"),
    ("turntable.base_from_turntable", at(200, 0, 50), "the turntable beside the robot, found it in its base_link"),
    ("turntable.tilt", TILT, "$.turntable.tilt.base_from_tilt: expected the tilt beside the robot"),
    ("turntable.base_from_turntable", at(-2000, 0, -500), "expected a turntable that reaches into $.envelope"),
    ("turntable.base_from_turntable", at(2000, 0, -280), "expected a turntable that reaches into $.envelope"),
    ("turntable.base_from_turntable", at(2, 0, 0.5), "$.turntable.base_from_turntable"),
    ("turntable.limits_deg", [-3.14159, 3.14159], "$.turntable.limits_deg"),
    ("turntable.shapes.0.cylinder_mm", [0.5, 0.1], "$.turntable.shapes[0]"),
    ("fixtures.+", SMALL, "$.fixtures[1]: expected a body of mm"),
    *(
        ("fixtures.+", SMALL | {"name": name}, f"$.fixtures[1].name: expected another name than '{name}'")
        for name in ("workpiece", "tool", "cutter", "turntable", "tilt", "envelope", "link_3", "floor")
    ),
    ("fixtures.+", {"name": "c", "box_mm": [40, 40, 9], "pose": at(2, 0.1, 0.6)}, "$.fixtures[1].pose"),
    ("fixtures.+", {"name": "clamp", "mesh": "metres.stl"}, "$.fixtures[1].mesh: expected millimetres"),
    ("work_object.pose", at(2, 0, 0.5), "$.work_object.pose"),
    ("envelope", {"lowest_mm": [-2.5, -3, 0], "highest_mm": [3.5, 3, 4]}, "$.envelope"),
    ("margin_mm", 0.005, "$.margin_mm"),
    ("margin_mm", -5, "$.margin_mm"),
    ("margins", {"limit_deg": 0.035}, "margins.limit_deg: expected 0 or at least 0.1 deg"),
    ("margins", {"wrist_deg": 0.035}, "margins.wrist_deg: expected 0 or at least 0.1 deg"),
    ("uncertainty.tool_u_mm", 5e-5, "$.uncertainty.tool_u_mm"),
    ("process", {"home": {"joints_deg": [0.0, -0.35, 0.52, 0.0, 0.79, 0.0]}}, "home.joints_deg: expected degrees"),
    ("process", {"home": HOME, "feed": {"most_mm_s": 0.02}}, "$.process.feed.most_mm_s"),
    ("tool.mas_kg", 32, "$.tool.mas_kg: unknown key; did you mean 'mass_kg'?"),
    ("fixtures.0.onn", "base", "$.fixtures[0].onn: unknown key; did you mean 'on'?"),
    ("turntable.base_from_turntable", {"quaternion_xyzw": [0, 0, 0, 1]}, "did you mean 'quaternion_wxyz'?"),
    ("format", "bevel-recipe", "$.format: expected 'robot-cell', this is a file of another kind: 'bevel-recipe'"),
    ("fixture", [], "$.fixture: unknown key; did you mean 'fixtures'?"),
    (
        "process.spindle.on_signal",
        "do Spindle",
        "on_signal: expected a name of a letter (A to Z, a to z) and at most 31",
    ),
]


@pytest.mark.parametrize(("place", "value", "message"), REFUSED)
def test_bad_and_implausible_cells_are_refused_in_one_line(cell_file, place, value, message, capfd):
    path = cell_file(lambda tree: put(tree, place, value))
    box = open3d.geometry.TriangleMesh.create_box(0.1, 0.2, 0.05)
    open3d.io.write_triangle_mesh(path.with_name("metres.stl"), box.compute_triangle_normals())
    with pytest.raises(InputError) as caught:
        read_cell(path)
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize(
    ("place", "value", "words"),
    [
        ("tool.flange_from_cutter.0.3", 360, "shapes end 100 mm from its tip"),
        ("tool.shapes.-1", GONE, "collision of the cutter: the tool's shapes end"),
        ("may_touch", [["cutter", "workpiece"], ["tool", "workpiece"]], "lets them touch"),
        ("process", GONE, "the way to the first posture and back home, spindle and coolant"),
        ("turntable.base_from_turntable.quaternion_wxyz", [0, 1, 0, 0], "its z points down"),
        ("work_object.pose", at(-2000, 0, -500), "the inverse of $.work_object"),
        ("margin_mm", 0, "$.margin_mm is 0"),
    ],
)
def test_what_a_cell_leaves_open_is_named(cell_file: Any, place: str, value: Any, words: str) -> None:
    before = set(read_cell(cell_file()).unchecked)
    (open_,) = set(read_cell(cell_file(lambda tree: put(tree, place, value))).unchecked) - before
    assert words in open_


def test_a_turntable_may_be_let_into_the_robots_base(cell_file: Any) -> None:
    def change(tree: Any) -> None:
        tree["turntable"]["shapes"].append({"pose": {"position_mm": [-1700, 0, -300]}, "box_mm": [200, 200, 200]})
        tree["turntable"]["limits_deg"] = [-1, 1]

    with pytest.raises(InputError, match="may they touch"):
        read_cell(cell_file(change))
    assert read_cell(cell_file(lambda t: (change(t), t["may_touch"].append(["turntable", "base_link"]))))
    beside = {"pose": {"position_mm": [-1547, 0, -300]}, "box_mm": [200, 200, 200]}  # by 3 mm, less than the clearance
    assert read_cell(cell_file(lambda t: t["turntable"]["shapes"].append(beside)))


@pytest.mark.parametrize(
    ("name", "by", "message"),
    [("lower|upper", 1 / 57.2958, "57.3 twice"), ("velocity", 57.2958, "deg/s"), ("xyz", 1e3, "in mm?")],
)
def test_a_robot_in_other_units_is_refused(tmp_path: Path, name: str, by: float, message: str) -> None:
    def scaled(match: re.Match[str]) -> str:
        return f'{match[1]}="{" ".join(f"{float(value) * by:.9g}" for value in match[2].split())}"'

    tree = json.loads((DATA / "cell.json").read_text())
    text = (DATA / tree["robot"]["urdf"]).read_text()
    (tmp_path / tree["robot"]["urdf"]).write_text(re.sub(rf'({name})="([^"]+)"', scaled, text))
    (tmp_path / "cell.json").write_text(json.dumps(tree))
    with pytest.raises(InputError) as caught:
        read_cell(tmp_path / "cell.json")
    assert message in str(caught.value)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('type="revolute"', 'type="prismatic"', "expected a revolute joint"),
        ('name="joint_6" type="revolute"', 'name="joint_6" type="fixed"', "six revolute joints"),
        ('<axis xyz="0 1 0"/>', '<axis xyz="0 1 0"', "expected a URDF"),
        ('lower="-6.283185307179586"', 'lower="7"', "lower < upper"),
    ],
)
def test_other_robots(cell_file: Any, old: str, new: str, message: str, capfd: Any) -> None:
    path = cell_file()
    urdf = path.parent / "irb6700_150_320.urdf"
    urdf.write_text(urdf.read_text().replace(old, new))
    with pytest.raises(InputError, match=message):
        read_cell(path)
    assert capfd.readouterr().err == ""


def test_robot_without_spherical_wrist_is_read_but_has_no_inverse(cell_file: Any) -> None:
    path = cell_file()
    urdf = path.parent / "irb6700_150_320.urdf"
    urdf.write_text(urdf.read_text().replace('xyz="0.2 0 0"', 'xyz="0.2 0 0.05"'))
    made = read_cell(path)
    assert "no inverse kinematics" in made.warnings[0]
    assert "wrist is not spherical" in made.warnings[0]
    with pytest.raises(InputError, match="wrist is not spherical"):
        inverse_kinematics(made.chain, np.eye(4))


def test_workpiece_and_links_of_meshes(cell_file: Any) -> None:
    """A cube of triangles on the turntable, in mm; another as the collision shape of link 6, in m."""
    path = cell_file(lambda tree: tree.update(workpiece={"mesh": "cube.stl", "pose": {"position_mm": [0, 0, 100]}}))
    for name, size in (("cube.stl", 200.0), ("small.stl", 0.1)):
        mesh = open3d.geometry.TriangleMesh.create_box(size, size, size)
        mesh.compute_triangle_normals()
        assert open3d.io.write_triangle_mesh(path.parent / name, mesh)
    urdf = path.parent / "irb6700_150_320.urdf"
    urdf.write_text(urdf.read_text().replace('<cylinder radius="0.08" length="0.02"/>', '<mesh filename="small.stl"/>'))
    made = read_cell(path)
    shapes = {shape.body: shape for shape in made.shapes}
    assert shapes["workpiece"].kind == "mesh"
    for body, size in (("workpiece", 200.0), ("link_6", 100.0)):
        vertices = shapes[body].vertices_mm
        assert vertices is not None
        assert np.allclose(np.ptp(vertices, axis=0), size)
    assert CollisionModel(made).gaps(np.zeros(6))[0].distance_mm > 0


def cloud_cell(cell_file: Any, points: Any, name: str = "scan.ply", **keys: Any) -> Cell:
    """The shipped cell with a workpiece of points (n, 3) in mm."""
    path = cell_file(lambda tree: tree.update(workpiece={"mesh": name, **keys}))
    cloud = open3d.geometry.PointCloud(open3d.utility.Vector3dVector(points))
    assert open3d.io.write_point_cloud(path.parent / name, cloud)
    return read_cell(path)


@pytest.mark.parametrize("name", ["scan.ply", "scan.pcd", "scan.xyz"])
def test_scanned_cloud_is_a_workpiece(cell_file: Any, name: str) -> None:
    """The boxes of a plate's points fill the plate, overlap nowhere, and stand beyond it by less than a cube."""
    points = np.random.default_rng(1).uniform((-200, -100, 0), (200, 100, 25), (20_000, 3))
    boxes = [s for s in cloud_cell(cell_file, points, name, voxel_mm=20.0).shapes if s.body == "workpiece"]
    low = np.array([box.pose[:3, 3] - np.array(box.size_mm) / 2 for box in boxes])
    high = np.array([box.pose[:3, 3] + np.array(box.size_mm) / 2 for box in boxes])
    assert {box.kind for box in boxes} == {"box"}
    assert low.min(axis=0).tolist() == [-200, -100, 0]
    assert high.max(axis=0).tolist() == [200, 100, 40]
    assert np.prod(high - low, axis=1).sum() == pytest.approx(400 * 200 * 40)
    inside = ((points[:, None] >= low) & (points[:, None] <= high)).all(axis=2)
    assert inside.any(axis=1).all()


def test_a_large_scan_gets_a_coarser_grid(cell_file: Any) -> None:
    """Scattered points make many boxes: cubes grow until they are few enough, and still hold every point."""
    points = np.random.default_rng(5).uniform(0, 900, (3000, 3))
    boxes = [s for s in cloud_cell(cell_file, points, voxel_mm=5.0).shapes if s.body == "workpiece"]
    low = np.array([box.pose[:3, 3] - np.array(box.size_mm) / 2 for box in boxes])
    high = np.array([box.pose[:3, 3] + np.array(box.size_mm) / 2 for box in boxes])
    assert len(boxes) <= 250
    assert ((points[:, None] >= low) & (points[:, None] <= high)).all(axis=2).any(axis=1).all()


def test_links_without_bodies_are_named(cell_file: Any, tmp_path: Path) -> None:
    text = (DATA / "irb6700_150_320.urdf").read_text()
    start = text.index('<link name="link_3"')
    end = text.index("</link>", start)
    link = re.sub(r"<collision.*</collision>", "", text[start:end], flags=re.S)
    (tmp_path / "bare.urdf").write_text(text[:start] + link + text[end:])
    bare = read_cell(cell_file(lambda tree: tree["robot"].update(urdf=str(tmp_path / "bare.urdf"))))
    assert any(said.startswith("collision of the robot's links 3: ") for said in bare.unchecked)


def test_the_walls_of_the_envelope_leave_no_gap(cell_file: Any) -> None:
    made = read_cell(cell_file())
    walls = [shape for shape in made.shapes if shape.body == "envelope"]
    low = np.array([min(w.pose[a, 3] - w.size_mm[a] / 2 for w in walls) for a in range(3)])
    high = np.array([max(w.pose[a, 3] + w.size_mm[a] / 2 for w in walls) for a in range(3)])
    points = np.random.default_rng(0).uniform(low, high, (20_000, 3))
    inside = [np.all(np.abs(points - w.pose[:3, 3]) < np.array(w.size_mm) / 2, axis=1) for w in walls]
    given = json.loads((DATA / "cell.json").read_text())["envelope"]
    free = np.all((points > given["lowest_mm"]) & (points < given["highest_mm"]), axis=1)
    assert np.array_equal(np.any(inside, axis=0), ~free)
