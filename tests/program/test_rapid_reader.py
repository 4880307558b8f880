"""RAPID as moves: what the judge gets is what the file says, and what is not written so is refused in one line."""

from __future__ import annotations

import numpy as np
import pytest

from tests.work import calls_of
from workbench.artefacts import Moves
from workbench.errors import InputError
from workbench.program.rapid import Module
from workbench.robot import Cell

from .languages import text

UNUSED = "9E+09,9E+09,9E+09,9E+09"
MODULE = f"""! by hand
MODULE Hand
  ! a comment; MODULE
  PERS tooldata t:=[TRUE,[[0,0,100],[1,0,0,0]],[2,[0,0,50],[1,0,0,0],0,0,0]];
  TASK PERS wobjdata w:=[FALSE,TRUE,"",[[1,2,3],[1,0,0,0]],[[0,0,0],[1,0,0,0]]];
  CONST zonedata near:=[FALSE,2,2,2,0.2,2,0.2];
  CONST speeddata slow:=[2.5,50,5000,1000];
  CONST robtarget a:=[[1.5,-2,.5],[1,0,0,0],[0,-1,1,0],[9E+09,9E+09,{UNUSED}]];
  CONST robtarget b:=[[10,5,0],[0.7071068,0,0.7071068,0],[0,0,0,0],[30,9E+09,{UNUSED}]];
  CONST robtarget over:=[[5,6,0],[1,0,0,0],[0,0,0,0],[9E+09,9E+09,{UNUSED}]];
  CONST jointtarget home:=[[0,10,-20,0,5,0],[9E+09,9E+09,{UNUSED}]];
  PROC Run()
    ConfJ\\Off;
    ConfL\\On;
    CirPathMode\\ObjectFrame;
    VelSet 50,100;
    MoveAbsJ home\\NoEOffs,slow,fine,t\\WObj:=w;
    MoveL a,slow,near,t\\WObj:=wobj0;
    MoveC over,b,slow,fine,spindle\\WObj:=plate;
    CirPathMode\\PathFrame;
    ConfJ\\On;
  ENDPROC
ENDMODULE
"""


REFUSED = [
    ("MODULE Hand", "MODULE 1", "line 2: expected a name, found '1'"),
    ("MODULE Hand", "MODULE v100", "line 2: expected a name that is not taken, found 'v100'"),
    ("ENDMODULE\n", "", "found the end of the file"),
    ("ENDMODULE\n", "ENDMODULE x", "expected the end of the line, found 'x'"),
    ("robtarget b:", "robtarget A:", "line 9: expected a name that is not taken, found 'A'"),
    ("robtarget b:", "robtarget MoveL:", "line 9: expected a name that is not taken"),
    ("CONST robtarget b", "VAR robtarget b", "line 9: expected "),
    ("[10,5,0]", "[10,5]", "line 9: expected ',', found "),
    ("[10,5,0]", "[10,5,nan]", "line 9: expected a number, found 'nan"),
    ("[10,5,0]", "[10,5,1E39]", "line 9: expected numbers that single precision holds"),
    ("[10,5,0]", "[10,5,٣]", "line 9: expected a number"),
    ("0.7071068,0,0.7071068,0", "0.7071068,0,0.7171068,0", "quaternion of unit length, not 1.007"),
    ("0.7071068,0,0.7071068,0", "0,0,0,0", "line 9: expected a quaternion of unit length, not 0"),
    ("[30,9E+09,9E+09", "[30,9E+09,5", "line 9: expected no external axes but eax_a, and eax_b behind it"),
    ("tooldata t:=[TRUE", "tooldata t:=[FALSE", "line 4: expected ':=[TRUE,[['"),
    ("PROC Run()", "PROC Run(num n)", "line 12: expected '()', found '(num n)'"),
    ("ConfL\\On", "ConfL\\Off", "line 14: expected "),
    ("VelSet 50,100;", "VelSet 0,100;", "line 16: expected a number above 0"),
    ("VelSet 50,100;", "EXIT;", "line 16: expected a name and a use of the cell file's process section"),
    ("VelSet 50,100;", "a;", "line 16: expected a name that the controller knows and this module has not taken"),
    ("VelSet 50,100;", "MoveL a,slow,fine,t\\WObj:=w;", "line 16: expected a move to joint angles first"),
    ("MoveAbsJ home", "MoveAbsJ b", "line 17: expected a jointtarget, not a robtarget, found 'b'"),
    ("MoveL a", "MoveL home", "line 18: expected a robtarget, not a jointtarget, found 'home'"),
    ("MoveL a", "MoveL c", "line 18: expected the name of a robtarget that is declared, found 'c'"),
    ("slow,near", "slow,slow", "line 18: expected a zonedata, not a speeddata"),
    ("near,t", "near,w", "line 18: expected a tooldata, not a wobjdata"),
    ("near,t", "near,T", "line 18: expected 't', as it is declared, found 'T'"),
    ("MoveAbsJ home", "MoveAbsJ Home", "line 17: expected 'home', as it is declared, found 'Home'"),
    ("VelSet 50,100;", "A;", "line 16: expected a name that the controller knows and this module has not taken"),
    ("slow:=[2.5", "slow:=[0", "line 7: expected a number above 0"),
    ("near:=[FALSE,2", "near:=[FALSE,-2", "line 6: expected zones of 0 or more"),
    ("over,b,slow", "b,slow", "line 19: expected ',', found "),
    ("[[5,6,0]", "[[1.55,-2,.5]", "line 19: expected a circle"),
    ("[[5,6,0]", "[[5.75,1.5,.25]", "line 19: expected a circle"),
]


@pytest.mark.parametrize(("old", "new", "message"), REFUSED)
def test_what_is_refused_and_where(old: str, new: str, message: str) -> None:
    assert MODULE.count(old) >= 1
    with pytest.raises(InputError) as caught:
        Module().program({"hand.mod": MODULE.replace(old, new, 1)})
    assert str(caught.value).startswith("hand.mod: line ")
    assert message in str(caught.value)


def test_reading_twice_as_many_targets_is_twice_the_work(moves: Moves, irb6700: Cell) -> None:
    whole = text(moves, irb6700)
    move = next(line for line in whole.splitlines() if "MoveL p2," in line)

    def work(count: int) -> int:
        calls, program = calls_of(lambda: Module().program({"a.mod": whole.replace(move, "\n".join([move] * count))}))
        assert len(program.moves) > count
        return calls

    few, some, many = (work(count) for count in (500, 1500, 3500))
    assert many - some == pytest.approx(2 * (some - few), rel=0.01)


def test_all_that_it_says_becomes_moves() -> None:
    program = Module().program({"Hand.mod": MODULE})
    home, line, arc = program.moves
    assert [(move.kind, move.line) for move in program.moves] == [("J", 17), ("L", 18), ("C", 19)]
    assert np.allclose(np.degrees(home.joints), (0, 10, -20, 0, 5, 0))
    assert (home.turntable, home.tool, home.work_object) == (None, "t", "w")
    assert line.pose is not None
    assert np.allclose(line.pose, [[1, 0, 0, 1.5], [0, 1, 0, -2], [0, 0, 1, 0.5], [0, 0, 0, 1]])
    assert (line.configuration, line.zone_mm, line.feed_mm_s) == ((0, -1, 1, 0), 2, 1.25)
    assert arc.turntable == pytest.approx(np.radians(30))
    assert np.allclose(arc.via[:3, 3], (5, 6, 0))
    assert (program.tools["spindle"].flange_from_tool, program.work_objects["plate"]) == (None, None)
    assert np.allclose(program.work_objects["w"][:3, 3], (1, 2, 3))
    assert np.allclose(program.tools["t"].flange_from_tool[:3, 3], (0, 0, 100))
    assert program.tools["t"].mass_kg == 2
