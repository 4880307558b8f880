"""Every dialect's program, read back by its own reader, is the path; what is changed in it is seen or refused."""

from __future__ import annotations

import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from workbench.artefacts import Moves
from workbench.errors import InputError
from workbench.program import write
from workbench.robot import Cell, forward_kinematics

from .conftest import passed
from .languages import back, dialect_of, files, job_of
from .paths import Shape
from .postured import ROBOTS, cell_of, postured

CASES = [("kuka", "kr210"), ("fanuc", "m20ia"), ("ur", "irb6700"), ("trajectory", "irb6700")]
CASES += [("yaskawa", "gp25"), ("kuka", "irb6700"), ("ur", "ur10e"), ("abb", "irb6700")]


TOOLS = {"gp25": "TOOL[3]"}  # a job for Yaskawa names the controller's
BEND = Shape(bend=1 / 300, length_mm=60, lifted_mm=(34, 44))


@pytest.fixture(scope="session")
def cells(tmp_path_factory) -> dict[str, Cell]:
    folder = tmp_path_factory.mktemp("cells")
    load = {"tool_mass_kg": 15.0, "tool_centre_of_gravity_mm": np.array([1.0, 2, 150])}
    return {robot: replace(cell_of(robot, folder, TOOLS.get(robot)), **load) for robot in ROBOTS}


@pytest.fixture(scope="session")
def made(cells) -> dict[str, Moves]:
    return {robot: postured(cells[robot], robot, BEND) for robot in ROBOTS}


def off_way(chain: np.ndarray, point: np.ndarray) -> float:
    """Distance of a point from a chain of points (n, 3)."""
    way = np.diff(chain, axis=0)
    share = np.clip(((point - chain[:-1]) * way).sum(axis=1) / np.maximum((way * way).sum(axis=1), 1e-30), 0, 1)
    return float(np.linalg.norm(chain[:-1] + share[:, None] * way - point, axis=1).min())


def off(pose: np.ndarray, position: np.ndarray, quaternion: np.ndarray) -> tuple[float, float]:
    turn = Rotation.from_matrix(pose[:3, :3]) * Rotation.from_quat(quaternion, scalar_first=True).inv()
    return float(np.abs(pose[:3, 3] - position).max()), float(np.degrees(turn.magnitude()))


@pytest.mark.parametrize(("controller", "robot"), CASES)
def test_read_back_the_program_is_the_path(made, cells, controller: str, robot: str) -> None:
    """Its targets lie where forward kinematics of the postures puts the tool that it declares."""
    moves, cell = made[robot], cells[robot]
    program = back(moves, cell, controller, files(moves, cell, controller))
    first = program.moves[0]
    assert program.dialect == controller
    assert first.kind == "J"
    assert np.degrees(np.abs(first.joints - moves.postures.joints[0])).max() < 0.0006
    if controller == "trajectory":
        rows_are_the_path(moves, cell, program)
        return
    others, seen = program.moves[1 - len(moves.layer) :], job_of(moves, cell).moves  # RAPID goes to the first target
    assert len(others) == len(moves.layer) - 1
    declared = program.tools[first.tool]
    if declared.flange_from_tool is not None:
        assert np.abs(declared.flange_from_tool - moves.flange_from_point).max() < 1e-3
    named = controller == "yaskawa"  # whose jobs say the cutter's tip
    tool_pose = cell.flange_from_cutter if named else moves.flange_from_point
    for i, move in enumerate(others, 1):
        far, turned = off(move.pose, seen.position_mm[i], seen.quaternion_wxyz[i])
        assert far < 0.001
        assert turned < 0.002
        stands = forward_kinematics(cell.chain, moves.postures.joints[moves.point[i]]) @ tool_pose
        assert np.abs(stands[:3, 3] - move.pose[:3, 3]).max() < 0.001
        assert (move.kind == "C") == moves.circular[i]
        if move.kind == "C":
            assert np.abs(move.via[:3, 3] - seen.via_position_mm[i]).max() < 0.001
        assert 0.9 * moves.feed_mm_s[i] < move.feed_mm_s < 1.006 * moves.feed_mm_s[i]
        assert move.turntable == pytest.approx(0.0, abs=1e-9)
    assert others[-1].zone_mm == 0
    assert [move.line for move in program.moves] == sorted({move.line for move in program.moves})
    if controller in ("abb", "kuka", "ur"):
        assert any(move.zone_mm > 0 for move in others)
    if declared.mass_kg is not None:  # TP has its loads on the controller
        assert declared.mass_kg == 15
        assert declared.centre_of_gravity_mm == pytest.approx((1, 2, 150))


def rows_are_the_path(moves: Moves, cell: Cell, program: Any) -> None:
    """A trajectory passes every posture, on chords between them, no faster than the path."""
    at = forward_kinematics(cell.chain, np.array([m.joints for m in program.moves])) @ moves.flange_from_point
    wanted = moves.postures.position_mm
    assert max(np.linalg.norm(at[:, :3, 3] - p, axis=1).min() for p in wanted) < 1e-3
    assert max(off_way(wanted, p) for p in at[:, :3, 3]) < 1e-3
    times = np.array([m.time_s for m in program.moves])
    way = np.linalg.norm(np.diff(at[:, :3, 3], axis=0), axis=1)
    assert (way / np.diff(times) < 20.001).all()
    assert times[-1] == pytest.approx(moves.toolpath.time_s, rel=0.01)


@pytest.mark.parametrize(
    ("controller", "robot", "option", "word", "zones"),
    [
        ("fanuc", "m20ia", {"acceleration_s": 0.02}, "CNT100", (0.0, 0.01)),
        ("yaskawa", "gp25", {"position_levels_mm": [0.1, 0.25, 0.5]}, "PL=2", (0.25, 0.0)),
    ],
)
def test_no_stop_where_the_cell_says_what_rounds(made, tmp_path, controller, robot, option, word, zones):
    """The feed for half of 0.02 s; of the levels the largest within 0.3 mm."""
    moves = made[robot]
    plain = cell_of(robot, tmp_path, TOOLS.get(robot), dialect=controller)
    told = cell_of(robot, tmp_path, TOOLS.get(robot), dialect=controller, **option)
    stopping = back(moves, plain, controller, files(moves, plain, controller))
    written = files(moves, told, controller)
    going = back(moves, told, controller, written)
    flying = [move for move in going.moves if move.zone_mm]
    assert word in "".join(written.values())
    assert [move.zone_mm for move in flying] == pytest.approx([zones[0] + zones[1] * one.feed_mm_s for one in flying])
    assert len(flying) > len(going.moves) / 3
    assert not any(move.zone_mm for move in stopping.moves)
    with pytest.raises(InputError, match="CNT rounds" if controller == "fanuc" else "position_levels_mm"):
        back(moves, plain, controller, written)


def test_kuka_says_status_and_turn_as_the_controller_counts_them(cells) -> None:
    """Home of a KUKA is S 2; A5 below zero sets bit 2; T has the signs (real data lists have S 2,T 35 and S 6,T 27)."""
    cell = cells["kr210"]
    dialect = dialect_of(postured(cell, "kr210", Shape(length_mm=10)), cell, "kuka")
    home = np.radians([0, -90, 90, 0, 10, 0])
    assert dialect.configuration(home, cell) == (2, 2)
    assert dialect.configuration(np.radians([-5, -90, 90, 5, 10, -5]), cell) == (2, 35)
    assert dialect.configuration(np.radians([-5, -90, 90, -5, -10, 5]), cell) == (6, 27)
    assert dialect.configuration(np.radians([0, -90, -90, 0, 10, 0]), cell)[0] & 2 == 0  # elbow down
    assert dialect.configuration(np.radians([0, -130, 40, 0, 10, 0]), cell)[0] & 1 == 1  # over the back


def test_fanuc_says_the_configuration_and_the_level_joint(cells) -> None:
    cell = cells["m20ia"]
    dialect = dialect_of(postured(cell, "m20ia", Shape(length_mm=10)), cell, "fanuc")
    assert dialect.configuration(np.radians([0, 0, 0, 0, -90, 0]), cell) == (0, 0, 0, 0, 0, 0)  # N U T, 0, 0, 0
    assert dialect.configuration(np.radians([0, 0, 0, 0, 90, 200]), cell) == (1, 0, 0, 0, 0, 1)
    assert dialect.configuration(np.radians([0, 20, -150, 0, -90, -200]), cell)[1] == 1
    moves = postured(cell, "m20ia", Shape(length_mm=10))
    text = files(moves, cell, "fanuc")["BEVELPATH.ls"]
    joints = np.degrees(moves.postures.joints[0])
    assert f"J3= {joints[2] - joints[1]:.3f} deg" in text  # against the ground: the forearm's slope


@settings(max_examples=8, deadline=None, derandomize=True, suppress_health_check=list(HealthCheck))
@given(
    case=st.sampled_from(CASES),
    bend=st.sampled_from([0.0, 1 / 150, -1 / 400]),
    length=st.integers(20, 70),
    zone=st.sampled_from([0.0, 0.3, 2.0]),
    turned=st.sampled_from([0.0, 0.4]),
    layers=st.integers(1, 2),
)
def test_any_path_comes_back(cells, case, bend, length, zone, turned, layers) -> None:
    controller, robot = case
    cell = cells[robot]
    moves = postured(cell, robot, Shape(bend=bend, length_mm=length, layers=layers), turned)
    if controller in ("ur", "yaskawa") and turned:
        with pytest.raises(InputError, match="expected a turntable that stands: along this path it turns by 22"):
            files(moves, cell, controller, zone_mm=zone)
        return
    program = back(moves, cell, controller, files(moves, cell, controller, zone_mm=zone))
    table, seen = moves.postures.turntable[moves.point], job_of(moves, cell).moves
    if controller == "trajectory":
        assert [m.turntable for m in program.moves][-1] == pytest.approx(turned, abs=1e-6)
        return
    for i, move in enumerate(program.moves[1 - len(moves.layer) :], 1):
        assert np.abs(move.pose[:3, 3] - seen.position_mm[i]).max() < 0.001
        assert move.turntable == pytest.approx(table[i], abs=1e-5)
        assert move.zone_mm in (0.0, zone) or (controller == "ur" and move.zone_mm < zone)


def test_a_position_of_a_fanuc_program_stands_once(made, cells) -> None:
    moves, cell = made["m20ia"], cells["m20ia"]
    written = files(moves, cell, "fanuc")
    name, text = next((name, text) for name, text in written.items() if "P[3]{" in text)
    first, last = text.index("P[3]{"), text.index("P[4]{")
    with pytest.raises(InputError, match="expected a position that is not there yet"):
        back(moves, cell, "fanuc", written | {name: text[:last] + text[first:last] + text[last:]})


NAMED = {
    "abb": ("tSpindle", "woTable"),
    "kuka": ("TOOL_DATA[3]", "BASE_DATA[2]"),
    "fanuc": ("UTOOL[3]", "UFRAME[2]"),
    "yaskawa": ("TOOL[3]", "USER[2]"),
}


@pytest.mark.parametrize(("controller", "robot"), [("abb", "irb6700"), *CASES[:2], CASES[4]])
def test_the_controllers_own_tool_and_frame(tmp_path: Path, controller: str, robot: str) -> None:
    """By their names: targets are then the cutter's tip's, in that frame."""
    tool, place = NAMED[controller]
    cell = cell_of(robot, tmp_path, tool, place, dialect=controller, corner_region=True)
    moves = postured(cell, robot, Shape(length_mm=30))
    written = files(moves, cell, controller, zone_mm=2.5)
    program = back(moves, cell, controller, written)
    assert (program.moves[0].tool, program.moves[0].work_object) == (tool, place)
    assert program.tools[tool].flange_from_tool is None
    assert program.work_objects[place] is None
    assert any(move.zone_mm == (2.0 if controller == "fanuc" else 2.5) for move in program.moves)
    for i, move in enumerate(program.moves[1 - len(moves.layer) :], 1):
        tip = forward_kinematics(cell.chain, moves.postures.joints[moves.point[i]]) @ cell.flange_from_cutter
        assert np.abs(tip[:3, 3] - [900, 100, 50] - move.pose[:3, 3]).max() < 0.001
    if controller == "abb":  # any name is one
        return
    other = cell_of(robot, tmp_path, "tMill", dialect=controller)
    with pytest.raises(InputError, match=rf"expected {tool[:-3]}\[n\] for (?i:{controller}), found 'tMill'"):
        files(moves, other, controller)


@pytest.mark.parametrize(("controller", "robot"), [case for case in CASES if case[1] != "irb6700"])
def test_a_written_program_is_judged(made, cells, controller: str, robot: str) -> None:
    """As written: driven through its cell, near the path's own points."""
    cell, moves = cells[robot], made[robot]
    *documents, gate, judgement, _ = write(moves, passed(moves.toolpath), cell, controller=controller)
    assert judgement.passed, judgement.violations[:3]
    assert gate.passed
    assert judgement.deviation_mm < 0.05
    assert len(documents) > 1


@pytest.mark.parametrize("controller", ["kuka", "ur"])
def test_another_makers_robot_gets_no_program(made, cells, controller: str) -> None:
    record, gate, judgement, _ = write(
        made["irb6700"], passed(made["irb6700"].toolpath), cells["irb6700"], controller=controller
    )
    assert record.name == "program_check.json"
    assert not gate.passed
    assert [one.kind for one in judgement.violations] == ["frame"]


def test_a_program_asked_for_without_a_cell_is_missed_and_a_cell_without_a_controller_refused(made, cells) -> None:
    one = made["irb6700"]
    (gate,) = write(replace(one, postures=None), replace(passed(one.toolpath), reached=False), controller="kuka")
    assert (gate.passed, gate.clean) == (True, False)
    with pytest.raises(InputError, match=r"\$\.controller: expected the make of the robot's controller"):
        write(one, passed(one.toolpath), cells["irb6700"])


EDITS = {
    "kuka": [
        ("LIN XP3", "LIN XP999"),
        ("  LIN XP3", "  SLIN XP3"),
        ("$VEL.CP=0.02", "$VEL.CP=fast"),
        ("  PTP XSTART", "  LIN XP2"),
        ("$BASE={", "$BASE=WORLD;{"),
        ("END\n", ""),
        (",E1 0.0", ",E1 0.0,E2 1.0"),
        ("$ORI_TYPE=#VAR", "$ORI_TYPE=#CONSTANT"),
        ("DECL E6POS XP3", "DECL E6POS XP2"),
        ("ENDDAT", ""),
    ],
    "fanuc": [
        ("  10:", "  11:"),
        ("FINE", "CNT100"),
        ("L P[3]", "L P[900]"),
        ("UTOOL_NUM=9", "UTOOL_NUM=2"),
        ("LINE_COUNT = ", "LINE_COUNT = 1"),
        ("CONFIG : 'N", "CONFIG : 'X"),
        ("mm/sec", "cm/min"),
        ("/END", ""),
        ("DEFAULT_GROUP = 1,1", "DEFAULT_GROUP = 1,*"),
        ("20% FINE", "200% FINE"),
        ("W = ", "V = "),
    ],
    "ur": [
        ("movel(p[", "movep(p["),
        ("mode=0", "mode=1"),
        ("v=0.35", "v=35"),
        ("set_tcp", "set_tool"),
        ("movej([", "movej(p["),
        ("\nend\n", "\nmovel()\nend\n"),
        ("blocking=True", "blocking=False"),
        ("a=0.5, v=0.02", "a=0.5, v=-0.02"),
    ],
    "yaskawa": [
        ("C00003=", "C00004="),
        ("MOVL C00004", "MOVL C09000"),
        ("///NPOS ", "///NPOS 1"),
        ("///RCONF ", "///RCONF 2"),
        ("///RECTAN", "///PULSE"),
        ("///TOOL 3", "///TOOL tMill"),
        ("SC,RW,RJ", "SC,RW"),
        ("///FRAME ROBOT", "///FRAME USER 1"),
        ("V=20.0 PL=0", "V=20.0 PL=3"),
        ("V=20.0", "VE=20.0"),
        ("VJ=20.00", "VJ=120.00"),
        (" FPT", ""),
        ("MOVC C00004", "MOVC C00003"),
        ("MOVC C00005 V=1.0", "MOVC C00005 V=2.0"),
        ("MOVJ", "MOVL"),
        ("PAUSE", "RET"),
        ("END", "RET"),
    ],
    "trajectory": [("time_s,", "time,"), ("\n0.0,", "\n1.0,"), (",0\n", ",x\n")],
}


@pytest.mark.parametrize(("controller", "robot"), CASES[:5])
def test_what_is_no_such_program_is_refused_with_its_line(made, cells, controller: str, robot: str) -> None:
    moves, cell = made[robot], cells[robot]
    written = files(moves, cell, controller)
    back(moves, cell, controller, written)
    for old, new in EDITS[controller]:
        changed = {name: text.replace(old, new, 1) for name, text in written.items()}
        assert changed != written, old
        with pytest.raises(InputError):
            back(moves, cell, controller, changed)
    with pytest.raises(InputError):
        back(moves, cell, controller, {})


def krl_findings(folder: Path, written: dict[str, str]) -> set[str]:
    """What krllint, a checker of KRL that others wrote, finds; its own width of indentation aside."""
    for name, text in written.items():
        (folder / name).write_text(text)
    ran = subprocess.run([sys.executable, "-m", "krllint", folder], capture_output=True, text=True, check=True)
    return {code for code in re.findall(r"\[([a-z-]+)\]", ran.stdout) if code != "bad-indentation"}


def test_a_foreign_checker_finds_nothing_in_krl(made, cells, tmp_path: Path) -> None:
    written = files(made["kr210"], cells["kr210"], "kuka")
    assert krl_findings(tmp_path, written) == set()
    assert krl_findings(tmp_path, {name: text.replace("LIN ", "lin ") for name, text in written.items()})


def test_blends_never_overlap_on_a_ur(made, cells) -> None:
    """A controller would leave a move out: the reader refuses such a script, the writer makes none."""
    moves, cell = made["irb6700"], cells["irb6700"]
    written = files(moves, cell, "ur", zone_mm=50)
    back(moves, cell, "ur", written)
    wide = {name: text.replace("r=0.000", "r=0.050") for name, text in written.items()}
    with pytest.raises(InputError, match="blends that do not overlap"):
        back(moves, cell, "ur", wide)


@settings(max_examples=80, deadline=None, derandomize=True, suppress_health_check=list(HealthCheck))
@given(data=st.data(), case=st.sampled_from([*CASES[:5], CASES[7]]))
def test_damaged_programs_end_in_one_line(made, cells, data: Any, case: tuple[str, str]) -> None:
    """Any cut or changed character: the program as it was meant, or a refusal; never another exception."""
    controller, robot = case
    moves, cell = made[robot], cells[robot]
    written = files(moves, cell, controller)
    name = data.draw(st.sampled_from(sorted(written)))
    at = data.draw(st.integers(0, len(written[name]) - 1))
    piece = data.draw(st.text(alphabet=st.characters(codec="ascii"), max_size=3))
    gone = data.draw(st.integers(0, 4))
    changed = {**written, name: written[name][:at] + piece + written[name][at + gone :]}
    try:
        back(moves, cell, controller, changed)
    except InputError as error:
        said = str(error)
    else:
        said = ""
    assert "\n" not in said


def test_without_a_turntable_no_external_axis_is_moved(tmp_path: Path) -> None:
    for controller, robot in (*CASES[4:5], *CASES[7:], ("kuka", "kr210"), ("fanuc", "m20ia"), ("ur", "ur10e")):
        cell = replace(cell_of(robot, tmp_path, TOOLS.get(robot), dialect=controller), turntable=None)
        moves = postured(cell, robot, Shape(length_mm=20))
        written = files(moves, cell, controller)
        assert {move.turntable for move in back(moves, cell, controller, written).moves} == {None}
        assert not any("E1" in text or "GP2" in text or "popup" in text or "MSG" in text for text in written.values())


def test_a_job_says_the_angles_of_its_first_position(made, cells) -> None:
    """By which an operator tells the branch on the pendant, before anything moves."""
    moves, cell = made["gp25"], cells["gp25"]
    head = files(moves, cell, "yaskawa")["BEVELPATH.JBI"].partition("MOVJ")[0]
    said = " ".join("".join(head.split("\r\n'")).split())
    angles = np.degrees(moves.postures.joints[0])
    told = [
        float(one)
        for one in re.search(r"S *(\S+) *L *(\S+) *U *(\S+) *R *(\S+) *B *(\S+) *T *(-?[0-9.]+)", said).groups()
    ]
    assert told == pytest.approx(angles, abs=0.051)


def test_another_configuration_is_another_posture(made, cells) -> None:
    """The wrist flipped at the first target: the job says another program, and no path of these postures."""
    moves, cell = made["gp25"], cells["gp25"]
    written = files(moves, cell, "yaskawa")
    flipped = {
        name: re.sub(r"///RCONF [01]", lambda said: f"///RCONF {1 - int(said[0][-1])}", text)
        for name, text in written.items()
    }
    first = back(moves, cell, "yaskawa", flipped).moves[0].joints
    assert np.degrees(np.abs(first - moves.postures.joints[0])).max() > 50


@pytest.mark.parametrize(
    ("controller", "robot", "tool", "place", "said"),
    [
        ("abb", "irb6700", "TOOL0", None, "tool.controller_name: .*no meaning in RAPID yet, found 'TOOL0'"),
        ("abb", "irb6700", "tSpindle", "wobj0", "work_object.controller_name: .*no meaning in RAPID yet"),
        ("abb", "irb6700", "MoveL", None, "tool.controller_name: .*no meaning in RAPID yet"),
        ("abb", "irb6700", "TOOL_DATA[3]", None, "tool.controller_name: .*letters, digits and _"),
        ("abb", "irb6700", "spindle", "Spindle", "expected four different names"),
        ("kuka", "kr210", "TOOL_DATA[0]", None, r"tool.controller_name: expected TOOL_DATA\[n\]"),
        ("fanuc", "m20ia", "UTOOL[1]", "UFRAME[0]", r"work_object.controller_name: expected UFRAME\[n\]"),
    ],
)
def test_a_name_that_is_something_else_on_the_controller_is_refused(
    made, tmp_path: Path, controller: str, robot: str, tool: str, place: str | None, said: str
) -> None:
    """With tool0 the flange would be driven to where the cutter belongs."""
    cell = cell_of(robot, tmp_path, tool=tool, place=place, dialect=controller)
    with pytest.raises(InputError, match=said):
        write(made[robot], passed(made[robot].toolpath), cell)


def test_a_job_for_yaskawa_names_its_tool(made, tmp_path: Path) -> None:
    cell = cell_of("gp25", tmp_path, dialect="yaskawa")
    with pytest.raises(
        InputError, match=r"tool.controller_name: expected TOOL\[n\], the number of the tool as measured"
    ):
        files(made["gp25"], cell, "yaskawa")


@pytest.mark.parametrize(
    ("controller", "robot", "feed", "said"),
    [
        ("yaskawa", "gp25", 0.05, "feeds of 0.1 to 1500 mm/s for Yaskawa, found 0.05"),
        ("yaskawa", "gp25", 1600.0, "feeds of 0.1 to 1500 mm/s for Yaskawa, found"),
        ("fanuc", "m20ia", 0.05, "feeds of 0.1 mm/s or more for FANUC, found 0.05"),
    ],
)
def test_a_feed_that_no_tag_says_is_refused(made, cells, controller: str, robot: str, feed: float, said: str) -> None:
    other = replace(made[robot], feed_mm_s=np.full(len(made[robot].layer), feed))
    with pytest.raises(InputError, match=f"expected {said}"):
        files(other, cells[robot], controller)
