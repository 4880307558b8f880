"""Joint moves whose time the program says: speeds and accelerations by hand, from the rows alone."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from workbench.artefacts import Judgement, ProgramMove, ProgramMoves
from workbench.robot import Cell
from workbench.robot.judge import judge

from .programs import START, program


def rows(cell: Cell, *steps: tuple[float, int, float], turntable: float = 0.0) -> ProgramMoves:
    """From START on, lines from 2: seconds, which joint, by how many deg."""
    at, time, moves = START.copy(), 0.0, []
    for line, (seconds, joint, by) in enumerate(steps, 2):
        at, time = at.copy(), time + seconds
        at[joint - 1] += np.radians(by)
        moves.append(ProgramMove(line, "J", "t", "base", joints=at, turntable=turntable, time_s=time))
    made = program(cell, *moves, turntable=0.0)
    return dataclasses.replace(made, moves=(dataclasses.replace(made.moves[0], time_s=0.0), *made.moves[1:]))


def told(found: Judgement) -> list[tuple[int, str, str]]:
    return [(one.line, one.kind, one.finding) for one in found.violations]


def test_a_joints_speed_is_that_of_its_rows(cell: Cell) -> None:
    most = np.degrees(cell.chain.speeds[2])
    found = judge(cell, rows(cell, (1.0, 3, 2.0), (2.0 / most / 1.25, 3, 2.0), (1.0, 3, -4.0)))
    assert told(found) == [(3, "speed", "joint 3 would need 1.25 times its largest speed")]
    assert found.speed_share == pytest.approx(1.25)
    assert found.time_s == pytest.approx(2 + 2.0 / most / 1.25)
    assert judge(cell, rows(cell, (1.0, 3, 2.0), (2.0 / most, 3, 2.0), (1.0, 3, -4.0))).passed


def test_the_turntable_counts(cell: Cell) -> None:
    seconds = 0.3 / cell.turntable.speed / 2
    found = judge(cell, rows(cell, (seconds, 1, 0.0), turntable=0.3))
    assert told(found) == [(2, "speed", "the turntable would need 2.00 times its largest speed")]


@pytest.mark.parametrize(
    ("steps", "line", "asked"),
    [
        (((1.0, 4, 5.0), (10.0, 4, 0.0)), 2, 10.0),  # 5 deg/s half a second behind the standstill
        (((1.0, 4, 1.0), (0.5, 4, 5.0), (1.0, 4, 1.0)), 3, 18.0),  # from 1 to 10 deg/s in the shorter step
        (((2.0, 4, 4.0), (1.0, 4, -2.0), (2.0, 4, -2.0)), 3, 4.0),  # turns round: 2 to -2 deg/s
        (((10.0, 4, 1.0), (1.0, 4, 3.0)), 3, 6.0),  # stops at the last row
    ],
)
def test_accelerations_across_rows(cell, steps, line, asked):
    slack, tight = (dataclasses.replace(cell, accelerations=np.radians(np.full(6, a))) for a in (asked, asked / 1.5))
    assert judge(slack, rows(cell, *steps)).passed
    finding = "joint 4 would need 1.50 times its largest acceleration"
    assert told(judge(tight, rows(cell, *steps))) == [(line, "acceleration", finding)]
    assert judge(cell, rows(cell, *steps)).passed  # none is stated


def test_the_turntables_acceleration_counts_like_a_joints(cell: Cell) -> None:
    """From 1 to 10 deg/s in half a second: 18 deg/s^2; a cell that states none of its joints judges it all the same."""
    still = rows(cell, (1.0, 1, 0.0), (0.5, 1, 0.0), (1.0, 1, 0.0))
    turned = zip(still.moves, np.radians([0.0, 1.0, 6.0, 7.0]).tolist(), strict=True)
    moves = dataclasses.replace(still, moves=tuple(dataclasses.replace(one, turntable=at) for one, at in turned))
    assert cell.turntable is not None
    slack, tight = (
        dataclasses.replace(cell, turntable=dataclasses.replace(cell.turntable, acceleration=np.radians(most)))
        for most in (18.0, 12.0)
    )
    assert judge(slack, moves).passed
    finding = "the turntable would need 1.50 times its largest acceleration"
    assert told(judge(tight, moves)) == [(3, "acceleration", finding)]
    assert judge(cell, moves).passed  # none is stated


@pytest.mark.parametrize("time", [1.0, 0.5, float("inf"), float("nan")])
def test_times_must_rise(cell: Cell, time: float) -> None:
    made = rows(cell, (1.0, 3, 2.0), (1.0, 3, 2.0))
    last = dataclasses.replace(made.moves[2], time_s=time)
    found = judge(cell, dataclasses.replace(made, moves=(*made.moves[:2], last)))
    assert told(found) == [(3, "way", "expected joint angles at a time behind that of the move before")]


def test_joint_moves_without_times_go_at_the_controllers_own_speed(cell: Cell) -> None:
    quick = dataclasses.replace(cell, accelerations=np.full(6, 0.01))
    made = rows(cell, (1e-3, 3, 2.0), (1e-3, 3, 2.0))
    untimed = tuple(dataclasses.replace(move, time_s=None) for move in made.moves)
    assert judge(quick, dataclasses.replace(made, moves=untimed)).passed


def test_where_untimed_moves_follow_the_robot_stands(cell: Cell) -> None:
    """From 2 deg/s to 5 deg/s within a second, and from there to the standstill within half a second."""
    made = rows(cell, (1.0, 4, 2.0), (1.0, 4, 5.0), (1.0, 4, 3.0))
    moves = dataclasses.replace(made, moves=(*made.moves[:3], dataclasses.replace(made.moves[3], time_s=None)))
    slack, tight = (dataclasses.replace(cell, accelerations=np.radians(np.full(6, a))) for a in (10.0, 10.0 / 1.5))
    assert judge(slack, moves).passed
    assert told(judge(tight, moves)) == [(3, "acceleration", "joint 4 would need 1.50 times its largest acceleration")]
