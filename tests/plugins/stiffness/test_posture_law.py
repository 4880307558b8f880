"""Dynamic programming against every way there is."""

import dataclasses
import itertools
from typing import Any

import numpy as np
import pytest

from workbench.path import read
from workbench.plugins.stiffness import force
from workbench.plugins.stiffness.arm import GeneralArm, fast_arm
from workbench.plugins.stiffness.law import (
    STEP_COST_MM,
    Grid,
    Law,
    Limits,
    Nodes,
    best_law,
    constant_law,
    improved_law,
    nodes,
    relaxed_law,
    shift_of,
)
from workbench.plugins.stiffness.path_points import PathPoints, path_points
from workbench.plugins.stiffness.traversal import Examiner, search, traversal
from workbench.robot import Cell, CollisionModel, Margins, forward_kinematics, joint_axes
from workbench.units import Float

from .conftest import K
from .test_posture import PATH, thinned

RESTLESS, STEP, ACCELERATION = 1e-3, 0.5, 0.7
STEPS = tuple(itertools.product((-1, 0, 1), repeat=2))


def cheapest(cost: Float, joints: Float, free: Any, shift: Any, dt: Float, speed: Float) -> float:
    """The least cost of all ways through windows of nodes, one by one."""
    n, best = len(cost), np.inf
    window = cost.shape[1:]
    for first in itertools.product(*map(range, window)):
        for steps in itertools.product(STEPS, repeat=n - 1):
            way = [np.array(first)]
            for i, step in enumerate(steps, 1):
                way.append(way[-1] + step - shift[i])
            at = np.array(way)
            if (at < 0).any() or (at >= window).any() or not free[np.arange(n), at[:, 0], at[:, 1]].all():
                continue
            moved = np.diff(joints[np.arange(n), at[:, 0], at[:, 1]], axis=0)
            v = moved / dt[1:, None]
            gentle = (np.abs(np.diff(v, axis=0)) <= ACCELERATION * ((dt[1:-1] + dt[2:]) / 2)[:, None]).all(axis=1)
            rests = [step == (0, 0) for step in steps]
            moves = (np.abs(moved) <= STEP).all(axis=1) & (np.abs(v) <= speed).all(axis=1)
            good = all(ok or rest for ok, rest in zip(moves, rests, strict=True))
            # after a step or before one, the path's own motion counts too
            for i in range(n - 2):
                if not (rests[i] and rests[i + 1]):
                    good &= bool(gentle[i] and moves[i + 1])
            if good:
                total = cost[np.arange(n), at[:, 0], at[:, 1]].sum() + RESTLESS * float((np.array(steps) ** 2).sum())
                best = min(best, float(total))
    return best


@pytest.mark.parametrize("seed", range(5))
def test_the_way_is_the_cheapest_of_all(seed: int) -> None:
    rng, n, window = np.random.default_rng(seed), 5, (2, 3)
    cost = rng.uniform(0, 1, (n, *window))
    joints = rng.normal(0, 0.2, (n, *window, 2)) + 0.05 * np.arange(3)[:, None]
    free, dt, speed = rng.random((n, *window)) > 0.1, rng.uniform(0.8, 1.2, n), np.array([0.5, 0.6])
    shift = rng.integers(-1, 2, (n, 2))
    way = best_law(
        Nodes(np.where(free, cost, np.inf), joints),
        shift,
        dt,
        Limits(speed, np.full(2, ACCELERATION), STEP),
        np.array([1, 1]),
        RESTLESS,
    )
    least = cheapest(cost, joints, free, shift, dt, speed)
    if way[0, 0] < 0:
        assert least == np.inf
        return
    steps = np.diff(way, axis=0) + shift[1:]
    assert np.abs(steps).max() <= 1
    assert free[np.arange(n), way[:, 0], way[:, 1]].all()
    total = cost[np.arange(n), way[:, 0], way[:, 1]].sum() + RESTLESS * (steps**2).sum()
    assert np.isclose(total, least, rtol=1e-12)


def test_straight_on_is_always_a_way() -> None:
    """Rows far apart: only a law that never steps is allowed, and it is found."""
    rng, n = np.random.default_rng(3), 6
    joints = np.cumsum(rng.uniform(2, 3, (n, 1, 1, 1)), axis=0) + np.zeros((n, 3, 3, 2))
    cost = rng.uniform(0, 1, (n, 3, 3))
    way = best_law(
        Nodes(cost, joints),
        np.zeros((n, 2), int),
        np.ones(n),
        Limits(np.ones(2), np.ones(2), STEP),
        np.array([1, 1]),
        RESTLESS,
    )
    assert (way == way[0]).all()
    assert np.isclose(cost[:, way[0, 0], way[0, 1]].sum(), cost.sum(axis=0).min())


@pytest.fixture(scope="module")
def points() -> PathPoints:
    path = thinned(read(toolpath=PATH), 12)
    return path_points(path, force(path)[0], load="mean", reach_mm=6.5, planned=0.0)


@pytest.mark.parametrize("last_deg", [180.0, 75.0])  # a full turn, and less of one
def test_relaxed_law_is_the_best_by_plain_dynamic_programming(cell: Cell, points: PathPoints, last_deg: float) -> None:
    """On the whole grid with plain loops over steps; more points than are kept, so that the way back is computed."""
    longer = points.only(np.repeat(np.arange(len(points.layer)), 4)[:40])
    examiner = Examiner(cell, fast_arm(cell.chain, K), longer)
    rotations, tables = np.radians(np.arange(-180, last_deg, 15.0)), np.radians(np.arange(-90, -50, 5.0))
    grid = Grid(rotations, tables, np.array([1, 2]), 1e-4)
    found = relaxed_law(examiner, 0, grid, np.inf)
    assert found is not None
    turns, tables = np.meshgrid(grid.rotations, grid.tables)
    each = np.array(
        [nodes(examiner, flip, np.tile(turns, (40, 1, 1)), np.tile(tables, (40, 1, 1)))[0] for flip in (0, 1)]
    ).min(axis=0)
    value = each[0]
    for cost in each[1:]:
        wide = np.pad(value, ((0, 0), (2, 2)), **({"mode": "wrap"} if grid.closed else {"constant_values": np.inf}))
        near = [wide[:, 2 + d :][:, : value.shape[1]] + 1e-4 * d * d for d in (-2, -1, 0, 1, 2)]
        along = np.pad(np.minimum.reduce(near), ((1, 1), (0, 0)), constant_values=np.inf)
        value = cost + np.minimum.reduce([along[1 + e : 9 + e] + 1e-4 * e * e for e in (-1, 0, 1)])
    assert np.isclose(found.cost_mm, value.min(), rtol=1e-12)
    steps = shift_of(found.way, grid)
    assert (np.abs(steps) <= grid.bands).all()
    total = each[np.arange(40), found.way[:, 0], found.way[:, 1]].sum() + 1e-4 * (steps**2).sum()
    assert np.isclose(total, found.cost_mm, rtol=1e-12)
    assert relaxed_law(examiner, 0, grid, found.cost_mm * 0.999) is None


def test_a_law_stays_where_the_arm_reaches(cell: Cell, points: PathPoints) -> None:
    """Of a robot whose zero is a posture like any other: it is none for places that nothing reaches."""
    zero = np.radians([0, 20, 10, 0, 60, 0])
    axes, feet = joint_axes(cell.chain, zero)
    there = {"axes": axes, "points_mm": feet, "base_from_flange_at_zero": forward_kinematics(cell.chain, zero)}
    chain = dataclasses.replace(cell.chain, **there, limits=cell.chain.limits - zero[:, None])
    off = points.base_from_point + 5e3 * np.outer(np.eye(4)[0], np.eye(4)[3])
    still = np.zeros((len(points.layer), 1, 1))
    for at, reached in ((points.base_from_point, True), (off, False)):
        placed = dataclasses.replace(points, base_from_point=at)
        examiner = Examiner(dataclasses.replace(cell, chain=chain), GeneralArm(chain, K), placed)
        assert (nodes(examiner, 0, still + np.pi / 2, still - 1.3)[0].min() < np.inf) == reached


def law_of(cell: Cell, points: PathPoints, bands: tuple[int, int], limits: Limits) -> tuple[Law, Law, float]:
    """Best constant pair, law and bound on a grid of 2 deg; no margins, which would leave the turntable no gain."""
    cell = dataclasses.replace(cell, margins=Margins(limit=0.0, wrist=0.0, condition=1e6), margin_mm=0.0)
    examiner, angles = Examiner(cell, fast_arm(cell.chain, K), points), np.radians(np.arange(-180, 180, 2.0))
    choice, _ = search(examiner, traversal(examiner.arm, cell, points, angles, angles))
    start = constant_law(examiner, choice)
    grid = Grid(angles, angles, np.array(bands), STEP_COST_MM)
    return start, *improved_law(examiner, start, grid, limits)


def test_laws_of_both_angles_of_one_and_of_none(cell: Cell, points: PathPoints) -> None:
    """Each is no worse than the next, no better than its bound, within its steps and free of collision."""
    limits = Limits(np.append(cell.chain.speeds, 0.5), np.full(7, 2.0))
    model = CollisionModel(dataclasses.replace(cell, margin_mm=0.0, margins=Margins()))
    costs = []
    for bands in ((2, 2), (0, 2)):
        start, law, bound = law_of(cell, points, bands, limits)
        assert bound <= law.cost_mm * (1 + 1e-9)
        assert law.cost_mm < start.cost_mm
        assert np.ptp(law.table) > 0 if bands[0] else np.ptp(law.table) == 0
        turned = (np.diff(law.rotation) + np.pi) % (2 * np.pi) - np.pi
        assert np.abs(turned).max() <= np.radians(4) + 1e-9
        assert np.abs(np.diff(law.table)).max() <= np.radians(4) + 1e-9
        assert not any(model.collision(q, a) for q, a in zip(law.joints, law.table, strict=True))
        assert (np.abs(np.diff(law.joints, axis=0)) / points.time_steps_s[1:, None] <= limits.speed[:6]).all()
        costs += [law.cost_mm, start.cost_mm]
    assert costs[0] < costs[2] < costs[1]
    assert costs[1] == costs[3]


def test_where_nothing_may_move_the_law_is_the_constant_one(cell: Cell, points: PathPoints) -> None:
    """Speeds of next to nothing: every step is forbidden, and the bound says so much."""
    still = Limits(np.full(7, 1e-9), np.full(7, 1e-9))
    start, law, bound = law_of(cell, points, (2, 2), still)
    assert np.ptp(law.rotation) == np.ptp(law.table) == 0
    assert bound < law.cost_mm <= start.cost_mm
