"""`program.write` for ABB: what it declares and monitors; nothing out of a file can become a part of it."""

import re
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from workbench.api import inverse
from workbench.artefacts import Moves, Part
from workbench.errors import InputError, PipelineError
from workbench.program import write
from workbench.robot import Cell, inverse_kinematics

from .conftest import passed
from .languages import from_text, text


def test_a_tool_that_the_program_declares(moves: Moves, irb6700: Cell) -> None:
    """The flank of the cutter is the tool centre point: the path's own frame, with the load of the cell's file."""
    loaded = replace(irb6700, tool_mass_kg=18.5, tool_centre_of_gravity_mm=np.array([1.0, 2, 3]))
    written = text(moves, loaded, names=("Left", "Go", "tSpindle", "woPlate"))
    program = from_text(written, moves, loaded)
    data = program.tools["tSpindle"]
    assert data.flange_from_tool == pytest.approx(moves.flange_from_point, abs=1e-4)
    assert np.abs(data.flange_from_tool - moves.flange_from_point)[:3, :3].max() < 1e-7
    assert (data.mass_kg, tuple(data.centre_of_gravity_mm)) == (18.5, (1, 2, 3))
    assert {(move.tool, move.work_object) for move in program.moves} == {("tSpindle", "woPlate")}
    assert written.startswith("MODULE Left\n")
    assert re.findall(r"PROC (\w+)\(", written) == ["Go"]
    assert (
        from_text(text(moves, irb6700), moves, irb6700).tools["tMill"].mass_kg == 0.001
    )  # a load that nobody stated, as ABB's tool0


def test_configurations_are_monitored_those_on_arcs_too(moves: Moves, irb6700: Cell) -> None:
    """A restart in another branch is stopped by the controller, so what a via point says must be the robot's there."""
    written = text(moves, irb6700)
    assert "ConfL\\On;" in written
    assert "ConfL\\Off" not in written
    program = from_text(written, moves, irb6700)
    from_tool = inverse(program.tools["tMill"].flange_from_tool)
    said = dict(re.findall(r"robtarget via(\d+):=\[\[.*?\],\[.*?\],\[(.*?)\]", written))
    arcs = [i for i, move in enumerate(program.moves[1:]) if move.via is not None]
    assert len(arcs) > 3
    for i in arcs:
        branches = inverse_kinematics(irb6700.chain, program.moves[1 + i].via @ from_tool)
        there = moves.joints_deg[i]
        near = np.degrees(branches)
        near += 360 * np.round((there - near) / 360)
        q = near[np.nanargmin(np.abs(near - there).max(axis=1))]
        assert [int(one) for one in said[str(i + 1)].split(",")[:3]] == np.floor(q[[0, 3, 5]] / 90).tolist()


BAD_NAMES = [
    *("", "a b", "a\n", "a" * 33, "1a", "a-b", "ä", "a;", "a!", 'a"'),
    *("MODULE", "endproc", "MoveL", "robtarget", "tool0", "V100", "z10", "fine"),
    *("p1", "Via22", "feed3", "ZonePath"),
]


@pytest.mark.parametrize("name", BAD_NAMES)
@pytest.mark.parametrize("key", ["name", "procedure", "tool_name", "work_object_name"])
def test_a_name_that_rapid_does_not_allow_is_refused(moves: Moves, irb6700: Cell, key: str, name: str) -> None:
    with pytest.raises(PipelineError, match=rf"program\.write\.{key}: expected a "):
        write(moves, passed(moves.toolpath), irb6700, **{key: name})


def test_names_differ(moves: Moves, irb6700: Cell) -> None:
    with pytest.raises(InputError, match="expected four different names"):
        write(moves, passed(moves.toolpath), irb6700, tool_name="mill", work_object_name="MILL")


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


@settings(max_examples=25, deadline=None, derandomize=True)
@given(part_id=st.sampled_from(ATTACKS) | st.text(), source=st.sampled_from(ATTACKS) | st.text())
def test_names_out_of_files_are_comments_and_nothing_else(moves, irb6700, part_id, source):
    plain = text(moves, irb6700).splitlines()
    named = replace(moves, toolpath=replace(moves.toolpath, part=Part(part_id=part_id), source=source))
    lines = text(named, irb6700).splitlines()
    changed = [line for line, before in zip(lines, plain, strict=True) if line != before]
    assert len(changed) <= 2
    assert all(re.fullmatch(r"  ! (part|source): ?[A-Za-z0-9 _.,:+/()=?-]*", line) for line in changed)
    assert max(map(len, lines)) < 250


def test_moves_that_no_controller_could_take_are_refused(moves: Moves, irb6700: Cell) -> None:
    hole = moves.position_mm.copy()
    hole[3, 1] = np.nan
    for broken in (replace(moves, position_mm=hole), replace(moves, feed_mm_s=0 * moves.feed_mm_s)):
        with pytest.raises(InputError, match="expected moves with finite targets and feeds above 0"):
            text(broken, irb6700)
