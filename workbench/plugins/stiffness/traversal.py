"""The traversal of eq. (25): mean displacement for every cutter rotation and turntable angle, in every branch.

And which cells of its grid the robot can really mill in: one configuration all along, free of collision. The one of
least mean displacement is found by best-first search.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from workbench.api import (
    DEG,
    SIDES,
    AnyArray,
    Bool,
    Cell,
    Chain,
    CollisionScreen,
    Float,
    InputError,
    Int,
    Shaped,
    arm_sides,
    dexterity,
    forward_kinematics,
    inverse,
    refusal,
    turn_about_z,
    turntable_at_home,
    within_margins,
)
from workbench.plugins.stiffness.arm import (
    BRANCHES,
    FREE,
    LIMIT,
    SINGULAR,
    AnyArm,
    LoadedPath,
    Unsprung,
    awkwardness,
)
from workbench.plugins.stiffness.elastic import pushed
from workbench.plugins.stiffness.margins import Steadiness
from workbench.plugins.stiffness.path_points import PathPoints

MOST_STEP = 15 * DEG  # of a joint between neighbouring points: beyond it the wrist swings through its singularity
COLLISION = 4  # beside what an arm says of a posture
CONFIGURATIONS = 2 * BRANCHES  # the rows of the inverse kinematics; one is kept all along a path
EVERY = np.ones(CONFIGURATIONS, bool)  # all of them are allowed
SOLVED, SAMPLED, EVERY_POINT, PROVEN = range(4)
# by joint angles alone; by a fault at some places; at every point where doubtful, else proven; proven all along
JUDGED = ("solved", "sampled", "every point", "proven")
STATION_MM, LEVER_MM, CHORD_MM = 12.0, 150.0, 0.2  # of stations: their step, what a turn counts, off the chord
# Relative change of a condition number when the joints move, in units of the number itself and of their moves in rad,
# summed: at most 0.19 in 300,000 random postures with numbers from 5 to 50.
STEEPEST = 0.25
HOME_PLACES = 12  # on the way between home and the path, before the judge drives it
EXACT = 1e-6  # to which joint angles have their pose, mm
SAMPLED_AT = 16  # stations at which a cell's margins to singular postures are looked at
CAUSES = (None, "singular", "limit", "unreachable", "collision")

FIRST_CHUNK, LARGEST_CHUNK = 64, 1024
POSTURES = 400  # at which the configurations' names are found


@dataclass(frozen=True, slots=True, eq=False)
class Traversal:
    """Eq. (25)'s function on its grid, without collision; t cutter rotations and a turntable angles, rad."""

    rotations: Shaped[Float, " t"]
    tables: Shaped[Float, " a"]
    mean: Shaped[Float, "8 a t"]  # cost by configuration: displacement in mm, or awkwardness; inf: not solved
    said: Shaped[AnyArray, "8 a t"]  # FREE ... UNREACHABLE: 0 where joint angles exist

    def ranked(self, allowed: Bool) -> Int:
        """Flat indices of all solved (configuration, turntable, rotation) of `allowed` (8,), their mean rising."""
        flat = np.flatnonzero((self.said == FREE) & allowed[:, None, None])
        return flat[np.argsort(self.mean.reshape(-1)[flat], kind="stable")]

    def thinned(self, every: int, rotation: float, table: float) -> Traversal:
        """Every so many-th angle both ways, those of a cell of the grid among them."""
        t, a = (int(np.abs(at - of).argmin()) % every for at, of in ((self.rotations, rotation), (self.tables, table)))
        cells = (slice(None), slice(a, None, every), slice(t, None, every))
        mean, said = np.ascontiguousarray(self.mean[cells]), np.ascontiguousarray(self.said[cells])
        return Traversal(self.rotations[t::every], self.tables[a::every], mean, said)


Share = Callable[[float], None]  # is told how much of the work is done


def silent(share: float) -> None:
    """Nobody listens."""


def within(progress: Share | None, low: float, high: float) -> Share:
    """Progress of a part that makes up the shares `low` to `high` of the whole."""
    return silent if progress is None else lambda share: progress(low + (high - low) * share)


def sample(points: PathPoints, count: int) -> Int:
    """Indices of at most `count` loaded points, evenly spread with both ends, and a quarter as many others."""
    loaded = points.loaded
    air = np.setdiff1d(np.arange(len(points.layer)), loaded)
    return np.sort(np.concatenate([spread(loaded, count), spread(air, max(count // 4, 2))]))


def spread(indices: Int, count: int) -> Int:
    """At most `count` of `indices`, evenly, the first and the last among them."""
    at = np.linspace(0, len(indices) - 1, min(count, len(indices))).round().astype(int)
    return np.asarray(indices[np.unique(at)])


def traversal(arm: AnyArm, cell: Cell, points: PathPoints, rotations: Float, tables: Float) -> Traversal:
    """Mean displacement of the loaded points, and what stands in the way of joint angles at any point."""
    path = placed(cell, points, tables)
    found = [arm.traverse(path, rotations, branch) for branch in range(BRANCHES)]
    mean, said = (np.concatenate(part) for part in zip(*found, strict=True))
    return Traversal(rotations, tables, mean * (len(points.layer) / len(points.loaded)), said)


def lowest(arm: AnyArm, cell: Cell, points: PathPoints, rotations: Float, tables: Float) -> Float:
    """The least displacement (n,) of each loaded point over the grid in any branch: nothing that turns gives less."""
    path = placed(cell, points.only(points.loaded), tables)
    least = np.full(len(points.loaded), np.inf)
    for a, branch in np.ndindex(len(tables), BRANCHES):
        each = LoadedPath(path.flange_from_cutter, *(part[a][:, None] for part in path[1:]))  # a path of its own
        mean, said = arm.traverse(each, rotations, branch)
        np.minimum(least, np.where(said == FREE, mean, np.inf).min(axis=(0, 2)), out=least)
    return least


def placed(cell: Cell, points: PathPoints, tables: Float) -> LoadedPath:
    """The path where the turntable brings it, for each of its angles (a,)."""
    motion = points.motion(cell, tables[:, None], np.arange(len(points.layer))[None])
    at = motion @ points.base_from_point
    force = (motion[..., :3, :3] @ points.force_n[..., None])[..., 0]
    return LoadedPath(cell.flange_from_cutter, at @ points.point_from_tip, at[..., :3, 3], force)


def flange_poses(cell: Cell, points: PathPoints, at: Int, rotation: Float, table: Float) -> Float:
    """Poses of the flange (..., 4, 4) at points (...), with cutter and turntable turned by (...); all broadcast."""
    tool = turn_about_z(rotation) @ inverse(cell.flange_from_cutter)
    return points.motion(cell, table, at) @ (points.base_from_point[at] @ points.point_from_tip) @ tool


def words_of(arm: AnyArm, chain: Chain) -> list[tuple[str, ...]]:
    """What each of the configurations is called by the sides of the arm (`arm_sides`)."""
    low, high = np.clip(chain.limits.T, -np.pi, np.pi)
    q = np.random.default_rng(0).uniform(low, high, (POSTURES, 6))
    flange, sides = forward_kinematics(chain, q), arm_sides(chain, q).astype(int)
    every = np.array([arm.joint_angles(flange, i) for i in range(CONFIGURATIONS)])
    found = np.abs((every - q + np.pi) % (2 * np.pi) - np.pi).max(axis=2).argmin(axis=0)
    named = [np.round(sides[found == i].mean(axis=0)).astype(int) for i in range(CONFIGURATIONS)]
    return [tuple(pair[side] for pair, side in zip(SIDES, one, strict=True)) for one in named]


class Examiner:
    """Asks whether a path can be milled with a constant cutter rotation and turntable angle."""

    def __init__(self, cell: Cell, arm: AnyArm, points: PathPoints, keeps: Steadiness | None = None) -> None:
        """Build once, ask often; the cell is as its file says, and a margin from chatter may have to be kept."""
        self.keeps = keeps
        self.whole, self.cell, self.arm, self.points = cell, within_margins(cell), arm, points
        self.screen = CollisionScreen(self.cell)
        part_link = -1 if cell.turntable is None else 7  # values of `Shape.link`: what stands still with the part
        links = np.array([[cell.shapes[i].link for i in pair] for pair in self.screen.model.pairs]).reshape(-1, 2)
        # of pairs, which are of the tool and of what goes with the part
        self.on_part = (links == 6).any(axis=1) & (links == part_link).any(axis=1)
        self.dense = points.densified(STATION_MM)  # as the tool goes from point to point

    def _back(self, flange: Float, distance_mm: float) -> Float:
        """Poses (m, 4, 4) of the flange so far back along the cutter's axis."""
        back = flange.copy()
        back[:, :3, 3] -= distance_mm * (flange @ self.cell.flange_from_cutter)[:, :3, 2]
        return back

    def examine(self, configuration: Int, rotation: Float, table: Float, *, few: bool = False) -> Int:
        """Of cells (c,), each in one configuration all along: cause, hit (pair of bodies, or -1) and how (3, c).

        Joint angles and their limits at the stations. Bodies are proven apart along the whole way or, round the
        stations where that fails, asked of fcl at every point. Margins to singular postures at SAMPLED_AT stations.
        `few`: of bodies alone, at three places; what is free there may not be all along.
        """
        made = np.empty((3, len(configuration)), int)
        for which in np.unique(configuration).tolist():
            some = np.flatnonzero(configuration == which)
            made[:, some] = (self._met if few else self._judged)(which, rotation[some], table[some])
        return made

    def _met(self, configuration: int, rotation: Float, table: Float) -> Int:
        """As `examine`, before the path, behind it and at its middle, whatever the joints' limits."""
        hit, process, last = np.full(len(table), -1), self.whole.process, len(self.points.layer) - 1
        away = (0.0, 0.0) if process is None else (process.approach_mm, process.retract_mm)
        for at, back_mm in zip(np.array([0, last, last // 2]), (*away, 0.0), strict=True):
            left = np.flatnonzero(hit < 0)
            flange = self._back(flange_poses(self.cell, self.points, at, rotation[left], table[left]), back_mm)
            joints = self.arm.joint_angles(flange, configuration)
            reached = np.abs(forward_kinematics(self.cell.chain, joints) - flange).max(axis=(1, 2)) < EXACT
            some = left[reached]
            hit[some] = self.screen.hits(joints[reached], self.points.external(table[some], np.full(len(some), at)))
        return np.stack([np.where(hit < 0, FREE, COLLISION), hit, np.full(len(hit), SAMPLED)])

    def _judged(self, configuration: int, rotation: Float, table: Float) -> Int:
        """As `examine`, in one configuration."""
        flange = flange_poses(self.cell, self.dense, self._stations[None], rotation[:, None], table[:, None])
        count, places = flange.shape[:2]
        joints = self.arm.joint_angles(flange.reshape(-1, 4, 4), configuration).reshape(count, places, 6)
        joints, within = followed(self.cell.chain, joints)
        cause, inside = np.full(count, LIMIT), np.flatnonzero(within)
        poor = self.poor(joints[inside][:, spread(np.arange(places), SAMPLED_AT)])
        said = np.where((poor == LIMIT).any(axis=1), LIMIT, FREE)
        said[(poor == SINGULAR).any(axis=1)] = SINGULAR
        hit, how = np.full(count, -1), np.full(count, SAMPLED)
        for end in (0, -1):
            still = np.flatnonzero(said == FREE)
            cells, at = inside[still], np.full(len(still), end % len(self.points.layer))
            there = flange[cells, end], table[cells], joints[cells, end]
            said[still], hit[cells] = self.away(configuration, at, *there)
        cause[inside] = said
        asked = inside[said == FREE]
        fast = (np.abs(np.diff(joints[asked], axis=1)) > MOST_STEP).any(axis=(1, 2))
        for i in asked[fast].tolist():
            _, cause[i], hit[i] = self.along(configuration, rotation[i], table[i])
            how[i] = EVERY_POINT
        asked = asked[~fast]
        open_ = self.screen.swept(joints[asked], self.dense.external(table[asked, None], self._stations[None]))
        how[asked] = np.where(open_.any(axis=1), EVERY_POINT, PROVEN)
        doubtful = np.flatnonzero(open_.any(axis=1))
        some = asked[doubtful]
        hit[some] = self._hits(configuration, joints[some], open_[doubtful], rotation[some], table[some])
        cause[some[hit[some] >= 0]] = COLLISION
        return np.stack([cause, hit, how])

    def _hits(self, configuration: int, joints: Float, open_: Bool, rotation: Float, table: Float) -> Int:
        """The first hit (c,) of paths with joints (c, s, 6) at the stations, or -1; where they are `open_` (c, s)."""
        found = np.full(len(joints), -1)
        first, last = open_.argmax(axis=1), open_.shape[1] - 1 - open_[:, ::-1].argmax(axis=1)
        for at in (first, last, (first + last) // 2):  # a hit spares the rest
            rest = np.flatnonzero(found < 0)
            external = self.dense.external(table[rest], self._stations[at[rest]])
            found[rest] = self.screen.hits(joints[rest, at[rest]], external)
        for rest in np.array_split(np.flatnonzero(found < 0), max(len(joints) // 256, 1)):
            which, at = np.nonzero(open_[rest][:, self._owner])
            if not len(which):
                continue
            of = rest[which]
            flange = flange_poses(self.cell, self.dense, at, rotation[of], table[of])
            hits = self.screen.hits(self.arm.joint_angles(flange, configuration), self.dense.external(table[of], at))
            found[of[hits >= 0]] = hits[hits >= 0]
        return found

    @functools.cached_property
    def _stations(self) -> Int:
        """Points of the path, in their order, so near each other that what lies between them is nearly a chord."""
        every, lever = np.arange(len(self.dense.layer)), self.points.point_from_tip[:3, 3]
        poses = self.dense.motion(self.cell, np.zeros(1), every) @ self.dense.base_from_point
        at = poses[:, :3, 3] + poses[:, :3, :3] @ lever
        there = np.column_stack([at, LEVER_MM * poses[:, :3, :3].reshape(-1, 9), self.dense.drift / DEG])
        chosen, n = [0], len(there)
        while chosen[-1] < n - 1:
            a = chosen[-1]
            b = a + 1
            while b + 1 < n and _is_chord(there[a : b + 2]):
                b += 1
            chosen.append(b)
        return np.array(chosen)

    @functools.cached_property
    def _owner(self) -> Int:
        """The station (n,) that is nearest to each point along the path."""
        at = self._stations
        return np.searchsorted((at[1:] + at[:-1]) / 2, np.arange(len(self.dense.layer)))

    def along(self, configuration: int, rotation: float, table: float) -> tuple[Float, int, int]:
        """Joint angles (n, 6) at all points for a rotation and a turntable angle, the cause against it, the hit."""
        every = np.arange(len(self.points.layer))
        flange = flange_poses(self.cell, self.points, every, np.array(rotation), np.array(table))
        joints, inside = followed(self.cell.chain, self.arm.joint_angles(flange, configuration)[None])
        if not inside[0]:
            return joints[0], LIMIT, -1
        poor = self.poor(joints)[0]
        if (np.abs(np.diff(joints[0], axis=0)) > MOST_STEP).any() or (poor == SINGULAR).any():
            return joints[0], SINGULAR, -1
        if (poor == LIMIT).any():
            return joints[0], LIMIT, -1
        hits = self.screen.hits(joints[0], self.points.external(np.full(len(every), table), every))
        return joints[0], COLLISION if hits.max() >= 0 else FREE, int(hits.max())

    def away(self, configuration: int, at: Int, flange: Float, table: Float, near: Float) -> tuple[Int, Int]:
        """The cause against where the program comes from to the first, and goes to from the last point; and the hit.

        FREE and -1 for other points among `at` (m,). Both lie along the cutter's axis from poses (m, 4, 4), with joints
        near (m, 6); between them and home some places are looked at.
        """
        said, hit, process = np.full(len(at), FREE), np.full(len(at), -1), self.whole.process
        if process is None:
            return said, hit
        home = process.home.joints
        for end, distance_mm in ((0, process.approach_mm), (len(self.points.layer) - 1, process.retract_mm)):
            rows = np.flatnonzero(at == end)
            joints = self.arm.joint_angles(self._back(flange[rows], distance_mm), configuration)
            joints += 2 * np.pi * np.round((near[rows] - joints) / (2 * np.pi))
            low, high = self.cell.chain.limits.T
            within = ((joints >= low) & (joints <= high)).all(axis=1)  # false where nothing reaches it
            said[rows[~within]] = LIMIT
            rows, joints = rows[within], joints[within]
            said[rows] = self.poor(joints)
            free = said[rows] == FREE
            rows, joints = rows[free], joints[free]
            for share in np.linspace(1.0, 0.0, HOME_PLACES):
                left = hit[rows] < 0
                here = rows[left]
                target = self.points.external(table[here], at[here])
                stands = np.array([turntable_at_home(process.home, one / DEG) for one in target]).reshape(target.shape)
                external = stands * DEG + share * (target - stands * DEG)
                hit[here] = self.screen.hits(home + share * (joints[left] - home), external)
            said[rows[hit[rows] >= 0]] = COLLISION
        return said, hit

    def driven(self, configuration: int, rotation: float, table: float) -> tuple[Float, int, int]:
        """As `along`; then as the judge of programs drives them: between the points, and from home and back."""
        joints, cause, hit = self.along(configuration, rotation, table)
        if cause != FREE:
            return joints, cause, hit
        external = self.points.external(np.full(len(joints), table), np.arange(len(joints)))
        reason = refusal(self.whole, joints, external, self.points.feed_mm_s, int(self.points.cutting.argmax()))
        if reason is None:
            return joints, FREE, -1
        kind, pair = reason
        cause = CAUSES.index(kind) if kind in CAUSES else LIMIT
        return joints, cause, self.screen.which(pair) if cause == COLLISION else -1

    def margins(self, configuration: Int, rotation: Float, table: Float) -> Float:
        """Least margin from chatter, and the same less U (2, c), by the screen, of cells (c,) that are free."""
        assert self.keeps is not None
        at, found = self.keeps.few.at, np.empty((2, len(table)))
        for which in np.unique(configuration).tolist():
            some = np.flatnonzero(configuration == which)
            of = at[None], rotation[some, None], table[some, None]
            flange = flange_poses(self.cell, self.points, *of).reshape(-1, 4, 4)
            joints = self.arm.joint_angles(flange, which).reshape(len(some), len(at), 6)
            found[:, some] = self.keeps.margins(joints, self.points.motion(self.cell, of[2], of[0]))
        return found

    def falls_to(self, joints: Float, table: float, *, everywhere: bool = False) -> float:
        """The judge's margin from chatter less U of joints (n, 6) at all points, where it is first below the one asked.

        Infinite where it nowhere is. everywhere: the least all along the path, whatever was asked.
        """
        assert self.keeps is not None
        motion = self.points.motion(self.cell, np.full(len(joints), table), np.arange(len(joints)))
        return (self.keeps.least if everywhere else self.keeps.falls_to)(joints, motion)

    def cost(self, joints: Float, table: Float, at: Int) -> Float:
        """Displacement (m,), or awkwardness where no springs are known, at points `at` (m,) with joints (m, 6)."""
        if isinstance(self.arm, Unsprung):
            return np.where(np.isin(at, self.points.loaded), awkwardness(self.cell, joints), 0.0)
        return np.asarray(np.linalg.norm(self.moved_mm(joints, table, at), axis=1))

    def moved_mm(self, joints: Float, table: Float, at: Int) -> Float:
        """Displacement (m, 3), base axes, at points `at` (m,) with joints (m, 6); NaN where no springs are known."""
        if isinstance(self.arm, Unsprung):
            return np.full((len(at), 3), np.nan)
        motion = self.points.motion(self.cell, table, at)
        push = (motion[:, :3, :3] @ self.points.force_n[at, :, None])[:, :, 0]
        place = (motion @ self.points.base_from_point[at])[:, :3, 3]
        return pushed(self.cell.chain, self.arm.springs, joints, place, push)

    def poor(self, joints: Float) -> Int:
        """What the margins have against each posture (..., 6): SINGULAR, LIMIT, or FREE; limits are looked at before.

        LIMIT: the joints that stand within their limits could be asked to leave them by what tool and part are off, and
        by what a program is off its postures.
        """
        margins, chain, flat = self.cell.margins, self.cell.chain, joints.reshape(-1, 6)
        tip = (forward_kinematics(chain, flat) @ self.cell.flange_from_cutter)[:, :3, 3]
        twists = np.stack([margins.twist, margins.written])
        wrist, condition, (asked, written) = dexterity(chain, flat, tip, twists, margins.condition / 2)
        room = np.minimum(flat - chain.limits[:, 0], chain.limits[:, 1] - flat)
        said = np.where((room < asked + written).any(axis=1), LIMIT, FREE)
        condition *= 1 + STEEPEST * condition * written.sum(axis=1)
        said[(wrist < margins.wrist + written[:, 4]) | (condition > margins.condition)] = SINGULAR
        return said.reshape(joints.shape[:-1])


def _is_chord(there: Float) -> bool:
    """Whether places (k, 13) are no farther apart than a station's step, and lie on the chord from first to last."""
    chord = there[-1] - there[0]
    square = chord @ chord
    if square > STATION_MM**2:
        return False
    share = np.clip((there - there[0]) @ chord / max(square, 1e-12), 0.0, 1.0)
    return bool(np.linalg.norm(there - there[0] - share[:, None] * chord, axis=1).max() <= CHORD_MM)


def followed(chain: Chain, joints: Float) -> tuple[Float, Bool]:
    """Joint angles (c, p, 6) along paths without jumps of a turn, and whether they lie within limits (c,)."""
    turn, (low, high) = 2 * np.pi, chain.limits.T
    q = np.unwrap(joints, axis=1)
    least = np.ceil((low - 1e-9 - q.min(axis=1)) / turn)
    most = np.floor((high + 1e-9 - q.max(axis=1)) / turn)
    shift = np.clip(np.round(-q.mean(axis=1) / turn), least, most)
    return q + turn * shift[:, None], (least <= most).all(axis=1)


# The best cell of the grid.


@dataclass(frozen=True, slots=True, eq=False)
class Choice:
    """The best constant cutter rotation and turntable angle."""

    rotation: float
    table: float
    configuration: int  # kept all along the path
    joints: Shaped[Float, "n 6"]  # at all points
    mean: float  # cost over the points that are averaged
    examined: int  # cells that were better or equal, itself included, each configuration by itself
    of: int  # cells of the grid
    steady: bool = True  # the margin from chatter that was asked for is kept
    margin: float | None = None  # from chatter less U, as its judge has it; None: not asked for

    @property
    def rank(self) -> tuple[bool, float]:
        """Greater of the better one: the lower cost, or where none keeps the margin from chatter the greater margin."""
        return self.steady, -self.mean if self.steady or self.margin is None else self.margin


@dataclass(frozen=True, slots=True, eq=False)
class PostureMap:
    """Eq. (25)'s function over t cutter rotations and a turntable angles; NaN and the cause where infeasible."""

    rotations: Shaped[Float, " t"]
    tables: Shaped[Float, " a"]
    mean: Shaped[Float, "t a"]
    cause: Shaped[Int, "t a"]  # index into `traversal.CAUSES`
    pair: Shaped[Int, "t a"]  # index into `pairs`, -1: no collision
    pairs: tuple[tuple[str, str], ...]
    how: Shaped[Int, "t a"]  # index into `traversal.JUDGED`
    without_collision: Shaped[Float, "t a"]
    chatter: Shaped[Float, "2 t a"] | None = None  # margin, and the same less U where it is large enough; by the screen

    def shares(self, digits: int, causes: Iterable[int]) -> list[str]:
        """How much of the map each cause takes, in words."""
        every = ((CAUSES[c], np.mean(self.cause == c)) for c in causes)
        return [f"{name} {100 * share:.{digits}f} %" for name, share in every if share]


def search(
    examiner: Examiner, grid: Traversal, allowed: Bool = EVERY, progress: Share = silent, below: float = np.inf
) -> tuple[Choice, PostureMap]:
    """Cells in a configuration of `allowed` (8,) in the order of their means, up to one free with a mean `below`.

    All better cells are proven infeasible, or too near to chatter, so the choice is the optimum of the grid. The map
    holds what was found on the way: cells that are worse count as free. Where none keeps the margin from chatter, the
    cell with the greatest is taken.

    Raises:
        InputError: no cell is free; the line says what stands in the way.
    """
    state, ranked, start, size = _State(examiner, grid), grid.ranked(allowed), 0, FIRST_CHUNK
    ranked = ranked[grid.mean.reshape(-1)[ranked] < below]
    while start < len(ranked):
        flat = ranked[start : start + size]
        flat = flat[state.cause[flat] == FREE]
        progress(start / len(ranked))
        free = flat[state.examine(flat, first=True) == FREE]
        for one in free[state.steady(free)].tolist():
            if state.is_driven(one) and state.keeps_margin(one):
                state.judge(one)
                return state.choice(one), state.map()
        start, size = start + size, min(2 * size, LARGEST_CHUNK)
    while not np.isnan(short := np.where(state.cause == FREE, state.margin[1], np.nan)).all():
        one = int(np.nanargmax(short))
        if state.is_driven(one) and state.is_greatest(one):
            return replace(state.choice(one), steady=False), state.map()
    raise InputError(examiner.points.source, _why_not(state.map(), allowed))


def mapped(examiner: Examiner, grid: Traversal, progress: Share = silent) -> PostureMap:
    """The grid with the best free configuration of each cell, or with what stands in the way of all.

    No cell is called free that was not judged along the whole path: the map says how (`how`).
    """
    state, open_, size = _State(examiner, grid), grid.ranked(EVERY), FIRST_CHUNK
    most = len(open_)
    while len(open_):
        progress(1 - len(open_) / most)
        open_ = open_[~state.settled[open_ % state.cells] & (state.cause[open_] == FREE)]
        first = np.sort(np.unique(open_[:size] % state.cells, return_index=True)[1])  # of each cell the best
        state.examine(open_[first])
        open_, size = np.delete(open_, first), min(2 * size, LARGEST_CHUNK)
    return state.map(margins=True)


class _State:
    """What is known of each (configuration, turntable, rotation)."""

    def __init__(self, examiner: Examiner, grid: Traversal) -> None:
        self.examiner, self.grid = examiner, grid
        self.said = np.repeat([[FREE], [-1], [SOLVED]], grid.said.size, axis=1)
        self.cause, self.hit, self.how = self.said  # views
        self.cause[:] = grid.said.reshape(-1)
        self.cells = grid.said[0].size
        self.settled = np.zeros(self.cells, bool)  # it is free in a configuration
        self.margin = np.full((2, self.cause.size), np.nan)  # from chatter, and the same less U
        self.driven: Float = np.empty((0, 6))  # joint angles of the cell that was driven last
        self.examined = 0

    def place(self, flat: Int | int) -> tuple[Any, Any, Any]:
        """Configuration, rotation and turntable angle of cells (c,), or of one."""
        which, table, rotation = np.unravel_index(flat, self.grid.said.shape)
        return which, self.grid.rotations[rotation], self.grid.tables[table]

    def examine(self, flat: Int, *, first: bool = False) -> Int:
        """What stands in the way of each; `first`: it is looked for at a few places, then where none is all along."""
        self.examined += len(flat)
        for few in (True, False)[not first :]:
            rest = flat[self.cause[flat] == FREE]
            if len(rest):
                found = self.examiner.examine(*self.place(rest), few=few)
                self.note(rest, found)
                self._spread(rest[few | (found[2] == EVERY_POINT)])
        return np.asarray(self.cause[flat])

    def steady(self, flat: Int) -> Bool:
        """Which free cells keep the margin from chatter."""
        keeps = self.examiner.keeps
        if keeps is None:
            return np.ones(len(flat), bool)
        new = flat[np.isnan(self.margin[0, flat])]
        if len(new):
            self.margin[:, new] = self.examiner.margins(*self.place(new))
        return np.asarray(self.margin[1, flat] >= keeps.asked)

    def is_driven(self, one: int) -> bool:
        """Whether a free cell is so as it is driven."""
        which, rotation, table = self.place(one)
        self.driven, cause, hit = self.examiner.driven(int(which), rotation, table)
        if cause != FREE:
            self.note(np.array([one]), np.array([[cause], [hit], [EVERY_POINT]]))
        return bool(cause == FREE)

    def keeps_margin(self, one: int) -> bool:
        """Whether the cell that was driven last keeps the margin by chatter's judge, who overrules the screen."""
        if self.examiner.keeps is None:
            return True
        margin = self.examiner.falls_to(self.driven, self.place(one)[2])
        if np.isfinite(margin):
            self.margin[1, one] = margin
        return not np.isfinite(margin)

    def judge(self, one: int) -> None:
        """Note the least margin, less U, that chatter's judge finds for the cell that was driven last."""
        if self.examiner.keeps is not None:
            self.margin[1, one] = self.examiner.falls_to(self.driven, self.place(one)[2], everywhere=True)

    def is_greatest(self, one: int) -> bool:
        """Whether no other free cell may have a greater margin than the one that was driven last has by the judge."""
        self.judge(one)
        return bool(self.margin[1, one] >= np.nanmax(np.where(self.cause == FREE, self.margin[1], np.nan)))

    def choice(self, one: int) -> Choice:
        """The cell that was driven last."""
        which, rotation, table = self.place(one)
        margin = None if self.examiner.keeps is None else float(self.margin[1, one])
        joints, of, mean = self.driven, self.grid.said[0].size, self.grid.mean.reshape(-1)[one]
        return Choice(rotation, float(table), int(which), joints, mean, self.examined, of, margin=margin)

    def _spread(self, flat: Int) -> None:
        """What the tool hits on the part along the path it hits in every posture of that cutter rotation."""
        hits = flat[np.append(self.examiner.on_part, False)[self.hit[flat]]]
        turns = len(self.grid.rotations)
        for turn, hit in dict(zip((hits % turns).tolist(), self.hit[hits].tolist(), strict=True)).items():
            every = np.arange(turn, self.cause.size, turns)
            self.said[:, every[self.cause[every] == FREE]] = [[COLLISION], [hit], [EVERY_POINT]]

    def note(self, flat: Int, found: Int) -> None:
        """What is found (3, c) of cells (c,)."""
        self.said[:, flat] = found
        self.settled[(flat % self.cells)[found[0] == FREE]] = True

    def map(self, *, margins: bool = False) -> PostureMap:
        """The best free configuration of each cell, or the cause of the one that came farthest.

        `margins`: from chatter, of all that are free; else of those only whose margin was asked.
        """
        shape, screen = self.grid.said.shape, self.examiner.screen
        cause, hit, how = self.said.reshape(3, *shape)
        mean = np.where(cause == FREE, self.grid.mean, np.inf)
        far = np.where(cause == COLLISION, -1, cause)  # nearest to free: collision, then singular, limit, unreachable
        which = np.where(np.isfinite(mean).any(axis=0), mean.argmin(axis=0), far.argmin(axis=0))[None]
        best = [np.take_along_axis(part, which, axis=0)[0].T for part in (mean, cause, hit, how)]
        solved = np.where(self.grid.said == FREE, self.grid.mean, np.inf).min(axis=0).T
        used = [int(i) for i in np.unique(best[2]) if i >= 0]
        flat = which[0] * self.cells + np.arange(self.cells).reshape(shape[1:])  # (a, t)
        if margins:
            self.steady(flat.T[best[1] == FREE])
        return PostureMap(
            rotations=self.grid.rotations,
            tables=self.grid.tables,
            mean=np.where(best[1] == FREE, best[0], np.nan),
            cause=best[1],
            pair=np.where(best[2] < 0, -1, np.searchsorted(used, best[2])),
            pairs=tuple(screen.pair(i) for i in used),
            how=best[3],
            without_collision=np.where(np.isfinite(solved), solved, np.nan),
            chatter=None if self.examiner.keeps is None else np.where(best[1] == FREE, self.margin[:, flat.T], np.nan),
        )


def _why_not(found: PostureMap, allowed: Bool) -> str:
    """What stands in the way everywhere, in one line."""
    pairs = [f"'{a}' with '{b}'" for a, b in found.pairs[:3]]
    return (
        "no cutter rotation and turntable angle lets the robot follow it"
        + ("; of the grid: " if allowed.all() else " in the `configuration` asked for; of the grid in any: ")
        + ", ".join(found.shares(0, range(1, len(CAUSES))))
        + (f" ({', '.join(pairs)})" if pairs else "")
    )
