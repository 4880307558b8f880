"""Programs by hand, and an outsider who drives them: dense samples, other formulas, fcl on its own."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from workbench.artefacts import ProgramMove, ProgramMoves, ProgramTool
from workbench.robot import Cell, CollisionModel, forward_kinematics, inverse_kinematics
from workbench.units import Float

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


def driven(cell: Cell, made: ProgramMoves, step_mm: float = 0.5) -> tuple[Float, Float]:
    """Joint angles (n, 6) and turntable angles (n,) of a program of straight moves without zones, densely sampled."""
    at, table = made.moves[0].joints, made.moves[0].turntable or 0.0
    assert at is not None
    joints, tables = [at], [table]
    here = forward_kinematics(cell.chain, at) @ cell.flange_from_cutter
    for move in made.moves[1:]:
        end_table = table if move.turntable is None else move.turntable
        if move.kind == "J":
            assert move.joints is not None
            count = int(np.ceil(np.degrees(np.abs(move.joints - joints[-1]).max()) / 0.05)) + 1
            steps = joints[-1] + np.linspace(0, 1, count)[:, None] * (move.joints - joints[-1])
            tables += list(np.linspace(table, end_table, count))
            joints += list(steps)
            here, table = forward_kinematics(cell.chain, move.joints) @ cell.flange_from_cutter, end_table
            continue
        assert move.pose is not None
        turn = (Rotation.from_matrix(here[:3, :3]).inv() * Rotation.from_matrix(move.pose[:3, :3])).magnitude()
        count = (
            int(
                max(
                    np.linalg.norm(move.pose[:3, 3] - here[:3, 3]) / step_mm,
                    np.degrees(turn) / 0.1,
                    np.degrees(abs(end_table - table)) / 0.1,
                )
            )
            + 2
        )
        f = np.linspace(0, 1, count)
        turns = Slerp([0, 1], Rotation.from_matrix([here[:3, :3], move.pose[:3, :3]]))(f).as_matrix()
        poses = np.tile(np.eye(4), (count, 1, 1))
        poses[:, :3, :3], poses[:, :3, 3] = turns, here[:3, 3] + f[:, None] * (move.pose[:3, 3] - here[:3, 3])
        for branches in inverse_kinematics(cell.chain, poses @ np.linalg.inv(cell.flange_from_cutter)):
            near = branches + 2 * np.pi * np.round((joints[-1] - branches) / (2 * np.pi))
            away = np.abs(near - joints[-1]).max(axis=1)
            if np.isnan(away).all():
                return np.full((1, 6), np.nan), np.zeros(1)
            joints.append(near[np.nanargmin(away)])
        tables += list(table + f * (end_table - table))
        here, table = move.pose, end_table
    return np.array(joints), np.array(tables)


def outsiders_least(cell: Cell, joints: Float, tables: Float) -> tuple[float, float]:
    """The least clearance, mm, and the least distance from a joint limit, rad, of all samples."""
    model = CollisionModel(cell)
    gaps = [
        gap.distance_mm
        for q, angle in zip(joints, tables.tolist(), strict=True)
        if (gap := model.clearance(q, angle)) is not None
    ]
    low, high = cell.chain.limits.T
    return min(gaps), float(np.minimum(joints - low, high - joints).min())
