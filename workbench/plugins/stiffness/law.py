"""A law along the path: cutter rotation, and if wanted turntable angle, point by point, by dynamic programming.

First the best one on the whole grid, were joints and bodies no hindrance: a bound that can be reached.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from workbench.api import AnyArray, Bool, Float, Int, Shaped, within_limits
from workbench.plugins.stiffness.arm import BRANCHES, displacements, traverse
from workbench.plugins.stiffness.law_kernel import best_law, stepped
from workbench.plugins.stiffness.search import Choice
from workbench.plugins.stiffness.traversal import FREE, MOST_STEP, Configuration, Examiner, flange_poses, placed

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


BAND = 2  # steps of the grid that the law may go from one point to the next
STEP_COST_MM = 1e-4  # what a step of the grid costs, times its size squared: the law rests where little is to be gained
ROUNDS = 5  # of moving that window along with the law
NEAR = 1e-3  # relative: a law so near its bound is good enough
EQUAL = 1e-9  # relative: two costs that are the same but for rounding


@dataclass(frozen=True, slots=True, eq=False)
class Limits:
    """What joints and turntable may do between points."""

    speed: Shaped[Float, " 7"]  # rad/s, the turntable's last
    acceleration: Shaped[Float, " 7"]  # rad/s^2, likewise


@dataclass(frozen=True, slots=True, eq=False)
class Law:
    """Cutter rotation and turntable angle of n points, and how the robot follows."""

    rotation: Shaped[Float, " n"]  # rad
    table: Shaped[Float, " n"]  # rad
    configuration: Configuration
    joints: Shaped[Float, "n 6"]  # rad
    cost_mm: float  # displacements of all points and what the steps cost, summed


def constant_law(examiner: Examiner, stiffness: Float, choice: Choice) -> Law:
    """The law that keeps both angles as chosen."""
    n = len(examiner.points.layer)
    rotation, table = np.full(n, choice.rotation), np.full(n, choice.table)
    cost = nodes(examiner, stiffness, choice.configuration, rotation[:, None], table[:, None])[0].sum()
    return Law(rotation, table, choice.configuration, choice.joints, float(cost))


def improved_law(examiner: Examiner, stiffness: Float, start: Law, grid: Grid, limits: Limits) -> tuple[Law, float]:
    """The law of least cost in any one configuration, never worse than `start`; and a bound below any law's cost.

    In each branch of the arm first the best law of the whole grid without regard to speed, acceleration and collision,
    which is proven; then the best with regard to them in a window that moves along with it. Where the two cost the
    same, the law is the optimum of the grid. Where they are not even near, the first is sought again, away from what a
    coarse look at the grid shows as infeasible. The bound says how far the law may be from the optimum.
    """
    best, bound = start, np.inf
    for branch in sorted(range(len(BRANCHES)), key=lambda b: b != start.configuration.branch):
        relaxed = relaxed_law(examiner, stiffness, branch, grid, best.cost_mm)
        if relaxed is None:
            continue
        bound = min(bound, relaxed.cost_mm)
        for flip in (0, 1):
            best = _better(best, examiner, stiffness, Configuration(branch, flip), relaxed, grid, limits)
        for flip in (0, 1):
            if relaxed.cost_mm >= best.cost_mm * (1 - NEAR):
                break
            configuration = Configuration(branch, flip)
            off = closed_off(examiner, stiffness, configuration, grid)
            detour = relaxed_law(examiner, stiffness, branch, grid, best.cost_mm, off)
            if detour is not None:
                best = _better(best, examiner, stiffness, configuration, detour, grid, limits)
    return best, min(bound, best.cost_mm)


def _better(
    best: Law,
    examiner: Examiner,
    stiffness: Float,
    configuration: Configuration,
    relaxed: Relaxed,
    grid: Grid,
    limits: Limits,
) -> Law:
    """The better of a law and the best with all limits near a relaxed one."""
    if relaxed.cost_mm >= best.cost_mm * (1 - EQUAL):
        return best
    way, reached = relaxed.way, np.inf
    for _ in range(ROUNDS):
        around, joints, cost, free = window(examiner, stiffness, configuration, way, grid)
        held = best_law(
            cost,
            joints,
            free,
            shift_of(way, grid),
            examiner.points.time_steps_s,
            limits.speed,
            limits.acceleration,
            MOST_STEP,
            grid.bands,
            grid.step_cost_mm,
        )
        if held[0, 0] < 0:
            return best
        at = (np.arange(len(way)), *held.T)
        way = np.column_stack([part[at] for part in around])
        steps = shift_of(way, grid)
        total = float(cost[at].sum() + grid.step_cost_mm * (steps**2).sum())
        if total >= reached * (1 - EQUAL):
            break
        reached = total
    if reached >= best.cost_mm * (1 - EQUAL):
        return best
    rotation, table = grid.rotations[way[:, 1]], grid.tables[way[:, 0]]
    followed, cause, _ = examiner.driven(configuration, rotation, table)
    return Law(rotation, table, configuration, followed, reached) if cause == FREE else best


# Nodes of the grid of both angles as the robot stands at them: displacement, joints, whether it can stand there.

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
    away, _ = examiner.away(configuration, at[free], flange[free], alpha[free], joints[free])
    free[free] = away == FREE
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
    looked = np.minimum(np.arange(POINTS // 2, n + POINTS // 2, POINTS), n - 1)
    looked[[0, -1]] = 0, n - 1  # where the program comes from and goes to counts
    judged = [
        ~nodes(examiner, stiffness, configuration, rotation[None], table[None], np.array([i]))[2][0] for i in looked
    ]
    return lambda i: judged[i // POINTS].repeat(COARSE, axis=0).repeat(COARSE, axis=1)[: shape[0], : shape[1]]


def shift_of(way: Int, grid: Grid) -> Int:
    """Steps (n, 2) from the point before, the short way round where the cutter's angles close."""
    steps, count = np.diff(way, axis=0, prepend=way[:1]), len(grid.rotations)
    if grid.closed:
        steps[:, 1] = (steps[:, 1] + count // 2) % count - count // 2
    return steps
