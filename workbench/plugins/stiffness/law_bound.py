"""The best law on the whole grid of both angles, were joints and bodies no hindrance: a bound that can be reached."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from workbench.api import AnyArray, Bool, Float, Int, Shaped
from workbench.plugins.stiffness.arm import BRANCHES, traverse
from workbench.plugins.stiffness.law_kernel import stepped
from workbench.plugins.stiffness.traversal import Examiner, placed

BLOCK = 32  # points between which the values are kept; those inside are computed anew on the way back


@dataclass(frozen=True, slots=True, eq=False)
class Grid:
    """What a law may choose from."""

    rotations: Shaped[Float, " t"]  # rad, evenly spaced
    tables: Shaped[Float, " a"]  # rad
    bands: Shaped[Int, " 2"]  # most steps of turntable and cutter from point to point, in the grid; 0: it stands still
    step_cost_mm: float  # what a step costs, times its size squared, so that the law rests where little is gained

    @property
    def closed(self) -> bool:
        """Whether the cutter's angles make a full turn."""
        count = len(self.rotations)
        return bool(count > 1 and np.isclose(count * (self.rotations[1] - self.rotations[0]), 2 * np.pi))


@dataclass(frozen=True, slots=True, eq=False)
class Relaxed:
    """The best law of one branch of the arm, by displacement and reach alone."""

    branch: int
    cost_mm: float  # sum over the points, steps included: no law of the branch costs less
    way: Shaped[Int, "n 2"]  # indices of turntable and cutter angle


def relaxed_law(
    examiner: Examiner,
    stiffness: Float,
    branch: int,
    grid: Grid,
    most_mm: float,
    closed_off: Callable[[int], Bool] | None = None,
) -> Relaxed | None:
    """The law of least cost with steps within the bands; None: none of the branch costs less than `most_mm`.

    Joint limits count point by point; speeds, accelerations, collision and the wrist's flip are left out, so a law that
    heeds them cannot cost less. By dynamic programming on all nodes: proven the best. `closed_off` gives the nodes
    (a, t) of a point that the law must keep away from: then it is the best of those that do.
    """
    cost = _Costs(examiner, stiffness, branch, grid, closed_off)
    n = len(examiner.points.layer)
    value, kept = cost.at(0, np.ones(len(grid.tables), bool)), []
    for i in range(n - 1):
        if i % BLOCK == 0:
            kept.append(value)
        value = _next(value, grid, cost, i + 1)[0]
        if not value.min() < most_mm:
            return None
    way = np.empty((n, 2), np.int64)
    way[-1] = np.unravel_index(int(value.argmin()), value.shape)
    for block in range(len(kept) - 1, -1, -1):
        start, now = block * BLOCK, kept[block]
        steps = []
        for i in range(start, min(start + BLOCK, n - 1)):
            now, came = _next(now, grid, cost, i + 1)
            steps.append(came)
        for i, came in zip(range(start + len(steps), start, -1), reversed(steps), strict=True):
            step = np.divmod(int(came[tuple(way[i])]), 2 * grid.bands[1] + 1) - grid.bands
            way[i - 1] = (way[i] - step) % (len(grid.tables), len(grid.rotations))
    return Relaxed(branch, float(value.min()), way)


def _next(value: Float, grid: Grid, cost: _Costs, i: int) -> tuple[Float, AnyArray]:
    """Cost (a, t) of reaching point i, and from where."""
    least, came = np.empty_like(value), np.empty(value.shape, np.int8)
    stepped(value, grid.bands, grid.step_cost_mm, grid.closed, least, came)
    return np.asarray(least + cost.at(i, np.asarray(np.isfinite(least).any(axis=1)))), came


class _Costs:
    """Displacement of one path point on the whole grid; infinite where the branch does not reach it."""

    def __init__(
        self, examiner: Examiner, stiffness: Float, branch: int, grid: Grid, closed_off: Callable[[int], Bool] | None
    ) -> None:
        self.examiner, self.stiffness, self.grid, self.closed_off = examiner, stiffness, grid, closed_off
        self.shoulder, self.elbow = BRANCHES[branch]

    def at(self, i: int, rows: AnyArray) -> Float:
        """Displacement (a, t), mm, at point i; only turntable angles `rows` (a,) are looked at."""
        cell, tables = self.examiner.cell, self.grid.tables
        found = np.full((len(tables), len(self.grid.rotations)), np.inf)
        path = placed(cell, self.examiner.points.only(np.array([i])), tables[rows])
        moved, said = traverse(
            self.examiner.arm, self.stiffness, path, self.grid.rotations, shoulder=self.shoulder, elbow=self.elbow
        )
        found[rows] = np.where(said == 0, moved, np.inf)
        if self.closed_off is not None:
            found[self.closed_off(i)] = np.inf
        return found
