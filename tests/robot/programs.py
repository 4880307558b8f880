"""Programs by hand, and what an outsider finds who drives them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from bench.program_outsider import Outsider, Target
from workbench.artefacts import ProgramMove, ProgramMoves, ProgramTool
from workbench.robot import Cell, forward_kinematics
from workbench.units import Float

from .conftest import DATA

START = np.radians([0, 30, 10, 0, 45, 0])


def start_pose(cell: Cell, joints: Float = START) -> Float:
    """The cutter's tip in the base."""
    return forward_kinematics(cell.chain, joints) @ cell.flange_from_cutter


def to(line: int, pose: Float, **more: object) -> ProgramMove:
    """A straight move of the tip."""
    return ProgramMove(line, "L", "t", "base", pose=pose, **({"feed_mm_s": 20.0} | more))  # type: ignore[arg-type]


def shifted(pose: Float, by: Sequence[float], turn_deg: Sequence[float] = (0, 0, 0)) -> Float:
    """A pose moved in the base, and turned in itself by a rotation vector."""
    moved = pose.copy()
    moved[:3, 3] += by
    moved[:3, :3] = pose[:3, :3] @ Rotation.from_rotvec(turn_deg, degrees=True).as_matrix()
    return moved


def program(cell: Cell, *moves: ProgramMove, joints: Float = START, turntable: float | None = None) -> ProgramMoves:
    """From a posture on, lines from 2."""
    first = ProgramMove(1, "J", "t", "base", joints=joints, turntable=turntable)
    return ProgramMoves(
        "abb", "by hand", (first, *moves), {"t": ProgramTool(cell.flange_from_cutter)}, {"base": np.eye(4)}
    )


def driven(cell: Cell, made: ProgramMoves) -> tuple[Outsider, Float, Float]:
    """The outsider, joint angles (n, 6) and turntable angles (n,), deg, of straight moves driven in fine steps."""
    outsider = Outsider(DATA / "irb6700_150_320.urdf", cell)
    at, table = made.moves[0].joints, made.moves[0].turntable or 0.0
    targets = [
        Target(one.kind, one.pose, None, one.joints, np.degrees(one.turntable or table), 0.0) for one in made.moves[1:]
    ]
    ((wrong, joints, tables),) = outsider.drive([(at, np.degrees(table), targets)])
    assert wrong == ""
    return outsider, joints, tables


def outsiders_least(cell: Cell, made: ProgramMoves) -> tuple[float, float]:
    """The least clearance, mm, and the least distance from a joint limit, rad, all along a program."""
    outsider, joints, tables = driven(cell, made)
    room = float(np.minimum(joints - outsider.low, outsider.high - joints).min())
    return outsider.least(cell, joints, tables, 500.0)[0], room
