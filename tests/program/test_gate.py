"""No program without a decision on its very path: what was tried to get around that, and what is said then."""

import dataclasses
import json
import re
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from html import unescape
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from workbench.artefacts import Chapter, Document, Moves, PathGate, Toolpath
from workbench.cli import main
from workbench.dialect import plain
from workbench.errors import InputError
from workbench.path import simplify
from workbench.pipeline import Pipeline
from workbench.program import csv, write
from workbench.report import html
from workbench.robot import Cell, read_cell
from workbench.robot import Shape as Shape_

from .conftest import passed, rejected
from .languages import from_text, text
from .paths import Shape, mill_path, run_move
from .postured import DATA

WRITERS: list[Callable[..., Any]] = [write, partial(write, controller="kuka")]


@pytest.fixture(scope="module")
def path() -> Toolpath:
    return mill_path(Shape(bend=1 / 300, length_mm=40))


@pytest.mark.parametrize("write", WRITERS)
def test_another_paths_gate_releases_nothing(write: Callable[..., Any], path: Toolpath) -> None:
    """Even a copy is another path: whatever changed it since was not looked at."""
    with pytest.raises(InputError, match="the gate is not this path's"):
        write(simplify(path), passed(dataclasses.replace(path)))
    with pytest.raises(InputError, match="the gate is not this path's"):
        csv(path, passed(dataclasses.replace(path)))


@pytest.mark.parametrize("write", WRITERS)
def test_where_the_robot_is_known_moves_need_postures(write: Callable[..., Any], path: Toolpath, irb6700: Cell) -> None:
    moves = simplify(path)
    for gate in (passed(path, reached=False), passed(path)):
        with pytest.raises(InputError, match="postures"):
            write(moves, gate, irb6700)
    with pytest.raises(InputError, match="postures"):  # postures were found, the moves do without them
        write(moves, passed(path))
    with pytest.raises(InputError, match="postures"):
        csv(path, passed(path, reached=False), irb6700)
    assert csv(path, passed(path), irb6700) is not None
    (gate,) = write(moves, rejected(path), irb6700)
    assert not gate.passed


@pytest.mark.parametrize("write", WRITERS)
def test_without_a_cell_there_is_no_program(write: Callable[..., Any], path: Toolpath) -> None:
    """The gate is passed on as it is: the path itself is sound; who asked for a controller's is told."""
    gate = passed(path, reached=False)
    (left,) = write(simplify(path), gate)
    assert left is gate or "no program for kuka: it needs the robot's cell" in left.cause
    assert left.clean == (left is gate)
    assert csv(path, left) is not None


def test_a_controller_without_a_cell_leaves_the_table_of_the_path() -> None:
    """As the contract has it; the exit status is 1."""
    stages = [
        {"stage": "path.read", "toolpath": str(DATA.parent / "synthetic/paths/raw_arc.json")},
        {"stage": "path.check_file"},
        {"stage": "path.simplify"},
        {"stage": "program.write", "controller": "kuka"},
        {"stage": "program.csv"},
    ]
    found = Pipeline({"version": 1, "title": "t", "inputs": {}, "stages": stages}).run()
    assert found.last(Document).name == "toolpath.csv"
    assert not found.passed
    assert "no program for kuka: it needs the robot's cell (input 'cell')" in found.decisions[-1].cause


def test_what_the_inputs_decide_is_said_before_postures_are_searched(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The search may take minutes; that the cell is another controller's, or names none, is plain before it."""
    at = ["cutter_rotation_deg=[0, 0]", "turntable_deg=[0, 0]", "whole_map=false"]
    few = [word for one in at for word in ("--set", f"stiffness.posture.{one}")]
    run = ["run", str(DATA.parents[1] / "pipelines/optimise_posture.json"), "--out", str(tmp_path / "out"), *few]
    assert main([*run, "--input", "controller=kuka"]) == 1
    told = capsys.readouterr().err
    said = "\nNOT CHECKED: that the controller takes it: the cell names abb, and this is for kuka\n"
    assert "robot.plate" in told[: told.index(said)]
    assert "stiffness.posture" in told[told.index(said) :]
    whole = json.loads((DATA / "cell.json").read_text())
    whole["robot"]["urdf"] = str(DATA / whole["robot"]["urdf"])
    (tmp_path / "cell.json").write_text(json.dumps({name: one for name, one in whole.items() if name != "controller"}))
    assert main([*run, "--input", f"cell={tmp_path / 'cell.json'}"]) == 2
    told = capsys.readouterr().err
    assert "cell.json: $.controller: expected the make of the robot's controller" in told
    assert "stiffness.posture" not in told


@pytest.mark.parametrize(
    ("loose", "off"), [({"chord_tolerance_mm": 0.2}, "0.2"), ({"angle_tolerance_deg": 1.0}, "0.27")]
)
def test_moves_may_not_leave_the_path_farther_than_it_was_checked_for(path, loose, off):
    with pytest.raises(InputError, match=rf"leave the path by up to {off}\d* mm, and it was checked for 0.05 mm"):
        write(simplify(path, **loose), passed(path, reached=False))


def test_what_was_not_checked_stands_in_the_program(moves: Moves, irb6700: Cell) -> None:
    path = moves.toolpath
    gate = replace(
        passed(path), loosened=("the rule\nENDPROC is\r; 2 mm " * 6, "NOT CHECKED: load"), unchecked=("the plate!",)
    )
    lines = text(moves, irb6700, gate=gate).splitlines()
    said = [line.strip() for line in lines if "CHECK LOOSENED" in line or "NOT CHECKED" in line]
    assert said[0].startswith("! CHECK LOOSENED: the rule?ENDPROC is?, 2 mm")
    assert "! NOT CHECKED: load" in said
    assert "! NOT CHECKED: the plate?" in said
    assert not any(line.strip().startswith("ENDPROC is") for line in lines)
    assert max(map(len, lines)) < 250
    assert csv(path, gate) is None  # a table cannot say so


def test_remarks_are_spelt_in_what_every_controller_reads(moves: Moves, irb6700: Cell) -> None:
    """No question mark stands for a sign that has a plain spelling."""
    assert plain("Müller's Blech; 5 µm, ±0.5°: 90 % [x²]") == "Mullers Blech, 5 um, +-0.5 deg: 90 percent (x2)"
    assert plain("Łódź, «Sømærk» œuvre") == "Lodz, Somaerk oeuvre"
    assert plain("板!\n") == "???"
    *files, _, _, _ = write(moves, passed(moves.toolpath), irb6700)
    assert "?" not in files[0].content.decode("ascii")


def test_what_the_cell_does_not_say_ends_in_exit_1(moves: Moves, irb6700: Cell) -> None:
    """The program is there, with NOT CHECKED in its head; the gate is not clean, and says what is missing."""
    *files, gate, judgement, chapter = write(moves, passed(moves.toolpath), irb6700)
    assert judgement.passed, judgement.violations
    assert [file.name for file in files] == ["BevelPath.mod", "program_check.json"]
    for what in ("load of the tool", "envelope", "uncertainty", "accelerations", "links 1, 2"):
        assert any(text.startswith("NOT CHECKED: ") and what in text for text in gate.loosened) == (
            what != "links 1, 2"
        )
    assert (gate.passed, gate.clean) == (True, False)
    assert b"! NOT CHECKED: the load of the tool" in files[0].content
    assert "<li>the load of the tool" in chapter.html


def first_page(made: tuple[Any, ...]) -> str:
    chapters = tuple(one for one in made if isinstance(one, Chapter))
    return html(chapters).content.decode().partition("<footer>")[0]


def test_the_first_page_says_what_was_not_checked(moves: Moves, irb6700: Cell) -> None:
    """Before the signature, with a verdict that is no `pass`: whoever signs reads no further."""
    *_, gate, _, chapter = made = write(moves, passed(moves.toolpath), irb6700)
    page = first_page(made)
    assert '<div class="verdict undecided">' in page
    listed = unescape(page.partition("NOT CHECKED:</p>")[2])
    for said in (*gate.loosened, *gate.unchecked):
        assert f"<li>{said.removeprefix('NOT CHECKED: ')}</li>" in listed
    assert chapter.summary == f"BevelPath.mod (abb): released with {listed.count('<li>')} items NOT CHECKED"


def giving_way(moves: Moves, by_mm: float) -> Moves:
    """The moves with a cutter that is pushed off the bevel face all along."""
    made = moves.postures
    normal = Rotation.from_quat(made.quaternion_wxyz, scalar_first=True).as_matrix()[:, :, 0]
    return replace(moves, postures=replace(made, displacement_mm=by_mm * normal))


def test_a_cutter_that_gives_way_by_more_than_its_share_gets_no_program(moves: Moves, irb6700: Cell) -> None:
    """On a bevel of 40 deg 0.16 mm off the face are 0.249 mm of the root face, of 0.25; 0.162 are 0.252."""
    gate = passed(moves.toolpath)
    for by_mm, free in ((0.16, True), (0.162, False), (-0.162, False)):
        found = [one for one in write(giving_way(moves, by_mm), gate, irb6700) if isinstance(one, PathGate)][-1]
        assert found.passed == free
        assert ("gives way by 0.252 mm of the root face, expected at most 0.25" in found.reason) != free
    allowed_for = write(giving_way(moves, 1.0), replace(gate, loaded=True), irb6700)
    assert allowed_for[-3].passed
    wide = write(giving_way(moves, 0.3), gate, irb6700, root_tolerance_mm=1.0)
    assert wide[-3].passed
    unknown = write(giving_way(moves, np.nan), gate, irb6700)[-3]
    assert any("the robot's stiffness is unknown" in said for said in unknown.loosened)


def test_a_robot_that_does_not_come_back_gets_no_program(moves: Moves, irb6700: Cell) -> None:
    gate = passed(moves.toolpath)
    *files, found, _, _ = write(moves, gate, replace(irb6700, repeatability_mm=0.08))
    assert found.passed
    checks = {one["name"]: one for one in json.loads(files[-1].content)["checks"]}
    assert checks["root_repeatability_mm"]["value"] == pytest.approx(0.08 / np.sin(np.radians(40)), abs=1e-4)
    (refused,) = write(moves, gate, replace(irb6700, repeatability_mm=0.081))
    assert "repeatability is 0.126 mm of the root face, expected at most 0.125" in refused.reason


@pytest.mark.parametrize(("rpm", "torque", "free"), [(6000, 1.9, True), (6000, 2.1, False), (9000, 1.9, False)])
def test_a_cutter_that_asks_more_than_its_spindle_has_gets_no_program(moves, irb6700, rpm, torque, free):
    """2 Nm up to 6000 rpm, half of that at 12000; 2.1 Nm at 6000 rpm are 1.32 kW, 1.9 at 9000 are 1.79."""
    made = moves.postures
    asked = replace(made, torque_nm=np.linspace(0, torque, len(made.layer)), spindle_rpm=rpm)
    numbers = {"speed_rpm": [0.1, 6000, 12000], "torque_nm": [2, 2, 1], "power_kw": [1e-4, 1.3, 1.3]}
    curve = read_cell(DATA / "cell.json").spindle.model_copy(update=numbers)
    cell = replace(irb6700, spindle=curve)
    written = write(replace(moves, postures=asked), passed(moves.toolpath), cell)
    found = next(one for one in written if isinstance(one, PathGate))
    assert found.passed == free
    if free:
        checks = {one["name"]: one for one in json.loads(written[1].content)["checks"]}
        assert checks["spindle_torque_nm"] == {"name": "spindle_torque_nm", "value": 1.9, "limit": 2.0, "passed": True}
        assert checks["spindle_power_kw"]["value"] == pytest.approx(1.9 * rpm * np.pi / 30000, abs=1e-4)
    else:
        assert f"asks torque of {torque:g} Nm of the spindle at {rpm:g} rpm, expected at most" in found.reason
    unknown = write(moves, passed(moves.toolpath), cell)[-3]
    assert any("the milling force is unknown" in said for said in unknown.loosened)


@pytest.mark.parametrize("controller", ["kuka", "trajectory"])
def test_what_another_controller_reads_ends_in_exit_1(moves: Moves, irb6700: Cell, controller: Any) -> None:
    """The cell is an ABB's: nothing of its process can be said, and nobody knows whether the controller takes it."""
    home = read_cell(DATA / "cell.json").process.model_copy(update={"spindle": None, "probe": None})
    made = write(moves, passed(moves.toolpath), replace(irb6700, unchecked=(), process=home), controller=controller)
    gate = next(one for one in made if isinstance(one, PathGate))
    assert not gate.clean
    assert (
        f"NOT CHECKED: that the controller takes it: the cell names abb, and this is for {controller}" in gate.loosened
    )
    assert any("spindle and coolant: the program does none of it" in text for text in gate.loosened)
    assert "<li>that the controller takes it: the cell names abb" in first_page(made)


def test_a_program_that_fails_is_not_left(moves: Moves, irb6700: Cell) -> None:
    """A box between two targets: no program, and line, place and pair are said."""
    at = moves.position_mm[moves.cutting][4]
    pose = np.eye(4)
    pose[:3, 3] = at + np.array([0, 0, 60])
    boxed = replace(irb6700, shapes=(*irb6700.shapes, Shape_("post", -1, "box", (30.0, 30.0, 30.0), pose)))
    record, gate, judgement, chapter = write(moves, passed(moves.toolpath), with_spindle(boxed))
    assert not judgement.passed
    assert record.name == "program_check.json"
    assert "Reasons against release" in chapter.html
    words = r"program refused: line \d+, at [\d.]+ mm of its way: .*post.*, expected a clearance of 5.00 mm"
    assert re.search(words, gate.reason)
    assert {"tool", "post"} <= set(re.findall(r"tool|post", gate.reason))


def with_spindle(cell: Cell) -> Cell:
    """A capsule around the cutter's axis, from 20 mm behind its tip on."""
    pose = cell.chain.base_from_flange_at_zero @ cell.flange_from_cutter
    pose = pose.copy()
    pose[:3, 3] -= 120 * pose[:3, 2]
    return replace(cell, shapes=(*cell.shapes, Shape_("tool", 6, "capsule", (30.0, 140.0), pose)))


def parabola(corner: Any, before: Any, after: Any, zone_mm: float) -> Any:
    """The rounded corner, as controllers do it (a quadratic Bezier curve)."""
    u, v = (p - corner for p in (before, after))
    a, b = (w * min(zone_mm / np.linalg.norm(w), 0.5) for w in (u, v))
    f = np.linspace(0, 1, 101)[:, None]
    return corner + (1 - f) ** 2 * a + f**2 * b


def test_blending_does_not_leave_the_path_farther_than_it_was_checked_for(moves: Moves, irb6700: Cell) -> None:
    """Wide zones would cut corners; sharp ones are driven to their point, and all others stay near it."""
    path = moves.toolpath
    straight = simplify(path, moves.postures, arcs=False, chord_tolerance_mm=0.001, angle_tolerance_deg=0.01)
    moves = from_text(text(straight, irb6700, 5), straight, irb6700).moves[1:]
    at = np.array([move.pose[:3, 3] for move in moves])
    blended = [i for i in range(1, len(moves) - 1) if moves[i].zone_mm > 0]
    sharp = [i for i in range(1, len(moves) - 1) if not moves[i].zone_mm]
    assert len(blended) > 5
    assert len(sharp) >= 4
    for i in range(1, len(moves) - 1):
        rounded = parabola(at[i], at[i - 1], at[i + 1], 5)
        lines = np.vstack([run_move(at[i - 1], None, at[i], 2000), run_move(at[i], None, at[i + 1], 2000)])
        off = np.linalg.norm(rounded[::10, None] - lines, axis=2).min(axis=1).max()
        assert off < 0.055 or i in sharp
