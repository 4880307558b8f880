"""What the judge has against postures, for those who choose them: none is proposed from which no way leads."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator

import numpy as np

from workbench.artefacts import ProgramMove, ProgramMoves, ProgramTool
from workbench.robot.cell_model import Cell
from workbench.robot.judge import follows, judge
from workbench.robot.process import drawn_back, turntable_at_home
from workbench.robot.way import flange_among_targets
from workbench.units import DEG, Float, Shaped

Refusal = tuple[str, tuple[str, str] | None]  # kind of the violation, and the pair of bodies of a collision
TOOL = "cutter"  # any name


def refusal(
    cell: Cell, joints: Shaped[Float, "n 6"], table: Shaped[Float, "n ..."], feed_mm_s: Shaped[Float, " n"], cuts: int
) -> Refusal | None:
    """What the judge has against postures (n, 6), rad, between them and on the ways from home and back; None: nothing.

    Args:
        cell: with its margins; without a `process` the ways home are not looked at.
        joints: one after the other, which the robot goes to by its joints.
        table: of the external axes, rad.
        feed_mm_s: of the path at each.
        cuts: the first that cuts, above which the operator looks where the process has a `probe`.
    """
    for moves in _ways_home(cell, joints, table, feed_mm_s, cuts):
        if moves is None:
            return "unreachable", None
        judgement = judge(dataclasses.replace(cell, process=None), _program(cell, moves))
        if judgement.violations:
            kind = judgement.violations[0].kind
            return kind, judgement.clearance_pair if kind == "collision" else None
    return follows(cell, _program(cell, [_by_joints(*place) for place in zip(joints, table, strict=True)]))


def _ways_home(
    cell: Cell, joints: Float, table: Float, feed_mm_s: Float, cuts: int
) -> Iterator[list[ProgramMove] | None]:
    """From home to the first posture, and from the last one home; None: a point before or behind is out of reach."""
    process = cell.process
    if process is None:
        return
    at_home = turntable_at_home(process.home, table[0] / DEG) * DEG
    home = _by_joints(process.home.joints, at_home)
    begin = [] if process.probe is None else [(drawn_back(cell, joints[cuts], process.probe.distance_mm), table[cuts])]
    begin.append((drawn_back(cell, joints[0], process.approach_mm), table[0]))
    there = [_by_joints(off, angle) for off, angle in begin if off is not None]
    first = _straight(cell, joints[0], table[0], float(feed_mm_s[0]))
    yield [home, *there, first] if len(there) == len(begin) else None
    angle, feed = table[-1], float(feed_mm_s[-1])
    off = drawn_back(cell, joints[-1], process.retract_mm)
    yield None if off is None else [_by_joints(joints[-1], angle), _straight(cell, off, angle, feed), home]


def _by_joints(joints: Float, table: Float) -> ProgramMove:
    return ProgramMove(1, "J", TOOL, TOOL, joints=joints, turntable=table)


def _straight(cell: Cell, joints: Float, table: Float, feed_mm_s: float) -> ProgramMove:
    pose = flange_among_targets(cell, joints, table) @ cell.flange_from_cutter
    return ProgramMove(1, "L", TOOL, TOOL, pose=pose, feed_mm_s=feed_mm_s, turntable=table)


def _program(cell: Cell, moves: list[ProgramMove]) -> ProgramMoves:
    return ProgramMoves("postures", TOOL, tuple(moves), {TOOL: ProgramTool(cell.flange_from_cutter)}, {TOOL: np.eye(4)})
