"""Best-first search on the traversal's grid: the cell of least mean displacement that the robot can really mill in."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from workbench.api import Float, InputError, Int, Shaped
from workbench.plugins.stiffness.traversal import (
    CAUSES,
    COLLISION,
    EVERY_POINT,
    FREE,
    SOLVED,
    UNREACHABLE,
    Configuration,
    Examiner,
    Traversal,
)

FIRST_CHUNK, LARGEST_CHUNK = 64, 1024


@dataclass(frozen=True, slots=True, eq=False)
class Choice:
    """The best constant cutter rotation and turntable angle."""

    rotation: float
    table: float
    configuration: Configuration
    joints: Shaped[Float, "n 6"]  # at all points
    mean_mm: float
    examined: int  # cells that were better or equal, itself included
    of: int  # cells of the grid


@dataclass(frozen=True, slots=True, eq=False)
class PostureMap:
    """Eq. (25)'s function over t cutter rotations and a turntable angles; NaN and the cause where infeasible."""

    rotations: Shaped[Float, " t"]
    tables: Shaped[Float, " a"]
    mean_mm: Shaped[Float, "t a"]
    cause: Shaped[Int, "t a"]  # index into `traversal.CAUSES`
    pair: Shaped[Int, "t a"]  # index into `pairs`, -1: no collision
    pairs: tuple[tuple[str, str], ...]
    how: Shaped[Int, "t a"]  # index into `traversal.JUDGED`
    without_collision_mm: Shaped[Float, "t a"]


def search(examiner: Examiner, grid: Traversal, *, whole_map: bool) -> tuple[Choice, PostureMap]:
    """Cells in the order of their mean displacement, each examined until one is free at every point of the path.

    All better cells are proven infeasible, so the choice is the optimum of the grid. `whole_map`: the others are
    examined too; without it they count as infeasible by collision only where that was found. No cell is called free
    that was not judged along the whole path: the map says how (`how`).

    Raises:
        InputError: no cell is free; the line says what stands in the way.
    """
    state = _State(grid)
    ranked = grid.ranked
    choice, start, size = None, 0, FIRST_CHUNK
    while start < len(ranked) and (whole_map or choice is None):
        flat = state.still_open(ranked[start : start + size])
        branch, table, rotation = np.unravel_index(flat, grid.said.shape)
        verdicts = examiner.examine(branch, grid.rotations[rotation], grid.tables[table])
        state.note(flat, verdicts.cause, verdicts.hit, verdicts.how)
        for i in np.flatnonzero(verdicts.cause == FREE) if choice is None else ():
            choice = _tried(examiner, grid, int(flat[i]), int(verdicts.flip[i]), state)
            if choice is not None:
                break
        start, size = start + size, min(2 * size, LARGEST_CHUNK)
    found = state.map(examiner)
    if choice is None:
        raise InputError(examiner.points.source, _why_not(found))
    return choice, found


def _tried(examiner: Examiner, grid: Traversal, flat: int, flip: int, state: _State) -> Choice | None:
    """The choice of one cell, if it is free all along; else its cause is noted."""
    branch, table, rotation = (int(i) for i in np.unravel_index(flat, grid.said.shape))
    n = len(examiner.points.layer)
    at = grid.rotations[rotation], grid.tables[table]
    for wrist in (flip, 1 - flip):
        configuration = Configuration(branch, wrist)
        joints, cause, hit = examiner.driven(configuration, np.full(n, at[0]), np.full(n, at[1]))
        if cause == FREE:
            mean = float(grid.mean_mm[branch, table, rotation])
            return Choice(float(at[0]), float(at[1]), configuration, joints, mean, state.examined, grid.said[0].size)
    state.note(np.array([flat]), np.array([cause]), np.array([hit]), np.array([EVERY_POINT]))
    return None


class _State:
    """What is known of each (branch, turntable, rotation)."""

    def __init__(self, grid: Traversal) -> None:
        self.grid, self.cause = grid, grid.said.astype(np.int64).reshape(-1)
        self.hit = np.full(self.cause.shape, -1)
        self.how = np.full(self.cause.shape, SOLVED)
        self.settled = np.zeros(grid.said[0].size, bool)  # a branch of it is free
        self.examined = 0

    def still_open(self, flat: Int) -> Int:
        """Without those whose cell is free in a better branch."""
        return flat[~self.settled[flat % len(self.settled)]]

    def note(self, flat: Int, cause: Int, hit: Int, how: Int) -> None:
        self.cause[flat], self.hit[flat], self.how[flat] = cause, hit, how
        self.settled[flat % len(self.settled)] = False
        self.settled[(flat % len(self.settled))[cause == FREE]] = True
        self.examined += len(flat)

    def map(self, examiner: Examiner) -> PostureMap:
        """The best free branch of each cell, or the cause of the branch that came farthest."""
        shape = self.grid.said.shape
        cause, hit, how = self.cause.reshape(shape), self.hit.reshape(shape), self.how.reshape(shape)
        mean = np.where(cause == FREE, self.grid.mean_mm, np.inf)
        far = np.where(cause == COLLISION, -1, cause)  # nearest to free: collision, then singular, limit, unreachable
        which = np.where(np.isfinite(mean).any(axis=0), mean.argmin(axis=0), far.argmin(axis=0))[None]
        best = [np.take_along_axis(part, which, axis=0)[0].T for part in (mean, cause, hit, how)]
        solved = np.where(self.grid.said == FREE, self.grid.mean_mm, np.inf).min(axis=0).T
        used = [int(i) for i in np.unique(best[2]) if i >= 0]
        number = {hit: i for i, hit in enumerate(used)}
        return PostureMap(
            rotations=self.grid.rotations,
            tables=self.grid.tables,
            mean_mm=np.where(best[1] == FREE, best[0], np.nan),
            cause=best[1],
            pair=np.vectorize(lambda i: number.get(int(i), -1), otypes=[int])(best[2]),
            pairs=tuple(examiner.screen.pair(i) for i in used),
            how=best[3],
            without_collision_mm=np.where(np.isfinite(solved), solved, np.nan),
        )


def _why_not(found: PostureMap) -> str:
    """What stands in the way everywhere, in one line."""
    shares = [
        f"{CAUSES[c]} {100 * np.mean(found.cause == c):.0f} %"
        for c in range(1, UNREACHABLE + 2)
        if (found.cause == c).any()
    ]
    pairs = [f"'{a}' with '{b}'" for a, b in found.pairs[:3]]
    return (
        "no cutter rotation and turntable angle lets the robot follow it; of the grid: "
        + ", ".join(shares)
        + (f" ({', '.join(pairs)})" if pairs else "")
    )
