"""Plans of whole edges: with and without a cell, what binds, input that is none; and their programs."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import open3d as o3d
import pytest

from bench.scan_plan.achieved import _planned
from bench.scan_plan.parts import draw, sensor_file
from tests.seldom import seldom
from workbench import edge, robot
from workbench.artefacts import Chapter, Document, Gate
from workbench.errors import InputError
from workbench.result_files import ScanPlanFile, result_schema
from workbench.scan_plan import ScanPlan, plan, program

DATA = Path(__file__).resolve().parents[2] / "data"
SENSOR, HAND_EYE = DATA / "calibration" / "sensor.json", DATA / "calibration" / "handeye.json"
EDGE = DATA / "synthetic" / "paths" / "raw_arc.json"
CELL = DATA / "robot" / "cell.json"
WANTED: dict[str, Any] = {"wanted_root_mm": 0.02, "wanted_bevel_deg": 0.1}


class Made(NamedTuple):
    """What a plan's results say."""

    plan: ScanPlan
    file: ScanPlanFile
    gate: Gate
    chapter: Chapter


def made(*args: Any, **more: Any) -> Made:
    found = plan(*args, **{"edge": EDGE, "sensor": SENSOR, **WANTED, **more})
    document, chapter = (next(one for one in found if isinstance(one, kind)) for kind in (Document, Chapter))
    return Made(found[0], ScanPlanFile.model_validate_json(document.content), found[-1], chapter)


def in_cell(**more: Any) -> Made:
    return made(robot.cell(cell=CELL), hand_eye=HAND_EYE, tool_stays=False, **more)


@pytest.fixture(scope="module")
def shipped() -> Made:
    return in_cell()


ALONG_MM = (1500.0, 1515.0, 1530.0)


FEW: dict[str, Any] = {"passes": 1, "frame_rate_hz": 60.0}  # frames a millimetre: a rehearsal takes as long as it has


@pytest.fixture(scope="module")
def short(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Made]:
    """A file of 30 mm of a straight edge, and its plan."""
    line = tmp_path_factory.mktemp("short") / "edge.csv"
    line.write_text("".join(["x_mm,y_mm,z_mm\n", *(f"{x},0,800\n" for x in ALONG_MM)]))
    return line, made(edge=line, **FEW)


def test_the_shipped_cell_reaches_what_is_wanted_in_two_passes(shipped: Made) -> None:
    scan, file, gate, _ = shipped
    assert gate.passed
    assert len(scan.passes) <= 2
    assert np.nanmax(2.0 * scan.root.u) <= 0.02
    assert np.nanmax(2.0 * scan.bevel.u) <= 0.1
    assert file.reached
    assert [len(one.points) for one in file.passes] == [len(one.base_from_view) for one in scan.passes]


def test_the_report_names_the_file_of_the_edge_without_its_folder(shipped: Made) -> None:
    assert EDGE.name in shipped.chapter.html
    assert str(EDGE.parent) not in shipped.chapter.html


def test_what_is_promised_decides_and_is_written(shipped: Made) -> None:
    columns = shipped.file.predicted
    root, bevel = np.array(columns.promised_root_U_mm, float), np.array(columns.promised_bevel_U_deg, float)
    assert (root > 1.1 * np.array(columns.root_U_mm, float)).all()  # nine of ten scans, not the median
    assert (bevel > 1.1 * np.array(columns.bevel_U_deg, float)).all()
    assert columns.reached == ((root <= 0.02) & (bevel <= 0.1)).tolist()


def test_a_rehearsal_that_the_engine_refuses_promises_nothing(
    monkeypatch: pytest.MonkeyPatch, short: tuple[Path, Made]
) -> None:
    def refused(*_: Any, **__: Any) -> Any:
        raise InputError("scan", "its faces are none")

    monkeypatch.setattr(edge, "segment", refused)
    _, file, gate, _ = made(edge=short[0], **FEW)
    assert not gate.passed
    assert not any(file.predicted.reached)
    assert "with a radius of 0.22 mm: scan: its faces are none" in gate.reason


def test_another_turntable_angle_is_tried_where_a_rehearsal_promises_too_little(tmp_path: Path) -> None:
    drawn = draw(9_751_011)
    _, found = _planned(drawn, sensor_file(drawn, tmp_path), 9_751_011)
    assert found.reached.all()
    assert found.table != 0.0  # where the search alone finds enough


def test_a_fixture_over_the_edge_shadows_it_and_is_named(tmp_path: Path, shipped: Made) -> None:
    scan = shipped.plan
    middle = len(scan.edge.position_mm) // 2
    document = json.loads(CELL.read_text())
    document["robot"]["urdf"] = str(CELL.parent / document["robot"]["urdf"])
    at = scan.edge.position_mm[middle] + 10.0 * scan.edge.normal[middle]
    on_table = at - document["turntable"]["base_from_turntable"]["position_mm"]
    clamp = {"name": "clamp", "on": "turntable", "pose": {"position_mm": on_table.tolist()}, "box_mm": [24, 24, 60]}
    document["fixtures"].append(clamp)
    file = tmp_path / "cell.json"
    file.write_text(json.dumps(document))
    root, bevel = 0.05, 0.3  # one pass reaches them where it sees the edge
    wanted = {"passes": 1, "wanted_root_mm": root, "wanted_bevel_deg": bevel}
    hidden, _, gate, _ = made(robot.cell(cell=file), hand_eye=HAND_EYE, tool_stays=False, **wanted)
    assert not gate.passed
    assert any("shadow of clamp" in one for one in hidden.binds)
    unseen = np.isnan(hidden.root.u)
    assert unseen.any()
    assert (2.0 * hidden.root.u[~unseen] <= root).all()
    assert (2.0 * hidden.bevel.u[~unseen] <= bevel).all()
    assert np.abs(hidden.arc_length_mm[unseen] - scan.edge.arc_length_mm[middle]).max() < 40.0


@pytest.fixture(scope="module")
def beyond_reach(short: tuple[Path, Made]) -> Made:
    """A bevel angle that no two passes tell."""
    return made(edge=short[0], wanted_bevel_deg=0.005, **FEW | {"passes": 2})


def test_what_cannot_be_reached_is_told_with_what_would_help(beyond_reach: Made) -> None:
    scan, file, gate, _ = beyond_reach
    assert not gate.passed
    assert not file.reached
    assert any("bevel_deg" in one for one in scan.binds)
    assert any("half the noise" in one for one in scan.would_help)


def test_passes_drift_to_either_side_in_turn(beyond_reach: Made) -> None:
    """What wrong points undo of one drift they add to the other."""
    assert [np.sign(one.drift_mm) for one in beyond_reach.plan.passes] == [1.0, -1.0]


def test_a_pass_drifts_as_far_as_the_section_has_room(tmp_path: Path) -> None:
    line = tmp_path / "edge.csv"
    line.write_text("x_mm,y_mm,z_mm\n1000,0,800\n1520,0,800\n")
    drifts = []
    for width in (6.5, 20.0):
        narrow = sensor(tmp_path, width_mm=[width, width])
        (one,) = made(edge=line, sensor=narrow, **FEW, wanted_root_mm=0.5, wanted_bevel_deg=2.0).plan.passes
        drifts.append(one.drift_mm)
    assert drifts == pytest.approx([0.15, 2.0], abs=0.02)


def test_the_plate_and_the_scanner_are_bodies(shipped: Made) -> None:
    place = shipped.plan.scan_cell
    assert place is not None
    bodies = {shape.body for shape in place.shapes}
    assert {"workpiece", "tool"} <= bodies
    assert "cutter" not in bodies


def test_a_polyline_is_an_edge(tmp_path: Path, short: tuple[Path, Made]) -> None:
    drawn = tmp_path / "edge.dxf"
    points = "".join(f"10\n{x}\n20\n0.0\n" for x in ALONG_MM)
    drawn.write_text(f"0\nSECTION\n2\nENTITIES\n0\nLWPOLYLINE\n38\n800.0\n{points}0\nENDSEC\n0\nEOF\n")
    for found in (short[1].plan.edge, made(edge=drawn, **FEW).plan.edge):
        assert np.allclose(found.position_mm[[0, -1]], [[1500.0, 0.0, 800.0], [1530.0, 0.0, 800.0]])
        assert np.allclose(np.abs(found.normal), [0.0, 1.0, 0.0])


def sensor(tmp_path: Path, **changes: Any) -> Path:
    file = tmp_path / "sensor.json"
    file.write_text(json.dumps(json.loads(SENSOR.read_text()) | changes))
    return file


def edge_through(folder: Path, *along_mm: float) -> Path:
    file = folder / f"through{'-'.join(map(str, along_mm))}.csv"
    file.write_text("\n".join(["x_mm,y_mm,z_mm", *(f"{1500 + x},0,800" for x in along_mm)]))
    return file


@pytest.fixture
def cell_with_plate(tmp_path: Path) -> Path:
    """The shipped cell with a plate of 8 mm as its workpiece's mesh, which has the edge at y = 0 and lies at y < 0."""
    document = json.loads(CELL.read_text())
    document["robot"]["urdf"] = str(CELL.parent / document["robot"]["urdf"])
    place = np.array(document["turntable"]["base_from_turntable"]["position_mm"])
    corners = np.array([[1300.0, -200.0, 800.0], [1700.0, 0.0, 808.0]]) - place
    box = o3d.geometry.TriangleMesh.create_box(*(corners[1] - corners[0])).translate(corners[0])
    o3d.io.write_triangle_mesh(str(tmp_path / "plate.ply"), box)
    document["workpiece"]["mesh"] = "plate.ply"
    file = tmp_path / "cell.json"
    file.write_text(json.dumps(document))
    return file


def test_the_order_of_points_is_compared_with_the_workpiece(short: tuple[Path, Made], cell_with_plate: Path) -> None:
    """Points in the wrong order lead the scanner along the plate's side of the edge."""
    lines = short[0].read_text().splitlines()
    back = cell_with_plate.with_name("back.csv")
    back.write_text("\n".join([lines[0], *lines[:0:-1]]) + "\n")
    cell, more = robot.cell(cell=cell_with_plate), {**FEW, "hand_eye": HAND_EYE, "tool_stays": False}

    def side(gate: Gate) -> list[str]:
        return [one for one in gate.unchecked if "on which side the plate lies" in one]

    assert not side(made(cell, edge=back, **more).gate)
    for edge_file, upper in ((short[0], [0, 0, 1]), (back, [0, 0, -1]), (short[0], [0, 0, -1])):
        with pytest.raises(InputError, match="found the plate of the cell file's workpiece on another side"):
            made(cell, edge=edge_file, upper_side=upper, **more)
    (told,) = (one for one in short[1].plan.unchecked if "on which side the plate lies" in one)
    assert "towards (0, 1, 0)" in told


def test_bad_input_ends_in_one_line(tmp_path: Path) -> None:
    far = tmp_path / "far.json"
    line = {"format": "edge-line", "version": 1, "points_mm": [[9000, 0, 0], [9100, 0, 0]]}
    far.write_text(json.dumps(line))
    along = tmp_path / "along.json"
    along.write_text(json.dumps(line | {"upper_side": [1.0, 0.0, 0.0]}))
    metres = tmp_path / "metres.csv"
    metres.write_text("x_mm,y_mm,z_mm\n1.5,0,0.8\n1.62,0,0.8\n")
    arc = tmp_path / "arc.dxf"
    arc.write_text("0\nLWPOLYLINE\n10\n0\n20\n0\n42\n0.5\n10\n9\n20\n0\n0\nEOF\n")
    cases: list[tuple[dict[str, Any], str]] = [
        ({"sensor": sensor(tmp_path, measuring_range_mm=None)}, "measuring_range_mm"),
        ({"root_mm": 8.0}, "root_mm below thickness_mm"),
        ({"thickness_mm": 90.0}, "cannot be measured with this sensor"),
        ({"root_tolerance_mm": (0.0, 0.0), "wanted_root_mm": None}, "tolerance of some width"),
        ({"edge": arc}, "found an arc"),
        ({"edge": metres}, "in metres"),
        ({"most_speed_mm_s": 0.01}, "between frames"),
        ({"edge": edge_through(tmp_path, 0, 120, 60, 180)}, "it turns back at point 2 .1620, 0, 800 mm.: out of order"),
        ({"edge": edge_through(tmp_path, 0, 60, 60, 0)}, "turns back at point 2"),
        ({"edge": edge_through(tmp_path, 60, 60)}, "expected different points along the edge, found one place alone"),
        ({"edge": far, "upper_side": (1.0, 0.0, 0.0)}, "upper side across the edge"),
        ({"edge": along}, "upper side across the edge"),
    ]
    for given, words in cases:
        with pytest.raises(InputError, match=words) as told:
            made(**given)
        assert "\n" not in str(told.value)
    with pytest.raises(InputError, match="out of the robot's reach"):
        in_cell(edge=far)


def test_what_a_sensor_file_records_only_says_so_and_changes_nothing(tmp_path: Path, short: tuple[Path, Made]) -> None:
    said = {name: str(one.get("description")) for name, one in result_schema("sensor.json")["properties"].items()}
    recorded = {name for name, words in said.items() if words.startswith("recorded only")}
    assert recorded == {"name", "line_thickness_mm", "filters"}
    line, before = short
    other = sensor(tmp_path, name="another", line_thickness_mm=4.0, filters=["median"])
    assert made(edge=line, sensor=other, **FEW).file == before.file


def test_a_rough_root_face_is_told_before_anything_moves(short: tuple[Path, Made]) -> None:
    line, (smooth, file, *_) = short
    rough = made(edge=line, roughness_mm=0.05, **FEW).plan
    assert any("roughness" in one for one in file.not_checked)
    assert np.nanmedian(rough.bevel.u) > 1.5 * np.nanmedian(smooth.bevel.u)
    assert np.nanmax(rough.bevel.u) < 1.01 * np.nanmin(
        rough.bevel.u
    )  # no draw of a rough face tells where the part's is
    assert not rough.reached.any()
    assert any("smooth root face" in one for one in rough.would_help)


def documents(made: Any) -> dict[str, bytes]:
    return {one.name: one.content for one in made if isinstance(one, Document)}


def test_the_pass_is_driven_with_the_profiler_on(shipped: Made) -> None:
    made = program(shipped.plan, robot.cell(cell=CELL), scanner_mass_kg=3)
    gate, files = made[-1], documents(made)
    assert isinstance(gate, Gate)
    assert gate.clean
    text = files["ScanEdge1.mod"].decode()
    on, off = text.index("SetDO doScan,1"), text.index("SetDO doScan,0")
    assert on < text.index("WaitDI diScanReady,1") < text.index("MoveL p1") < off < text.rindex("jHome")
    assert "Scanning pass 1 of" in text
    assert "EGM or a socket task, flange (tool0) in the base" in " ".join(text.replace("!", " ").split())
    (chapter,) = [one for one in made if isinstance(one, Chapter)]
    assert "root face" not in chapter.html
    check = json.loads(files["scan_check_1.json"])
    assert check["passed"]
    assert check["deviation_mm"] < 0.1


@pytest.mark.parametrize(
    ("controller", "file"),
    [
        *(("kuka", "ScanEdge1.src"), ("ur", "ScanEdge1.script")),
        *seldom(("fanuc", "SCANEDGE1.ls"), ("trajectory", "ScanEdge1.csv")),
    ],
)
def test_other_languages(shipped: Made, controller: Any, file: str) -> None:
    made = program(shipped.plan, robot.cell(cell=CELL), controller=controller, scanner_mass_kg=3)
    assert made[-1].passed
    assert made[-1].loosened  # the cell's words are for another controller
    assert file in documents(made)


@pytest.mark.parametrize("hasty", [0, 1])
def test_programs_are_written_all_or_none(shipped: Made, hasty: int) -> None:
    """Of two passes one is faster than the robot: the other's program was written beside the refusal."""
    passes = [shipped.plan.passes[0]] * 2
    passes[hasty] = dataclasses.replace(passes[hasty], speed_mm_s=9000.0)
    made = program(dataclasses.replace(shipped.plan, passes=tuple(passes)), robot.cell(cell=CELL), scanner_mass_kg=3)
    assert not made[-1].passed
    assert list(documents(made)) == [f"scan_check_{hasty + 1}.json"]
    (chapter,) = [one for one in made if isinstance(one, Chapter)]
    assert "not released" in chapter.summary


def test_what_is_not_known_is_not_checked(shipped: Made) -> None:
    gate = program(shipped.plan, robot.cell(cell=CELL))[-1]
    assert gate.passed
    assert any("load of the scanner" in text for text in gate.loosened)
    assert not documents(program(shipped.plan, None))
    assert not program(shipped.plan, None, controller="abb")[-1].clean
