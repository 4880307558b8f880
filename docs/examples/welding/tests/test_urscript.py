"""`program.urscript`: a robot that does what the program says goes along the moves."""

import re
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from workbench_welding.urscript import urscript

from workbench.api import InputError, PipelineError

POSE = re.compile(r"p\[([^]]+)\]")
HOW = re.compile(r"a=(\S+), v=(\S+), r=([^,)]+)(, mode=0)?\)$")


def pose(numbers):
    """p[x, y, z, rx, ry, rz] as the controller reads it: mm here, and an axis times its angle in rad."""
    values = np.array([float(number) for number in numbers.split(",")])
    return values[:3] * 1000, Rotation.from_rotvec(values[3:])


def program(moves, gate, **parameters):
    (document,) = urscript(moves, gate, **parameters)
    assert document.name == "BevelPath.script"
    return document.content.decode("ascii").splitlines()


def test_the_program_goes_along_the_moves(moves, passed):
    lines = program(moves, passed)
    (work_object,) = [POSE.search(line)[1] for line in lines if line.startswith("  work_object = ")]
    origin_mm, placed = pose(work_object)
    base_from_workobject = moves.toolpath.base_from_workobject
    assert np.abs(origin_mm - base_from_workobject[:3, 3]).max() < 1e-4
    assert np.abs(placed.as_matrix() - base_from_workobject[:3, :3]).max() < 1e-8
    runs = [line for line in lines if line.startswith("  move")]
    assert len(runs) == len(moves.layer)
    for k, line in enumerate(runs):
        *via, (position_mm, turn) = [pose(numbers) for numbers in POSE.findall(line)]
        assert line.count("pose_trans(work_object, p[") == len(via) + 1
        assert np.abs(position_mm - moves.position_mm[k]).max() < 1e-4
        wanted = Rotation.from_quat(moves.quaternion_wxyz[k], scalar_first=True)
        assert (turn * wanted.inv()).magnitude() < 1e-7
        assert bool(via) == line.startswith("  movec") == moves.circular[k]
        if via:
            assert np.abs(via[0][0] - moves.via_position_mm[k]).max() < 1e-4


def test_speeds_accelerations_and_blends(moves, passed):
    lines = program(moves, passed, acceleration_mm_s2=250.0, zone_mm=0.4)
    how = [HOW.search(line) for line in lines if line.startswith("  move")]
    assert [float(found[2]) for found in how] == pytest.approx(moves.feed_mm_s / 1000)
    assert {float(found[1]) for found in how} == {0.25}
    assert [float(found[3]) for found in how] == [0, *[0.0004] * 4, 0]  # the first and the last target are reached
    assert [bool(found[4]) for found in how] == moves.circular.tolist()


def test_tool_and_remarks(moves, passed):
    lines = program(moves, passed, tool_position_mm=[1, 2, 300], tool_mass_kg=7)
    assert "  set_tcp(p[0.006, 0.002, 0.3, 0, 0, 0])" in lines  # on the flank: half the cutter's 10 mm along x
    assert "  set_payload(7, [0.000000, 0.000000, 0.150000])" in lines
    assert "  # part: a?end???" in lines
    assert lines[0] == "def BevelPath():"
    assert lines[-2:] == ["end", "BevelPath()"]
    assert [line.strip() for line in lines].count("end") == 1


def test_no_program_of_a_rejected_path_and_none_with_a_bad_name(moves, passed):
    assert urscript(moves, replace(passed, passed=False)) == ()
    for name in ("end", "a b", "1a", "x():\nmovej"):
        with pytest.raises(PipelineError, match="no word of URScript"):
            urscript(moves, passed, name=name)


def test_postures_are_refused(moves, passed, postures):
    with pytest.raises(InputError, match="without postures"):
        urscript(replace(moves, postures=postures), passed)
