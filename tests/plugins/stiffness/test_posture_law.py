"""Dynamic programming against every way there is; joint angles of the fast kernel against the closed-form inverse."""

import itertools
from typing import Any

import numpy as np
import pytest

from workbench.plugins.stiffness.arm import displacements, fast_arm, joint_angles
from workbench.plugins.stiffness.law_kernel import best_law
from workbench.robot import Cell, forward_kinematics, inverse_kinematics
from workbench.units import Float

from .conftest import K

BAND, RESTLESS, STEP = 1, 1e-3, 0.5


def cheapest(
    cost: Float, joints: Float, free: Any, dt: Float, speed: Float, acceleration: float, closed: bool
) -> float:
    """The least cost of all ways, one by one."""
    n, k = cost.shape
    best = np.inf
    for first in range(k):
        for steps in itertools.product((-1, 0, 1), repeat=n - 1):
            way = first + np.append(0, np.cumsum(steps))
            way = way % k if closed else way
            if way.min() < 0 or way.max() >= k or not free[np.arange(n), way].all():
                continue
            moved = np.diff(joints[np.arange(n), way], axis=0)
            v = moved / dt[1:, None]
            a = np.diff(v, axis=0) / ((dt[1:-1] + dt[2:]) / 2)[:, None]
            rests = [step == 0 for step in steps]
            moves = (np.abs(moved) <= STEP).all(axis=1) & (np.abs(v) <= speed).all(axis=1)
            gentle = (np.abs(a) <= acceleration).all(axis=1)
            good = all(ok or rest for ok, rest in zip(moves, rests, strict=True))
            # after a step or before one, the path's own motion counts too
            for i in range(n - 2):
                if not (rests[i] and rests[i + 1]):
                    good &= bool(gentle[i] and moves[i + 1])
            if good:
                total = cost[np.arange(n), way].sum() + RESTLESS * sum(step**2 for step in steps)
                best = min(best, float(total))
    return best


@pytest.mark.parametrize("seed", range(12))
@pytest.mark.parametrize("closed", [False, True])
def test_the_way_is_the_cheapest_of_all(seed: int, closed: bool) -> None:
    rng = np.random.default_rng(seed)
    n, k = 6, 5
    cost, joints = rng.uniform(0, 1, (n, k)), rng.normal(0, 0.2, (n, k, 2)) + 0.05 * np.arange(k)[:, None]
    free, dt, speed = rng.random((n, k)) > 0.1, rng.uniform(0.8, 1.2, n), np.array([0.5, 0.6])
    free[:, 2] = True  # so that there is a way: straight on
    way = best_law(cost, joints, free, dt, speed, 0.7, STEP, BAND, RESTLESS, closed)
    steps = np.diff(way)
    steps = (steps + k // 2) % k - k // 2 if closed else steps
    total = cost[np.arange(n), way].sum() + RESTLESS * (steps**2).sum()
    assert free[np.arange(n), way].all()
    assert np.isclose(total, cheapest(cost, joints, free, dt, speed, 0.7, closed), rtol=1e-12)
    assert total <= cost[:, 2].sum() + 1e-12


@pytest.mark.parametrize("branch", range(8))
def test_fast_joint_angles_are_the_closed_forms(cell: Cell, branch: int) -> None:
    rng = np.random.default_rng(3)
    poses = forward_kinematics(cell.chain, rng.uniform(cell.chain.limits[:, 0], cell.chain.limits[:, 1], (2000, 6)))
    arm, (shoulder, elbow, flip) = fast_arm(cell.chain), (branch // 4, branch // 2 % 2, branch % 2)
    found = joint_angles(arm, poses, shoulder=shoulder, elbow=elbow, flip=flip)
    wanted = inverse_kinematics(cell.chain, poses)[:, branch]
    there = np.isfinite(wanted[:, 0])
    assert there.sum() > 500
    away = (found - wanted + np.pi) % (2 * np.pi) - np.pi
    assert np.abs(away[there]).max() < 1e-11
    _, said = displacements(arm, K, poses, poses[:, :3, 3], np.ones((2000, 3)), shoulder=shoulder, elbow=elbow)
    assert ((said == 3) == ~there).all()
