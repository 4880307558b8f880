"""`program.write` for ABB: read back, the program is the path; and nothing out of a file can become a part of it."""

import re
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from workbench.artefacts import Moves, Part
from workbench.dialect import ProgramJob, write_program
from workbench.errors import InputError, PipelineError
from workbench.path import simplify
from workbench.program import write
from workbench.program.parameters import tool
from workbench.program.rapid import Rapid
from workbench.program.rapid_parser import parse_rapid
from workbench.program.rapid_program import RapidProgram

from .conftest import passed, rejected
from .paths import Shape, all_points, deviations, mill_path


def text(moves: Moves, **parameters: Any) -> str:
    (document,) = write(moves, passed(moves.toolpath), **parameters)
    return document.content.decode("ascii")


def angles_deg(a: Any, b: Any) -> Any:
    turns = Rotation.from_quat(a, scalar_first=True) * Rotation.from_quat(b, scalar_first=True).inv()
    return np.degrees(turns.magnitude())


def vias(program: RapidProgram) -> Any:
    return np.array([move.via.position_mm if move.via else [np.nan] * 3 for move in program.moves])


@pytest.mark.parametrize("tolerance", [0.0, 0.01])
def test_read_back_the_moves_are_the_same(tolerance: float) -> None:
    path = mill_path(Shape(bend=1 / 300, length_mm=300, lifted_mm=(120, 160)))
    moves = simplify(path, chord_tolerance_mm=tolerance, angle_tolerance_deg=5 * tolerance)
    program = parse_rapid(text(moves))
    position, quaternion = program.poses
    assert np.abs(position - moves.position_mm).max() < 0.001
    assert angles_deg(quaternion, moves.quaternion_wxyz).max() < 0.001
    assert np.nanmax(np.abs(vias(program) - moves.via_position_mm), initial=0) < 0.001
    assert [move.instruction == "MoveC" for move in program.moves] == moves.circular.tolist()
    assert any(moves.circular) == bool(tolerance)
    assert np.array([move.feed_mm_s for move in program.moves]) == pytest.approx(moves.feed_mm_s, rel=0.005)


@pytest.mark.parametrize("shape", [Shape(), Shape(bend=1 / 300), Shape(bend=-1 / 1000, wave_mm=0.01)], ids=str)
def test_a_controller_that_runs_it_passes_every_key_point(shape: Shape) -> None:
    path = mill_path(shape)
    program = parse_rapid(text(simplify(path)))
    points, quaternions, _ = all_points(path)
    new = np.append(True, np.linalg.norm(np.diff(points, axis=0), axis=1) > 1e-9)
    off_mm, off_deg = deviations(points[new], quaternions[new], *program.poses, vias(program))
    assert off_mm.max() < 0.01 + 0.001
    assert off_deg.max() < 0.05 + 0.001
    assert 10 * len(program.moves) <= len(points)


def test_tool_and_work_object(moves: Moves) -> None:
    """The flank of the cutter stands where the path's origin is, a radius from its axis towards the material."""
    turn = Rotation.from_rotvec([0.3, -0.5, 0.9])
    q, pose = turn.as_quat(scalar_first=True), np.eye(4)
    pose[:3, :3], pose[:3, 3] = Rotation.from_rotvec([0.1, 0.2, -2]).as_matrix(), [100, 200, 300]
    placed = replace(moves, toolpath=replace(moves.toolpath, base_from_workobject=pose))
    program = parse_rapid(
        text(placed, tool_position_mm=[10, 20, 350], tool_quaternion_wxyz=q.tolist(), tool_mass_kg=18.5,
             tool_centre_of_gravity_mm=[1, 2, 3], tool_name="tSpindle", work_object_name="woPlate", name="Left",
             procedure="Go")
    )  # fmt: skip
    data, frame = program.tools["tSpindle"], program.work_objects["woPlate"].user_frame
    assert data.held_by_robot
    assert data.frame.position_mm == pytest.approx(turn.apply([5, 0, 0]) + np.array([10, 20, 350]), abs=1e-4)
    assert data.frame.quaternion_wxyz == pytest.approx(q)
    assert (data.mass_kg, data.centre_of_gravity_mm) == (18.5, (1, 2, 3))
    assert frame.position_mm == (100, 200, 300)
    there = Rotation.from_quat(frame.quaternion_wxyz, scalar_first=True)
    assert np.abs(there.as_matrix() - pose[:3, :3]).max() < 1e-7
    assert program.work_objects["woPlate"].object_frame.position_mm == (0, 0, 0)
    assert {(move.tool, move.work_object) for move in program.moves} == {("tSpindle", "woPlate")}
    assert (program.module, list(program.procedures)) == ("Left", ["Go"])
    with pytest.raises(PipelineError, match="expected a quaternion w x y z of unit length, this one has 2"):
        write(moves, passed(moves.toolpath), tool_quaternion_wxyz=[2, 0, 0, 0])


def test_every_target_is_reached_at_the_ends_and_blended_between(moves: Moves) -> None:
    zones = [move.zone_mm for move in parse_rapid(text(moves, zone_mm=0.5)).moves]
    assert zones[0] == zones[-1] == 0
    same = [i for i in range(1, len(zones) - 1) if moves.layer[i - 1] == moves.layer[i] == moves.layer[i + 1] > 0]
    assert len(same) > 30
    assert {zones[i] for i in same} == {0.5}  # within a layer; sharp corners of travels are driven to their point
    assert set(zones) == {0.0, 0.5}
    assert {move.zone_mm for move in parse_rapid(text(moves, zone_mm=0)).moves} == {0}


def test_external_axes_are_unused_or_the_turntables(moves: Moves) -> None:
    assert {axis for move in parse_rapid(text(moves)).moves for axis in move.target.external_axes} == {9e9}
    spindle = tool((0, 0, 400), (1, 0, 0, 0), 15, (0, 0, 150))
    turning = np.linspace(-90, 90, len(moves.layer))
    job = ProgramJob("Turned", moves, spindle, 0.3, turntable_deg=turning)
    (document,) = write_program(Rapid(job, "Go", "tSpindle", "woPlate"), passed(moves.toolpath))
    program = parse_rapid(document.content.decode())
    assert [move.target.external_axes[0] for move in program.moves] == pytest.approx(turning, abs=1e-4)
    for k in np.flatnonzero(moves.circular):
        assert program.moves[k].via.external_axes[0] == pytest.approx((turning[k] + turning[k - 1]) / 2, abs=1e-4)
    assert program.moves[3].target.external_axes[1:] == (9e9,) * 5


def test_nothing_is_written_for_a_path_that_failed_its_checks(moves: Moves) -> None:
    assert write(moves, rejected(moves.toolpath)) == ()


@pytest.mark.parametrize(
    "name",
    ["", "1a", "a b", "a-b", "ä", "a\n", "a" * 33, "MODULE", "endproc", "MoveL", "robtarget", "tool0", "V100", "z10",
     "fine", "p1", "Via22", "feed3", "ZonePath", "a;", 'a"', "a!"],
)  # fmt: skip
@pytest.mark.parametrize("key", ["name", "procedure", "tool_name", "work_object_name"])
def test_a_name_that_rapid_does_not_allow_is_refused(moves: Moves, key: str, name: str) -> None:
    with pytest.raises(PipelineError, match=rf"program\.write\.{key}: expected a "):
        write(moves, passed(moves.toolpath), **{key: name})


def test_names_differ(moves: Moves) -> None:
    with pytest.raises(InputError, match="expected four different names"):
        write(moves, passed(moves.toolpath), tool_name="mill", work_object_name="MILL")


ATTACKS = [
    "x\nENDMODULE",
    "x\r  MoveL p1",
    "x\x0b! y",
    "x\u2028PERS",
    '"; STOP; "',
    "%%%",
    "ä\x00€",
    "a" * 500,
    "!",
    "",
]


@settings(max_examples=60, deadline=None, derandomize=True)
@given(part_id=st.sampled_from(ATTACKS) | st.text(), source=st.sampled_from(ATTACKS) | st.text())
def test_names_out_of_files_are_comments_and_nothing_else(moves: Moves, part_id: str, source: str) -> None:
    plain = text(moves).splitlines()
    named = replace(moves, toolpath=replace(moves.toolpath, part=Part(part_id=part_id), source=source))
    lines = text(named).splitlines()
    changed = [line for line, before in zip(lines, plain, strict=True) if line != before]
    assert len(changed) <= 2
    assert all(re.fullmatch(r"  ! (part|source): ?[A-Za-z0-9 _.,:+/()=?-]*", line) for line in changed)
    assert max(map(len, lines)) < 250


def test_moves_that_no_controller_could_take_are_refused(moves: Moves) -> None:
    hole = moves.position_mm.copy()
    hole[3, 1] = np.nan
    for broken in (replace(moves, position_mm=hole), replace(moves, feed_mm_s=0 * moves.feed_mm_s)):
        with pytest.raises(InputError, match="expected moves with finite targets and feeds above 0"):
            write(broken, passed(broken.toolpath))
        assert write(broken, rejected(broken.toolpath)) == ()


def test_the_text_is_what_abb_writes(moves: Moves) -> None:
    """Line by line, as the reference manual has it."""
    lines = text(moves).splitlines()
    for pattern in (
        r"MODULE BevelPath",
        r"  PERS tooldata tMill:=\[TRUE,\[\[5\.0000,0\.0000,400\.0000\],\[1\.0+,0\.0+,0\.0+,0\.0+\]\],"
        r"\[15,\[0\.0000,0\.0000,150\.0000\],\[1,0,0,0\],0,0,0\]\];",
        r'  TASK PERS wobjdata woEdge:=\[FALSE,TRUE,"",\[\[.*\]\],\[\[0,0,0\],\[1,0,0,0\]\]\];',
        r"  CONST zonedata zonePath:=\[FALSE,0\.3,0\.3,0\.3,0\.03,0\.3,0\.03\];",
        r"  CONST speeddata feed1:=\[1,50,5000,1000\];",
        r"  CONST robtarget p1:=\[\[(-?\d+\.\d{4},?){3}\],\[(-?[01]\.\d{8},?){4}\],\[0,0,0,0\],\[(9E\+09,?){6}\]\];",
        r"    ConfL\\Off;",
        r"    CirPathMode\\ObjectFrame;",
        r"    MoveJ p1,feed\d,fine,tMill\\WObj:=woEdge;",
        r"    MoveL p\d+,feed\d,zonePath,tMill\\WObj:=woEdge;",
        r"    MoveC via\d+,p\d+,feed1,zonePath,tMill\\WObj:=woEdge;",
        r"    ! layer 2",
        r"  ENDPROC",
        r"ENDMODULE",
    ):
        assert any(re.fullmatch(pattern, line) for line in lines), pattern
    assert "-0.0000," not in text(moves)
