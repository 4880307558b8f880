"""STEP models: plates that gmsh models here, whose edges are known, read back; and what is refused in one line."""

from __future__ import annotations

import math
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from workbench import cad
from workbench.children import environment
from workbench.cli import main
from workbench.compare import mesh
from workbench.errors import InputError
from workbench.scan_plan import plan

pytest.importorskip("gmsh", reason="gmsh is not installed")
ROOT = Path(__file__).parents[1]
SENSOR = ROOT / "data" / "calibration" / "sensor.json"
THICKNESS_MM, ROOT_MM, BEVEL_DEG, RADIUS_MM = 10.0, 2.0, 35.0, 100.0
MODELS = f"""
import math, sys
import gmsh
gmsh.initialize(readConfigFiles=False, interruptible=False)
gmsh.option.setNumber("General.Terminal", 0)
occ = gmsh.model.occ
def section(x):
    set_back = {THICKNESS_MM - ROOT_MM} * math.tan(math.radians({BEVEL_DEG}))
    corners = [(0, 0), (0, {ROOT_MM}), (set_back, {THICKNESS_MM}), (40, {THICKNESS_MM}), (40, 0)]
    points = [occ.addPoint(x, y, z) for y, z in corners]
    lines = [occ.addLine(a, b) for a, b in zip(points, points[1:] + points[:1])]
    return 2, occ.addPlaneSurface([occ.addCurveLoop(lines)])
def write(name):
    occ.synchronize()
    gmsh.write(f"{{sys.argv[1]}}/{{name}}.step")
    gmsh.clear()
occ.extrude([section(0)], 120, 0, 0)
write("straight")
occ.revolve([section(0)], 0, {RADIUS_MM}, 0, 0, 0, 1, 1.0)
write("arc")
straight, arc = occ.extrude([section(0)], -50, 0, 0), occ.revolve([section(0)], 0, {RADIUS_MM}, 0, 0, 0, 1, 1.0)
occ.fuse([one for one in straight if one[0] == 3], [one for one in arc if one[0] == 3])
write("straight_and_arc")
plate = occ.addBox(0, 0, 0, 100, 60, 8)
occ.synchronize()
(top,) = [tag for _, tag in gmsh.model.getEntities(2) if occ.getCenterOfMass(2, tag)[2] > 7.9]
edges = [tag for _, tag in gmsh.model.getBoundary([(2, top)], oriented=False)]
occ.chamfer([plate], edges, [top] * 4, [4 * math.tan(math.radians(30)), 4] * 4)
write("four")
occ.addBox(0, 0, 0, 100, 60, 8)
write("box")
occ.addRectangle(0, 0, 0, 10, 10)
write("sheet")
"""


@pytest.fixture(scope="module")
def models(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("models")
    subprocess.run([sys.executable, "-c", MODELS, str(folder)], check=True, env=environment(), capture_output=True)
    straight = (folder / "straight.step").read_text()
    (folder / "metres.step").write_text(straight.replace("SI_UNIT(.MILLI.,.METRE.)", "SI_UNIT($,.METRE.)"))
    (folder / "torn.step").write_text(straight[: len(straight) // 2])
    return folder


def test_a_straight_edge_is_known_exactly(models: Path) -> None:
    (edge,) = cad.nominal_edges(models / "straight.step")
    assert edge.thickness_mm == pytest.approx((THICKNESS_MM, THICKNESS_MM), abs=1e-6)
    assert edge.root_mm == pytest.approx((ROOT_MM, ROOT_MM), abs=1e-6)
    assert edge.bevel_deg == pytest.approx((BEVEL_DEG, BEVEL_DEG), abs=1e-6)
    assert edge.length_mm == pytest.approx(120.0, abs=1e-6)
    assert np.cross(edge.points_mm[-1] - edge.points_mm[0], edge.upper_side[0])[1] < 0.0  # t x m = -n, n along -y


def test_an_arc_and_pieces_that_go_on_are_one_edge(models: Path) -> None:
    (arc,) = cad.nominal_edges(models / "arc.step")
    from_axis = np.linalg.norm(arc.points_mm[:, :2] - [0.0, RADIUS_MM], axis=1)
    assert from_axis == pytest.approx(np.full(len(from_axis), RADIUS_MM), abs=1e-6)
    (both,) = cad.nominal_edges(models / "straight_and_arc.step")
    assert both.length_mm == pytest.approx(50.0 + RADIUS_MM, abs=0.01)
    for edge in (arc, both):
        assert [*edge.thickness_mm, *edge.root_mm] == pytest.approx([THICKNESS_MM] * 2 + [ROOT_MM] * 2, abs=1e-3)
        assert edge.bevel_deg == pytest.approx((BEVEL_DEG, BEVEL_DEG), abs=1e-3)


def test_the_files_unit_counts(models: Path) -> None:
    (edge,) = cad.nominal_edges(models / "metres.step")
    assert edge.length_mm == pytest.approx(120_000.0)
    assert np.ptp(mesh(mesh=models / "metres.step", unit="inch").points_mm[:, 0]) == pytest.approx(120_000.0)


def test_triangles_face_outwards_and_enclose_the_solid(models: Path) -> None:
    surface = mesh(
        mesh=models / "straight.step", base_from_mesh=[[0, -1, 0, 5], [1, 0, 0, 6], [0, 0, 1, 7], [0, 0, 0, 1]]
    )
    a, b, c = (surface.points_mm[surface.triangles[:, k]] for k in range(3))
    cut = 0.5 * (THICKNESS_MM - ROOT_MM) ** 2 * math.tan(math.radians(BEVEL_DEG))
    volume = float(np.einsum("ki,ki->", a, np.cross(b, c))) / 6.0
    assert volume == pytest.approx(120.0 * (40.0 * THICKNESS_MM - cut), rel=1e-9)


def test_a_scan_is_planned_by_the_model(models: Path) -> None:
    pose = [[1.0, 0, 0, 1500], [0, 1, 0, 0], [0, 0, 1, 800], [0, 0, 0, 1]]
    made = plan(edge=models / "four.step", edge_number=3, base_from_cad=pose, sensor=SENSOR)[0]
    joint = made.joint
    assert [joint.thickness_mm, joint.root_mm, math.degrees(joint.bevel)] == pytest.approx([8.0, 4.0, 30.0], abs=1e-6)
    assert made.edge.length_mm == pytest.approx(60.0)
    assert made.edge.position_mm[:, 2] == pytest.approx(np.full(len(made.edge.position_mm), 800.0))
    assert made.edge.across[0] == pytest.approx([0.0, 0.0, 1.0], abs=1e-9)


def test_look_lists_the_edges(models: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["look", str(models / "four.step"), "--out", str(tmp_path / "four.html")]) == 0
    said = capsys.readouterr().out
    assert "edge 4: 60.00 mm from " in said
    assert "root_nominal_mm=4 --input bevel_nominal_deg=30" in said
    assert main(["look", str(models / "box.step")]) == 0
    assert "no bevelled edge" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("name", "number", "told"),
    [
        ("box", None, "found none among 12 edges"),
        ("four", None, "edge_number of one edge; there are 1: 100.00 mm from "),
        ("four", 5, "edge_number from 1 to 4, found 5"),
        ("sheet", None, "expected a solid"),
        ("torn", None, "expected a whole STEP file"),
        ("missing", None, "no such file"),
    ],
)
def test_what_is_no_edge_is_one_line(models: Path, name: str, number: int | None, told: str) -> None:
    with pytest.raises(InputError) as error:
        cad.nominal_edge(models / f"{name}.step", number)
    assert told in str(error.value)
    assert "\n" not in str(error.value)
