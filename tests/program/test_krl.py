"""`program.krl`: what stands in the frames is the path."""

import re
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from workbench.artefacts import Moves, Part
from workbench.errors import PipelineError
from workbench.program import krl
from workbench.program.krl import euler_deg

from .conftest import passed, rejected

FRAME = r"\{X (\S+),Y (\S+),Z (\S+),A (\S+),B (\S+),C ([^\s}]+)\}"


def lines(moves: Moves, **parameters: object) -> list[str]:
    document = krl(moves, passed(moves.toolpath), **parameters)
    assert document is not None
    assert document.name == "BevelPath.src"
    return document.content.decode("ascii").splitlines()


def pose(numbers: tuple[str, ...]) -> tuple[np.ndarray, Rotation]:
    """As KUKA turns: A about Z, then B about the new Y, then C about the new X."""
    values = np.array([float(number) for number in numbers])
    return values[:3], Rotation.from_euler("ZYX", values[3:], degrees=True)


def test_frames_and_feeds_are_the_moves(moves: Moves) -> None:
    k, speed = 0, None
    for line in lines(moves):
        if found := re.fullmatch(r"  \$VEL\.CP=(\S+)", line):
            speed = float(found[1])
        if not line.startswith(("  LIN", "  CIRC")):
            continue
        *via, target = re.findall(FRAME, line)
        position, turn = pose(target)
        wanted = Rotation.from_quat(moves.quaternion_wxyz[k], scalar_first=True)
        assert np.abs(position - moves.position_mm[k]).max() < 0.001
        assert np.degrees((turn * wanted.inv()).magnitude()) < 0.001
        assert speed == pytest.approx(moves.feed_mm_s[k] / 1000, rel=0.005)
        assert bool(via) == line.startswith("  CIRC") == moves.circular[k]
        if via:
            assert np.abs(pose(via[0])[0] - moves.via_position_mm[k]).max() < 0.001
        if not 0 < k < len(moves.layer) - 1:
            assert not line.endswith(" C_DIS")
        elif moves.layer[k - 1] == moves.layer[k] == moves.layer[k + 1] > 0:  # corners of travels may be sharp
            assert line.endswith(" C_DIS")
        k += 1
    assert k == len(moves.layer)


def test_head_and_end(moves: Moves) -> None:
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = Rotation.from_euler("ZYX", [10, 20, 30], degrees=True).as_matrix(), [1, 2, 3]
    placed = replace(
        moves, toolpath=replace(moves.toolpath, base_from_workobject=matrix, part=Part(part_id="a\nEND\n;FOLD"))
    )
    program = lines(placed, zone_mm=0.5)
    assert program[:2] == ["&ACCESS RVP", "DEF BevelPath ( )"]
    assert program[-1] == "END"
    assert "  ; part: a?END??FOLD" in program
    for line in (
        "  BAS (#INITMOV,0)",
        "  $TOOL={X 5.0000,Y 0.0000,Z 400.0000,A 0.000000,B 0.000000,C 0.000000}",
        "  $BASE={X 1.0000,Y 2.0000,Z 3.0000,A 10.000000,B 20.000000,C 30.000000}",
        "  $CIRC_TYPE=#BASE",
        "  $APO.CDIS=0.5",
        "  PTP $AXIS_ACT",
    ):
        assert program.count(line) == 1
    assert not any("C_DIS" in line for line in lines(moves, zone_mm=0))


def test_turns_where_two_axes_are_one() -> None:
    turns = Rotation.from_euler("ZYX", [[30, 90, 0], [30, -90, 0], [-170, 90, 0], [0, 0, 180]], degrees=True)
    back = Rotation.from_euler("ZYX", euler_deg(turns.as_quat(scalar_first=True)), degrees=True)
    assert np.degrees((turns * back.inv()).magnitude()).max() < 1e-5


def test_nothing_is_written_for_a_path_that_failed_its_checks(moves: Moves) -> None:
    assert krl(moves, rejected(moves.toolpath)) is None


@pytest.mark.parametrize("name", ["", "1a", "a b", "a" * 25, "LIN", "end", "a\n", "ä"])
def test_a_name_that_krl_does_not_allow_is_refused(moves: Moves, name: str) -> None:
    with pytest.raises(PipelineError, match=r"program\.krl\.name: expected a letter"):
        krl(moves, passed(moves.toolpath), name=name)
