"""Nodes of the grid of both angles as the robot stands at them: displacement, joints, whether it can stand there."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from workbench.api import AnyArray, Bool, Float, Int, within_limits
from workbench.plugins.stiffness.arm import displacements
from workbench.plugins.stiffness.feasible import FREE, Configuration, Examiner
from workbench.plugins.stiffness.relaxed import Grid
from workbench.plugins.stiffness.traversal import BRANCHES, flange_poses

HALF = 4  # of the window around a law that is searched with all limits, in grid steps
COARSE, POINTS = 4, 8  # of how many nodes each way, and points, one is looked at for what is infeasible


def nodes(
    examiner: Examiner,
    stiffness: Float,
    configuration: Configuration,
    rotation: Float,
    table: Float,
    which: Int | None = None,
) -> tuple[Float, Float, Bool]:
    """Displacement (n, ...), joint and turntable angles (n, ..., 7) and whether each is feasible (n, ...).

    At all points of the path, or at those with indices `which` (n,).
    """
    points, cell, arm, shape = examiner.points, examiner.cell, examiner.arm, rotation.shape
    which = np.arange(shape[0]) if which is None else which
    at, alpha = np.repeat(which, rotation[0].size), table.reshape(-1)
    flange = flange_poses(cell, points, at, rotation.reshape(-1), alpha)
    turned = points.turned(cell, alpha)
    tip = np.einsum("nij,nj->ni", turned[:, :3, :3], points.base_from_point[at, :3, 3]) + turned[:, :3, 3]
    force = np.einsum("nij,nj->ni", turned[:, :3, :3], points.force_n[at])
    shoulder, elbow = BRANCHES[configuration.branch]
    cost, said = displacements(arm, stiffness, flange, tip, force, shoulder=shoulder, elbow=elbow)
    joints = configuration.joints(arm, flange)
    free = (said == FREE) & np.isfinite(within_limits(cell.chain, joints)).all(axis=1)
    free[free] = examiner.poor(joints[free]) == FREE
    free[free] = examiner.screen.hits(joints[free], alpha[free]) < 0
    seven = np.column_stack([joints, alpha]).reshape(*shape, 7)
    return np.where(free, cost, np.inf).reshape(shape), seven, free.reshape(shape)


def window(
    examiner: Examiner, stiffness: Float, configuration: Configuration, way: Int, grid: Grid
) -> tuple[tuple[AnyArray, AnyArray], Float, Float, Bool]:
    """Indices (n, a, t) of turntable and cutter angle around a way, seven joints, cost, whether feasible."""
    half = np.where(grid.bands > 0, HALF, 0)
    counts = len(grid.tables), len(grid.rotations)
    offsets = np.meshgrid(*(np.arange(-h, h + 1) for h in half), indexing="ij")
    table, rotation = (way[:, k, None, None] + offsets[k] for k in (0, 1))
    inside = (table >= 0) & (table < counts[0])
    if grid.closed:
        rotation = rotation % counts[1]
    else:
        inside &= (rotation >= 0) & (rotation < counts[1])
    table, rotation = (np.clip(part, 0, c - 1) for part, c in zip((table, rotation), counts, strict=True))
    cost, joints, free = nodes(examiner, stiffness, configuration, grid.rotations[rotation], grid.tables[table])
    return (table, rotation), joints, cost, free & inside


def closed_off(examiner: Examiner, stiffness: Float, configuration: Configuration, grid: Grid) -> Callable[[int], Bool]:
    """Nodes (a, t) that are infeasible by limits or collision, as judged at one of COARSE^2 nodes, every few points."""
    shape, n = (len(grid.tables), len(grid.rotations)), len(examiner.points.layer)
    at = [np.minimum(np.arange(COARSE // 2, count + COARSE // 2, COARSE), count - 1) for count in shape]
    table, rotation = np.meshgrid(grid.tables[at[0]], grid.rotations[at[1]], indexing="ij")
    judged = [
        ~nodes(examiner, stiffness, configuration, rotation[None], table[None], np.array([i]))[2][0]
        for i in np.minimum(np.arange(POINTS // 2, n + POINTS // 2, POINTS), n - 1)
    ]
    return lambda i: judged[i // POINTS].repeat(COARSE, axis=0).repeat(COARSE, axis=1)[: shape[0], : shape[1]]


def shift_of(way: Int, grid: Grid) -> Int:
    """Steps (n, 2) from the point before, the short way round where the cutter's angles close."""
    steps, count = np.diff(way, axis=0, prepend=way[:1]), len(grid.rotations)
    if grid.closed:
        steps[:, 1] = (steps[:, 1] + count // 2) % count - count // 2
    return steps
