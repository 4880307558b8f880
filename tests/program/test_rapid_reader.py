"""RAPID as moves: what the judge gets is what the file says."""

import numpy as np
import pytest

from workbench.errors import InputError
from workbench.program.rapid_reader import read_rapid

from .test_rapid_parser import MODULE


def test_all_that_it_knows() -> None:
    program = read_rapid(MODULE, "Hand.mod")
    home, joint, arc, line = program.moves
    assert [move.kind for move in program.moves] == ["J", "J", "C", "L"]
    assert [move.line for move in program.moves] == [12, 13, 14, 15]
    assert home.joints is not None
    assert np.allclose(np.degrees(home.joints), (0, 10, -20, 0, 5, 0))
    assert (home.turntable, home.tool, home.work_object) == (None, "tool0", "wobj0")
    assert joint.pose is not None
    assert np.allclose(joint.pose, [[1, 0, 0, 1.5], [0, 1, 0, -2], [0, 0, 1, 0.5], [0, 0, 0, 1]])
    assert (joint.configuration, joint.zone_mm, joint.feed_mm_s) == ((0, -1, 1, 0), 10, 100)
    assert arc.turntable == pytest.approx(np.radians(30))
    assert arc.via is not None
    assert np.allclose(arc.via[:3, 3], (5, 6, 0))
    assert (arc.tool, arc.work_object) == ("t", "w")
    assert np.allclose(program.work_objects["w"][:3, 3], (1, 2, 3))
    assert np.allclose(program.tools["t"].flange_from_tool[:3, 3], (0, 0, 100))
    assert program.tools["t"].mass_kg == 2
    assert (line.zone_mm, line.work_object) == (0, "wobj0")


@pytest.mark.parametrize(
    ("old", "new", "finding"),
    [
        ("[30,9E+09", "[30,5", "line 14: expected no external axis but eax_a"),
        ("tooldata t:=[TRUE", "tooldata t:=[FALSE", "'t' is stationary"),
        ("wobjdata w:=[FALSE", "wobjdata w:=[TRUE", "the robot holds 'w'"),
        (
            "PROC nothing()",
            "PROC nothing() MoveAbsJ home,v100,fine,tool0;",
            "expected one procedure that moves, found 2",
        ),
    ],
)
def test_what_cannot_be_judged_is_refused(old: str, new: str, finding: str) -> None:
    assert old in MODULE
    with pytest.raises(InputError, match=finding):
        read_rapid(MODULE.replace(old, new), "Hand.mod")
