"""The process around the milling: written as the cell file says, read back, judged."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from workbench.artefacts import Judgement, Moves, PathGate, ProgramMoves
from workbench.errors import InputError
from workbench.program import write
from workbench.robot import Cell, forward_kinematics, read_cell

from . import languages
from .conftest import passed
from .languages import from_text, text
from .paths import Shape
from .postured import CUTTER, ROBOTS, as_workpiece, cell_of, postured

HOME = (0.0, 0.0, 10.0, 10.0, 45.0, 0.0)
FULL: dict[str, Any] = {
    "home": {"joints_deg": HOME, "turntable_deg": 5.0},
    "approach_mm": 60.0,
    "retract_mm": 40.0,
    "spindle": {"on_signal": "doSpindle", "at_speed_signal": "diAtSpeed", "wait_s": 15.0},
    "coolant_signal": "doCoolant",
    "mechanical_unit": "STN1",
    "before": ["CheckTool"],
    "after": ["BlowOff"],
    "stop_between_layers": True,
    "feed": {"override_percent": 50.0, "most_mm_s": 8.0},
}


def cell_with(folder: Path, process: dict[str, Any], **more: Any) -> Cell:
    cell_of("irb6700", folder, dialect="abb")
    file = folder / "irb6700.json"
    file.write_text(json.dumps({**json.loads(file.read_text()), "process": process, **more}))
    return read_cell(file)


@pytest.fixture(scope="module")
def cell(tmp_path_factory: pytest.TempPathFactory) -> Cell:
    return cell_with(tmp_path_factory.mktemp("cell"), FULL)


@pytest.fixture(scope="module")
def layers(cell: Cell) -> Moves:
    """Two layers on an arc, and the travel between them."""
    return postured(cell, "irb6700", Shape(bend=1 / 300, length_mm=60, layers=2))


def judged(cell: Cell, program: ProgramMoves, moves: Moves) -> Judgement:
    return cell.judge(program, moves, 0.05, lambda *_: None)


def disorders(cell: Cell, program: ProgramMoves, moves: Moves) -> str:
    """What the judge says of the process, in one text."""
    return " ".join(one.finding for one in judged(cell, program, moves).violations if one.kind == "process")


def refused(moves: Moves, cell: Cell) -> str:
    gate, *_ = (one for one in write(moves, passed(moves.toolpath), cell) if isinstance(one, PathGate))
    assert not gate.passed
    return gate.reason


def test_it_is_judged_with_home_and_retract(layers: Moves, cell: Cell) -> None:
    document, *_, gate, judgement, _ = write(layers, passed(layers.toolpath), cell)
    assert isinstance(judgement, Judgement)
    assert judgement.passed, judgement.violations
    assert gate.passed
    remarks = " ".join(document.content.decode().replace("!", " ").split())
    assert "NOT CHECKED: what these routines do: CheckTool, BlowOff" in remarks
    assert "the program does none of it" not in remarks
    far = np.linalg.norm(
        (forward_kinematics(cell.chain, np.radians(HOME)) @ cell.flange_from_cutter)[:3, 3] - layers.position_mm[0]
    )
    bare = judged(replace(cell, process=None), from_text(text(layers, cell), layers, cell), layers)
    assert bare.length_mm > 1.5 * far  # out and back


def test_the_way_home_is_looked_at(tmp_path: Path, layers: Moves, cell: Cell) -> None:
    """A clamp half-way, and the plate itself although the cutter may touch it."""
    joints = from_text(text(layers, cell), layers, cell).moves
    half = (joints[0].joints + joints[1].joints) / 2
    tip = (forward_kinematics(cell.chain, half) @ cell.flange_from_cutter)[:3, 3]
    shape = {
        "pose": {"position_mm": [215, 0, 140], "quaternion_wxyz": [0.7071067811865476, 0, 0.7071067811865476, 0]},
        "cylinder_mm": [5, 90],
        "body": "cutter",
    }
    tree = {
        "tool": {"flange_from_cutter": CUTTER, "shapes": [shape]},
        "fixtures": [{"name": "block", "pose": {"position_mm": tip.tolist()}, "box_mm": [30, 30, 30]}],
        "may_touch": [["cutter", "workpiece"]],
    }
    assert "cutter" in refused(layers, as_workpiece("block", cell_with(tmp_path, FULL, **tree)))


@pytest.mark.parametrize(
    ("old", "new", "finding"),
    [
        ("SetDO doSpindle,1;", "", "before the spindle is on and at speed"),
        ("WaitDI diAtSpeed,1\\MaxTime:=15;", "WaitTime 15;", "before the spindle is on and at speed"),
        ("SetDO doSpindle,0;", "", "the spindle still turns on the way home"),
        ("MoveAbsJ jHome", "MoveAbsJ jStart", "elsewhere than at the cell file's home"),
    ],
)
def test_a_program_without_it_may_not_run(layers: Moves, cell: Cell, old: str, new: str, finding: str) -> None:
    written = text(layers, cell)
    assert old in written
    program = from_text(written.replace(old, new), layers, cell)
    assert finding in disorders(cell, program, layers)


@pytest.mark.parametrize(
    ("old", "new", "finding"),
    [
        ("SetDO doCoolant,1", "SetDO doCoolant,2", "expected ',1;' or ',0;', found ',2;'"),
        ("CheckTool;", "p1;", "expected a name that the controller knows and this module has not taken"),
        ("layer2:", "layer1:", "a name that is not taken"),
        ("MaxTime:=15", "MaxTime:=-1", "a number above 0"),
    ],
)
def test_what_is_changed_is_refused(layers: Moves, cell: Cell, old: str, new: str, finding: str) -> None:
    written = text(layers, cell)
    assert old in written
    with pytest.raises(InputError, match=finding):
        from_text(written.replace(old, new), layers, cell)


def test_the_turntable_waits_where_the_path_has_it(tmp_path: Path, cell: Cell) -> None:
    """Unless the cell file says where it stands at home."""
    moves = postured(cell, "irb6700", Shape(bend=1 / 300, length_mm=60), turned=0.1)
    for said, angle in (({}, moves.turntable_deg[0]), ({"turntable_deg": 7.0}, 7.0)):
        here = cell_with(tmp_path, {"home": {"joints_deg": HOME, **said}})
        home, *_, last = from_text(text(moves, here), moves, here).moves
        assert np.degrees([home.turntable, last.turntable]) == pytest.approx([angle, angle], abs=1e-3)


def test_what_is_not_said_is_told(tmp_path: Path, layers: Moves) -> None:
    cell = cell_with(tmp_path, {"home": {"joints_deg": HOME}, "spindle": {"on_signal": "doSpindle"}, "restart": False})
    document, *_ = write(layers, passed(layers.toolpath), cell)
    words = " ".join(document.content.decode().replace("!", " ").split())
    assert "NOT CHECKED: that the spindle is at speed" in words
    assert "WaitTime 20;" in words
    assert "layer1:" not in words
    document, *_ = write(layers, passed(layers.toolpath), cell, controller="trajectory")
    words = " ".join(document.content.decode().replace("#", " ").split())
    assert "spindle and coolant: the program does none of it" in words


MAKERS = {"abb": "irb6700", "kuka": "kr210", "fanuc": "m20ia", "ur": "ur10e", "yaskawa": "gp25"}
TOOLS = {"yaskawa": "TOOL[3]"}  # a job for Yaskawa names the controller's
NAMES: dict[str, dict[str, Any]] = {  # signals as each maker names them
    "abb": {
        "coolant_signal": "doCoolant7",
        "spindle": {"on_signal": "doSpindle5", "at_speed_signal": "diAtSpeed6", "wait_s": 15.0},
        "mechanical_unit": "STN1",
    },
    "kuka": {"coolant_signal": "doCoolant", "spindle": {"on_signal": 5, "at_speed_signal": 6}},
    "fanuc": {"coolant_signal": 7, "spindle": {"on_signal": 5, "at_speed_signal": 6}},
    "ur": {"coolant_signal": 3, "spindle": {"on_signal": 5, "at_speed_signal": 6}},
    "yaskawa": {"coolant_signal": 7, "spindle": {"on_signal": 5, "at_speed_signal": 6}},
}


def home_of(controller: str) -> list[float]:
    return np.add(ROBOTS[MAKERS[controller]][1], (8, -6, 5, 0, 4, 3)).tolist()


def other_cell(controller: str, folder: Path, **more: Any) -> Cell:
    robot = MAKERS[controller]
    process = {
        **FULL,
        "mechanical_unit": None,
        "home": {"joints_deg": home_of(controller)},
        **NAMES[controller],
        **more,
    }
    cell_of(robot, folder, TOOLS.get(controller), dialect=controller)
    file = folder / f"{robot}.json"
    file.write_text(json.dumps({**json.loads(file.read_text()), "process": process}))
    return read_cell(file)


def files_of(controller: str, moves: Moves, cell: Cell) -> tuple[Any, dict[str, str]]:
    return languages.dialect_of(moves, cell, controller), languages.files(moves, cell, controller)


@pytest.fixture(scope="module", params=sorted(MAKERS))
def other(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> tuple[str, Cell, Moves]:
    cell = other_cell(request.param, tmp_path_factory.mktemp(request.param))
    return request.param, cell, postured(cell, MAKERS[request.param], Shape(bend=1 / 300, length_mm=60, layers=2))


def test_every_maker_says_it(other: tuple[str, Cell, Moves]) -> None:
    """The same order of events and moves in each language, turned back and judged."""
    controller, cell, moves = other
    dialect, files = files_of(controller, moves, cell)
    program = dialect.read(files)
    kinds = [event.kind for event in program.events]
    restart = ["restart"] if controller != "ur" else []
    axis, limits = (["activate_axis"], ["feed_limits"]) if controller == "abb" else ([], [])
    on, off = [*axis, *limits, "spindle_on", "wait_speed", "coolant_on"], ["coolant_off", "spindle_off"]
    assert kinds == ["hook", *on, *restart, *on, *off, "stop", *restart, *on, *off, "hook", *limits]
    assert [event.value.lower() for event in program.events if event.kind == "hook"] == ["checktool", "blowoff"]
    assert [e.value.lower() for e in program.events if e.kind == "restart"] == (["layer1", "layer2"] if restart else [])
    home, start, *path, retract, last = program.moves
    assert [move.kind for move in (home, start, last)] == ["J", "J", "J"]
    for move in (home, last):
        assert np.degrees(move.joints) == pytest.approx(home_of(controller), abs=1e-3)
    assert len(path) == len(moves.layer)
    assert max(move.feed_mm_s for move in path) <= 8
    tool = program.tools[path[0].tool].flange_from_tool
    tool = cell.flange_from_cutter if tool is None else tool
    frame = program.work_objects[path[0].work_object]
    first = np.linalg.inv(frame) @ forward_kinematics(cell.chain, start.joints) @ tool
    assert first[:3, 3] == pytest.approx(path[0].pose[:3, 3] - 60 * path[0].pose[:3, 2], abs=0.05)
    assert retract.pose[:3, 3] == pytest.approx(path[-1].pose[:3, 3] - 40 * path[-1].pose[:3, 2], abs=0.01)
    for event in program.events:
        assert event.before == 0 or program.moves[event.before - 1].zone_mm == 0
    *_, gate, judgement, _ = write(moves, passed(moves.toolpath), cell)
    assert judgement.passed, judgement.violations
    assert "the program does none of it" not in " ".join(gate.unchecked)


STOPS = {"abb": "Stop;", "kuka": "HALT", "fanuc": "PAUSE", "yaskawa": "PAUSE", "ur": "popup"}


@pytest.mark.parametrize("controller", sorted(STOPS))
def test_a_shape_only_path_gets_a_program_that_stops_for_the_operator(tmp_path: Path, controller: str) -> None:
    """60 mm back from where the cutter begins to cut, spindle off; without the stop there is no program."""
    alone = {"probe": {"distance_mm": 60}, "stop_between_layers": False}
    if controller == "abb":
        cell, robot = cell_with(tmp_path, FULL | alone), "irb6700"
    else:
        cell, robot = other_cell(controller, tmp_path, **alone), MAKERS[controller]
    moves = postured(cell, robot, Shape(bend=1 / 300, length_mm=60))
    gate = replace(passed(moves.toolpath), loosened=("SHAPE ONLY: nothing shows it",))
    *files, after, judgement, _ = write(moves, gate, cell)
    assert judgement.passed, judgement.violations
    assert not after.shape_only
    assert any("stops at a point of the path" in said for said in after.unchecked)
    first = next(event for event in judgement.program.events if event.kind == "stop")
    assert first.before == 2
    on = [event.line for event in judgement.program.events if event.kind == "spindle_on"]
    assert first.line < min(on)
    probe = judgement.program.moves[1]
    tip = forward_kinematics(cell.chain, probe.joints) @ moves.flange_from_point
    begin = moves.position_mm[int(np.argmax(moves.cutting))]
    assert tip[:3, 3] + 60 * tip[:3, 2] == pytest.approx(begin, abs=0.02)
    (silent,) = write(moves, gate, replace(cell, process=cell.process.model_copy(update={"probe": None})))
    assert silent.shape_only
    nearer = cell.process.probe.model_copy(update={"distance_mm": 61.0})
    elsewhere = replace(cell, process=cell.process.model_copy(update={"probe": nearer}))
    told = judged(elsewhere, judgement.program, moves)
    assert any("beside the point that the operator is asked for" in one.finding for one in told.violations)
    unasked = replace(
        judgement.program, events=tuple(event for event in judgement.program.events if event.kind != "stop")
    )
    told = judged(cell, unasked, moves)
    assert any("does not stop where the operator sees" in one.finding for one in told.violations)
    assert STOPS[controller] in files[0].content.decode()


OUT = "set_standard_digital_out(5, {})"
SPINDLE = {
    "abb": ("SetDO doSpindle5,1;", "SetDO doSpindle5,0;", "WaitDI diAtSpeed6"),
    "kuka": ("$OUT[5]=TRUE", "$OUT[5]=FALSE", "WAIT FOR $IN[6]"),
    "fanuc": ("DO[5]=ON", "DO[5]=OFF", "WAIT DI[6]=ON"),
    "yaskawa": ("DOUT OT#(5) ON", "DOUT OT#(5) OFF", "WAIT IN#(6)=ON"),
    "ur": (OUT.format(True), OUT.format(False), "get_standard_digital_in(6)"),
}
MOTION = ("MoveL", "MoveC", "LIN", "CIRC", "FINE", "movel", "movec", "MOVL", "MOVC")


def test_what_is_changed_in_any_language_is_refused(other: tuple[str, Cell, Moves]) -> None:
    controller, cell, moves = other
    dialect, files = files_of(controller, moves, cell)
    on, off, speed = SPINDLE[controller]
    assert controller != "abb" or all(
        text.partition(f"layer{k}:\n")[2].partition("Move")[0].count("ConfL\\On")
        for text in files.values()
        for k in (1, 2)
    )
    for old, new in (
        (on, on.replace("5", "9")),
        (speed, speed.replace("6", "8")),
        ("CheckTool", "Elsewhere"),
        ("CHECKTOOL", "ELSEWHERE"),
    ):
        wrong = {name: text.replace(old, new) for name, text in files.items()}
        if wrong != files:
            with pytest.raises(InputError, match="cell file's process section"):
                dialect.read(wrong)
    never = dialect.read({name: text.replace(on, off) for name, text in files.items()})
    assert "before the spindle is on and at speed" in disorders(cell, never, moves)


def test_a_statement_behind_a_blend_is_refused(other: tuple[str, Cell, Moves]) -> None:
    """The controller would run ahead and switch too early."""
    controller, cell, moves = other
    dialect, files = files_of(controller, moves, cell)
    (name,) = [one for one in files if not one.endswith(".dat")]
    lines = files[name].splitlines()
    i = next(
        n
        for n, line in enumerate(lines)
        if any(off in line for off in ("doCoolant=F", "doCoolant7,0", "DO[7]=OFF", "out(3, F", "(7) OFF"))
    )
    i = next(n for n in range(i, 0, -1) if any(word in lines[n] for word in MOTION)) + 1
    before = lines[i - 1]
    lines[i - 1] = {
        "abb": before.replace(",fine,", ",zonePath,"),
        "kuka": f"{before} C_DIS",
        "fanuc": before.replace("FINE", "CR3"),
        "ur": before.replace("r=0.000000", "r=0.000100"),
        "yaskawa": before.replace("PL=0", "CR=1.0"),
    }[controller]
    assert lines[i - 1] != before
    with pytest.raises(InputError, match="expected a move that reaches its target before this statement"):
        dialect.read({**files, name: "\n".join([*lines, ""])})


@pytest.mark.parametrize(
    ("controller", "change", "finding"),
    [
        ("abb", {"coolant_signal": "DOSPINDLE5"}, "different signals of spindle and coolant"),
        ("abb", {"before": ["stop"]}, "a name that has no meaning to ABB yet, found 'stop'"),
        ("abb", {"approach_mm": 2000.0}, "process.approach_mm: expected a point that the robot reaches"),
        ("kuka", {"before": ["halt"]}, "a name that has no meaning to KUKA yet, found 'halt'"),
        ("kuka", {"mechanical_unit": "STN1"}, "mechanical_unit: expected null for KUKA"),
        ("fanuc", {"coolant_signal": "doCoolant"}, "coolant_signal: expected one of a signal's numbers for FANUC"),
        (
            "ur",
            {"home": {"joints_deg": HOME, "controller_name": "jHome"}},
            "controller_name: expected null, since programs say home themselves",
        ),
        ("fanuc", {"home": {"joints_deg": HOME, "controller_name": "PR[99]"}}, "a position register PR"),
        ("yaskawa", {"home": {"joints_deg": HOME, "controller_name": "PR[1]"}}, "a position variable, P000 to P99999"),
        ("yaskawa", {"coolant_signal": "doCoolant"}, "expected one of a signal's numbers for Yaskawa"),
        (
            "ur",
            {"home": {"joints_deg": HOME, "turntable_deg": 20.0}},
            "home.turntable_deg: expected the angle at which",
        ),
    ],
)
def test_what_a_maker_has_no_words_for_is_refused(tmp_path: Path, controller: str, change: Any, finding: str) -> None:
    cell = other_cell(controller, tmp_path, **change)
    moves = postured(cell, MAKERS[controller], Shape(length_mm=30))
    with pytest.raises(InputError, match=finding):
        files_of(controller, moves, cell)


def test_words_of_other_languages_are_names_to_rapid(tmp_path: Path) -> None:
    cell = other_cell("abb", tmp_path, before=["Brake", "Sync"], coolant_signal="Pulse")
    moves = postured(cell, MAKERS["abb"], Shape(length_mm=30))
    dialect, files = files_of("abb", moves, cell)
    assert judged(cell, dialect.read(files), moves).passed


@pytest.mark.parametrize(
    ("controller", "name"), [("abb", "jSafe"), ("kuka", "XHOME"), ("fanuc", "PR[3]"), ("yaskawa", "P010")]
)
def test_home_that_the_controller_has(tmp_path: Path, controller: str, name: str) -> None:
    home = {"joints_deg": home_of(controller), "controller_name": name}
    cell = other_cell(controller, tmp_path, home=home)
    moves = postured(cell, MAKERS[controller], Shape(length_mm=30))
    dialect, files = files_of(controller, moves, cell)
    program = dialect.read(files)
    assert (program.moves[0].joints, program.moves[0].place) == (None, name)
    assert judged(cell, program, moves).passed
    if controller == "abb":  # any name may be the controller's; none is declared
        assert not any(f"jointtarget {name}" in text for text in files.values())
        other = dialect.read({one: text.replace(name, "jOther") for one, text in files.items()})
        (found, *_) = judged(cell, other, moves).violations
        assert "no joint angles" in found.finding
