"""A law along the path: cutter rotation, and if wanted turntable angle, point by point, by dynamic programming.

First the best one on the whole grid, were joints and bodies no hindrance: a bound that can be reached. Then within
windows that move along, over (place on the grid of both angles, last step), with what joints and bodies allow.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from workbench.api import AnyArray, Bool, Float, Int, Shaped, forward_kinematics, kernel, within_limits
from workbench.plugins.stiffness.arm import BRANCHES, FREE
from workbench.plugins.stiffness.traversal import (
    EVERY,
    MOST_STEP,
    REACHED,
    Choice,
    Examiner,
    Share,
    flange_poses,
    placed,
    silent,
)

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
    examiner: Examiner, branch: int, grid: Grid, most_mm: float, closed_off: Callable[[int], Bool] | None = None
) -> Relaxed | None:
    """The law of least cost with steps within the bands; None: none of the branch costs less than `most_mm`.

    Joint limits count point by point; speeds, accelerations, collision and the wrist's flip are left out, so a law that
    heeds them cannot cost less. By dynamic programming on all nodes: proven the best. `closed_off` gives the nodes
    (a, t) of a point that the law must keep away from: then it is the best of those that do.
    """
    n, shape = len(examiner.points.layer), (len(grid.tables), len(grid.rotations))

    def cost(i: int, rows: AnyArray) -> Float:
        """Displacement (a, t), mm, at point i, infinite where the branch does not reach it or `rows` (a,) are False."""
        found = np.full(shape, np.inf)
        path = placed(examiner.cell, examiner.points.only(np.array([i])), grid.tables[rows])
        moved, said = examiner.arm.traverse(path, grid.rotations, branch)
        found[rows] = np.where(said == FREE, moved, np.inf).min(axis=0)
        if closed_off is not None:
            found[closed_off(i)] = np.inf
        return found

    value, kept = cost(0, np.ones(shape[0], bool)), []
    for i in range(n):
        if not value.min() < most_mm:
            return None
        if i % BLOCK == 0 and i < n - 1:
            kept.append(value)
        value = _next(value, grid, cost, i + 1) if i < n - 1 else value
    way = np.empty((n, 2), np.int64)
    way[-1] = np.unravel_index(int(value.argmin()), value.shape)
    for block in range(len(kept) - 1, -1, -1):
        start, values = block * BLOCK, [kept[block]]
        for i in range(start + 1, min(start + BLOCK, n - 1)):
            values.append(_next(values[-1], grid, cost, i))
        for i, before in zip(range(start + len(values), start, -1), reversed(values), strict=True):
            way[i - 1] = _came_from(before, way[i], grid)
    return Relaxed(branch, float(value.min()), way)


def _next(value: Float, grid: Grid, cost: Callable[[int, AnyArray], Float], i: int) -> Float:
    """Cost (a, t) of reaching point i, by those of the point before.

    The least over a window with a cost that is a sum over the axes, so each axis goes by itself (Felzenszwalb and
    Huttenlocher 2012): the work is that of the nodes times the width of one window plus the other.
    """
    for axis, closed in ((1, grid.closed), (0, False)):
        least = value.copy()
        for way in (sign * step for step in range(1, grid.bands[axis] + 1) for sign in (1, -1)):
            moved = np.roll(value, way, axis=axis)
            if not closed:  # from beyond the ends comes nothing
                np.moveaxis(moved, axis, 0)[slice(way) if way > 0 else slice(way, None)] = np.inf
            np.minimum(least, moved + grid.step_cost_mm * way * way, out=least)
        value = least
    return np.asarray(value + cost(i, np.asarray(np.isfinite(value).any(axis=1))))


def _came_from(before: Float, node: Int, grid: Grid) -> Int:
    """The node (2,) of the point before from which `node` (2,) costs least; one that rests goes first."""
    steps = np.stack(np.meshgrid(*(np.arange(-b, b + 1) for b in grid.bands), indexing="ij"), axis=-1).reshape(-1, 2)
    steps = steps[np.argsort((steps**2).sum(axis=1), kind="stable")]
    there = node - steps
    if grid.closed:
        there[:, 1] %= before.shape[1]
    inside = ((there >= 0) & (there < before.shape)).all(axis=1)
    there, (e, d) = there[inside], steps[inside].T
    price = before[there[:, 0], there[:, 1]] + grid.step_cost_mm * d * d + grid.step_cost_mm * e * e
    return np.asarray(there[np.argmin(price)])


BAND = 2  # steps of the grid that the law may go from one point to the next
STEP_COST_MM = 1e-4  # what a step of the grid costs, times its size squared: the law rests where little is to be gained
AWKWARD_STEP = 1e-2  # likewise, of a law by awkwardness
ROUNDS = 5  # of moving that window along with the law
NEAR = 1e-3  # relative: a law so near its bound is good enough
EQUAL = 1e-9  # relative: two costs that are the same but for rounding


class Limits(NamedTuple):
    """What m coordinates, joints and turntable, may do between points."""

    speed: Shaped[Float, " m"]  # rad/s, the turntable's last
    acceleration: Shaped[Float, " m"]  # rad/s^2, likewise
    step: float = MOST_STEP  # rad, of any coordinate


class Nodes(NamedTuple):
    """The nodes of n windows of a x t."""

    cost: Shaped[Float, "n a t"]  # infinite where the node may not be used
    joints: Shaped[Float, "n a t m"]  # coordinates; angles, rad


@dataclass(frozen=True, slots=True, eq=False)
class Law:
    """Cutter rotation and turntable angle of n points, and how the robot follows."""

    rotation: Shaped[Float, " n"]  # rad
    table: Shaped[Float, " n"]  # rad
    configuration: int
    joints: Shaped[Float, "n 6"]  # rad
    cost_mm: float  # displacements of all points and what the steps cost, summed


def constant_law(examiner: Examiner, choice: Choice) -> Law:
    """The law that keeps both angles as chosen."""
    n = len(examiner.points.layer)
    rotation, table = np.full(n, choice.rotation), np.full(n, choice.table)
    cost = nodes(examiner, choice.configuration, rotation[:, None], table[:, None])[0].sum()
    return Law(rotation, table, choice.configuration, choice.joints, float(cost))


def standing(examiner: Examiner, law: Law, grid: Grid) -> Law:
    """A law as one of another axis, which stands; its cost is that of the cutter's steps and of the postures."""
    still = np.zeros(len(law.rotation))
    spacing = float(np.diff(grid.rotations[:2]).sum()) or 1.0
    turn = np.diff(law.rotation)
    steps = (turn + np.pi) % (2 * np.pi) - np.pi if grid.closed else turn
    cost = nodes(examiner, law.configuration, law.rotation[:, None], still[:, None])[0].sum()
    whole = float(cost + grid.step_cost_mm * ((steps / spacing) ** 2).sum())
    return dataclasses.replace(law, table=still, cost_mm=whole)


def improved_law(
    examiner: Examiner,
    start: Law,
    grid: Grid,
    limits: Limits,
    allowed: Bool = EVERY,
    progress: Share = silent,
) -> tuple[Law, float]:
    """The law of least cost in any one configuration, never worse than `start`; and a bound below any law's cost.

    In each branch of the arm first the best law of the whole grid without regard to speed, acceleration and collision,
    which is proven; then the best with regard to them in a window that moves along with it. Where the two cost the
    same, the law is the optimum of the grid. Where they are not even near, the first is sought again, away from what a
    coarse look at the grid shows as infeasible. The bound says how far the law may be from the optimum.
    """
    best, bound = start, np.inf
    for turn, branch in enumerate(sorted(range(BRANCHES), key=lambda b: b != start.configuration // 2)):
        progress(turn / BRANCHES)
        flips = [configuration for configuration in (2 * branch, 2 * branch + 1) if allowed[configuration]]
        if not flips:
            continue
        relaxed = relaxed_law(examiner, branch, grid, best.cost_mm)
        if relaxed is None:
            continue
        bound = min(bound, relaxed.cost_mm)
        for configuration in flips:
            best = _better(best, examiner, configuration, relaxed, grid, limits)
        for configuration in flips:
            if relaxed.cost_mm >= best.cost_mm * (1 - NEAR):
                break
            off = closed_off(examiner, configuration, grid)
            detour = relaxed_law(examiner, branch, grid, best.cost_mm, off)
            if detour is not None:
                best = _better(best, examiner, configuration, detour, grid, limits)
    return best, min(bound, best.cost_mm)


def _better(best: Law, examiner: Examiner, configuration: int, relaxed: Relaxed, grid: Grid, limits: Limits) -> Law:
    """The better of a law and the best with all limits near a relaxed one."""
    if relaxed.cost_mm >= best.cost_mm * (1 - EQUAL):
        return best
    way, reached = relaxed.way, np.inf
    for _ in range(ROUNDS):
        around, found = window(examiner, configuration, way, grid)
        steps = shift_of(way, grid)
        held = best_law(found, steps, examiner.points.time_steps_s, limits, grid.bands, grid.step_cost_mm)
        if held[0, 0] < 0:
            return best
        at = (np.arange(len(way)), *held.T)
        way = np.column_stack([part[at] for part in around])
        steps = shift_of(way, grid)
        total = float(found.cost[at].sum() + grid.step_cost_mm * (steps**2).sum())
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
    examiner: Examiner, configuration: int, rotation: Float, table: Float, which: Int | None = None
) -> tuple[Float, Float]:
    """Displacement (n, ...), infinite where it is infeasible; joint and turntable angles (n, ..., 7).

    At all points of the path, or at those with indices `which` (n,).
    """
    points, cell, shape = examiner.points, examiner.cell, rotation.shape
    which = np.arange(shape[0]) if which is None else which
    at, alpha = np.repeat(which, rotation[0].size), table.reshape(-1)
    flange = flange_poses(cell, points, at, rotation.reshape(-1), alpha)
    joints = examiner.arm.joint_angles(flange, configuration)
    kept = within_limits(cell.chain, joints)
    free: Bool = np.asarray(np.isfinite(kept).all(axis=1))
    off = forward_kinematics(cell.chain, joints[free]) - flange[free]
    free[free] = np.abs(off).max(axis=(1, 2), initial=0.0) < REACHED
    free[free] = examiner.poor(joints[free]) == FREE
    free[free] = examiner.screen.hits(joints[free], points.external(alpha, at)[free]) < 0
    away, _ = examiner.away(configuration, at[free], flange[free], alpha[free], joints[free])
    free[free] = away == FREE
    cost = np.full(len(at), np.inf)
    cost[free] = examiner.cost(kept[free], alpha[free], at[free])
    seven = np.column_stack([joints, alpha]).reshape(*shape, 7)
    return cost.reshape(shape), seven


def window(examiner: Examiner, configuration: int, way: Int, grid: Grid) -> tuple[tuple[AnyArray, AnyArray], Nodes]:
    """Indices (n, a, t) of turntable and cutter angle around a way, and the nodes there, seven joints each."""
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
    cost, joints = nodes(examiner, configuration, grid.rotations[rotation], grid.tables[table])
    return (table, rotation), Nodes(np.where(inside, cost, np.inf), joints)


def closed_off(examiner: Examiner, configuration: int, grid: Grid) -> Callable[[int], Bool]:
    """Nodes (a, t) that are infeasible by limits or collision, as judged at one of COARSE^2 nodes, every few points."""
    shape, n = (len(grid.tables), len(grid.rotations)), len(examiner.points.layer)
    at = [np.minimum(np.arange(COARSE // 2, count + COARSE // 2, COARSE), count - 1) for count in shape]
    table, rotation = np.meshgrid(grid.tables[at[0]], grid.rotations[at[1]], indexing="ij")
    looked = np.minimum(np.arange(POINTS // 2, n + POINTS // 2, POINTS), n - 1)
    looked[[0, -1]] = 0, n - 1  # where the program comes from and goes to counts
    of = rotation[None], table[None]
    judged = [~np.isfinite(nodes(examiner, configuration, *of, np.array([i]))[0][0]) for i in looked]
    return lambda i: judged[i // POINTS].repeat(COARSE, axis=0).repeat(COARSE, axis=1)[: shape[0], : shape[1]]


def shift_of(way: Int, grid: Grid) -> Int:
    """Steps (n, 2) from the point before, the short way round where the cutter's angles close."""
    steps, count = np.diff(way, axis=0, prepend=way[:1]), len(grid.rotations)
    if grid.closed:
        steps[:, 1] = (steps[:, 1] + count // 2) % count - count // 2
    return steps


# The compiled kernels.


@kernel
def best_law(
    windows: Nodes, shift: AnyArray, dt: AnyArray, limits: Limits, bands: AnyArray, restless: float
) -> AnyArray:
    """Indices (n, 2) of the cheapest way through n windows of a x t nodes; -1 where there is no way.

    A step is allowed if each coordinate keeps its limits; a row that the way goes straight through (no step before and
    after) is always allowed.

    Args:
        windows: their nodes.
        shift: (n, 2) how far each window lies from the one before, in nodes.
        dt: (n,) time from the row before.
        limits: of the coordinates.
        bands: (2,) largest step along a and t, in nodes.
        restless: cost of a step, times its size in nodes squared.
    """
    cost, joints = windows
    speed, acceleration, most_step = limits
    n, rows, columns, m = joints.shape
    e_most, d_most = 2 * bands[0] + 1, 2 * bands[1] + 1
    value, fresh = np.full((rows, columns, e_most, d_most), np.inf), np.full((rows, columns, e_most, d_most), np.inf)
    came = np.full((n, rows, columns, e_most, d_most), -1, np.int16)
    before, now = np.zeros((rows, columns, e_most, d_most, m)), np.zeros((rows, columns, e_most, d_most, m))
    value[:, :, bands[0], bands[1]] = cost[0]
    for i in range(1, n):
        fresh[:] = np.inf
        for a in range(rows):
            for t in range(columns):
                if value[a, t].min() == np.inf:
                    continue
                for e in range(e_most):
                    for d in range(d_most):
                        to_a, to_t = a + e - bands[0] - shift[i, 0], t + d - bands[1] - shift[i, 1]
                        if not (0 <= to_a < rows and 0 <= to_t < columns) or cost[i, to_a, to_t] == np.inf:
                            continue
                        rests = e == bands[0] and d == bands[1]
                        allowed = _moves(
                            joints[i - 1, a, t], joints[i, to_a, to_t], dt[i], speed, most_step, now[a, t, e, d]
                        )
                        if not allowed and not rests:
                            continue
                        added = cost[i, to_a, to_t] + restless * ((e - bands[0]) ** 2 + (d - bands[1]) ** 2)
                        for last in range(e_most * d_most):
                            le, ld = last // d_most, last % d_most
                            total = value[a, t, le, ld] + added
                            if total >= fresh[to_a, to_t, e, d]:
                                continue
                            straight = i == 1 or (rests and le == bands[0] and ld == bands[1])
                            from_a, from_t = a - le + bands[0] + shift[i - 1, 0], t - ld + bands[1] + shift[i - 1, 1]
                            if not straight and not (
                                allowed
                                and _gentle(
                                    before[from_a, from_t, le, ld],
                                    now[a, t, e, d],
                                    (dt[i - 1] + dt[i]) / 2,
                                    acceleration,
                                )
                            ):
                                continue
                            fresh[to_a, to_t, e, d] = total
                            came[i, to_a, to_t, e, d] = last
        value, fresh = fresh, value
        before, now = now, before
    return _traced(value, came, shift, bands)


@kernel
def _moves(a: AnyArray, b: AnyArray, dt: float, speed: AnyArray, most_step: float, out: AnyArray) -> bool:
    """Speeds from a to b the short way round, and whether they are allowed."""
    good = True
    for j in range(len(a)):
        step = (b[j] - a[j] + np.pi) % (2 * np.pi) - np.pi
        out[j] = step / dt
        if abs(step) > most_step or abs(out[j]) > speed[j]:
            good = False
    return good


@kernel
def _gentle(before: AnyArray, now: AnyArray, dt: float, acceleration: AnyArray) -> bool:
    good = True
    for j in range(len(now)):
        good &= abs(now[j] - before[j]) <= acceleration[j] * dt
    return good


@kernel
def _traced(value: AnyArray, came: AnyArray, shift: AnyArray, bands: AnyArray) -> AnyArray:
    """From the cheapest end back to the start."""
    n, d_most = len(came), came.shape[4]
    way = np.full((n, 2), -1, np.int64)
    best, a, t, e, d = np.inf, 0, 0, 0, 0
    for node, total in np.ndenumerate(value):
        if total < best:
            best = total
            a, t, e, d = node
    if best == np.inf:
        return way
    for i in range(n - 1, -1, -1):
        way[i] = a, t
        last = came[i, a, t, e, d]
        a, t = a - e + bands[0] + shift[i, 0], t - d + bands[1] + shift[i, 1]
        e, d = last // d_most, last % d_most
    return way
