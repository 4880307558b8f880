"""A law along the path: cutter rotation, and if wanted turntable angle, point by point, by dynamic programming."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from workbench.api import Bool, Float, within_limits
from workbench.plugins.stiffness.arm import displacements
from workbench.plugins.stiffness.feasible import FREE, MOST_STEP, Configuration, Examiner
from workbench.plugins.stiffness.law_kernel import best_law
from workbench.plugins.stiffness.traversal import BRANCHES, flange_poses

BAND = 2  # steps of the grid that the law may go from one point to the next
RESTLESS_MM = 1e-6  # what a step costs, so that the law rests where nothing is to be gained
ROUNDS = 3  # of cutter and turntable in turn
GAIN_MM = 1e-6  # of the mean displacement, worth another round
Turning = Literal["cutter", "turntable"]


@dataclass(frozen=True, slots=True, eq=False)
class Limits:
    """What joints and turntable may do between points."""

    speed: Float  # (7,) rad/s, the turntable's last
    acceleration: float  # rad/s^2, any of them


@dataclass(frozen=True, slots=True, eq=False)
class Law:
    """Cutter rotation (n,) and turntable angle (n,), rad."""

    rotation: Float
    table: Float


def improved_law(examiner: Examiner, stiffness: Float, configuration: Configuration, start: Law, rotations: Float,
                 tables: Float | None, limits: Limits) -> Law:  # fmt: skip
    """The law of least mean displacement in one configuration, never worse than `start`, free of collision.

    Without `tables` it is the optimum over cutter rotations that change by at most BAND grid steps a point, within
    the limits; where the law rests, the path's own motion counts as allowed. With `tables` cutter and turntable are
    improved in turn until neither gains: better than either alone, but not proven the best of both together.
    """
    best, mean = start, np.inf
    for _ in range(ROUNDS if tables is not None else 1):
        found, reached = _improved(examiner, stiffness, configuration, best, rotations, limits, "cutter")
        if tables is not None:
            found, reached = _improved(examiner, stiffness, configuration, found, tables, limits, "turntable")
        if reached > mean - GAIN_MM:
            break
        best, mean = found, reached
    return best


def _improved(examiner: Examiner, stiffness: Float, configuration: Configuration, start: Law, grid: Float,
              limits: Limits, turning: Turning) -> tuple[Law, float]:  # fmt: skip
    """The best law in one of the two, the other as it is, and its mean displacement."""
    n, k = len(start.rotation), len(grid)
    varied, fixed = np.tile(grid, (n, 1)), np.repeat(start.table[:, None], k, axis=1)
    if turning == "turntable":
        fixed = np.repeat(start.rotation[:, None], k, axis=1)
    rotation, table = (varied, fixed) if turning == "cutter" else (fixed, varied)
    cost, joints, free = _nodes(examiner, stiffness, configuration, rotation, table)
    points = examiner.points
    moved = np.diff(grid).mean() if k > 1 else 1.0
    closed = bool(k > 1 and np.isclose(k * moved, 2 * np.pi) and (turning == "cutter"))
    held = best_law(cost, joints, free, points.time_steps_s, limits.speed, limits.acceleration, MOST_STEP, BAND,
                    RESTLESS_MM, closed)  # fmt: skip
    chosen = grid[held]
    law = Law(chosen, start.table) if turning == "cutter" else Law(start.rotation, chosen)
    return law, float(cost[np.arange(n), held].sum() / len(points.loaded))


def _nodes(examiner: Examiner, stiffness: Float, configuration: Configuration, rotation: Float,
           table: Float) -> tuple[Float, Float, Bool]:  # fmt: skip
    """Displacement (n, k), joint and turntable angles (n, k, 7) and whether each is feasible (n, k)."""
    n, k = rotation.shape
    points, cell, arm = examiner.points, examiner.cell, examiner.arm
    at, alpha = np.repeat(np.arange(n), k), table.reshape(-1)
    flange = flange_poses(cell, points, at, rotation.reshape(-1), alpha)
    turned = points.turned(cell, alpha)
    tip = np.einsum("nij,nj->ni", turned[:, :3, :3], points.base_from_point[at, :3, 3]) + turned[:, :3, 3]
    force = np.einsum("nij,nj->ni", turned[:, :3, :3], points.force_n[at])
    shoulder, elbow = BRANCHES[configuration.branch]
    cost, said = displacements(arm, stiffness, flange, tip, force, shoulder=shoulder, elbow=elbow)
    joints = configuration.joints(arm, flange)
    free = (said == FREE) & np.isfinite(within_limits(cell.chain, joints)).all(axis=1)
    free[free] = examiner.screen.hits(joints[free], alpha[free]) < 0
    seven = np.column_stack([joints, alpha]).reshape(n, k, 7)
    return np.where(free, cost, np.inf).reshape(n, k), seven, free.reshape(n, k)
