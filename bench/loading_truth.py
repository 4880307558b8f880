"""Loading tests whose truth is known, and the Cramer-Rao bound of what they tell.

Written apart from the identification: derivatives are differences of the robot's balance under load, which is solved.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from bench.bounds import cramer_rao, differences
from bench.harness import ROOT
from workbench.plugins.stiffness import plan_loads
from workbench.plugins.stiffness.simulate_loads_stage import simulate_tests
from workbench.plugins.stiffness.values import TABLE_2_NM_PER_RAD, TABLE_A1_DEG, JointStiffness, LoadingTests
from workbench.robot import Cell, LoadingSetup, abb_angles, read_cell
from workbench.units import Float

CELL = ROOT / "data" / "robot" / "cell.json"
K = np.array(TABLE_2_NM_PER_RAD)
FORCE_N, LEVER_MM, TARGETS = 200.0, 100.0, 4
STEP, STEP_N = 1e-3, 1.0  # of differences: relative, of a stiffness; N and Nm, of a wrench


@dataclass(frozen=True)
class Known:
    """Tests without noise, and the bound on each joint's relative standard error."""

    cell: Cell
    setup: LoadingSetup
    exact: LoadingTests
    bound: Float  # (6,)


@lru_cache(maxsize=8)
def known(condition: str) -> Known:
    """The tests of a condition; the same in all trials but for their noise."""
    cell = read_cell(CELL)
    assert cell.loading is not None
    targets = TARGETS if condition.endswith("points") else 0
    lever = np.array([[LEVER_MM, 0.0, 0.0]])
    at = lever if condition == "one_lever" else cell.loading.load_points_mm - cell.loading.flange_from_sensor[:3, 3]
    labels, joints, wrench = _planned(cell) if condition == "planned" else loads_at(at)
    exact = simulate_tests(cell.chain, cell.loading, K, joints, wrench, labels, targets=targets)
    return Known(cell, cell.loading, exact, _bound(cell, cell.loading, exact, targets))


def noisy(exact: LoadingTests, setup: LoadingSetup, seed: int) -> LoadingTests:
    """The tests with the cell's noise on wrench and displacement."""
    rng = np.random.default_rng(seed)
    wrench = exact.wrench + rng.normal(size=exact.wrench.shape) * setup.wrench_noise
    moved = exact.moved + rng.normal(size=exact.moved.shape) * setup.moved_noise(exact.points)
    return dataclasses.replace(exact, wrench=wrench, moved=moved)


def loads_at(at: Float) -> tuple[tuple[str, ...], Float, Float]:
    """Labels, joints and wrenches: opposite forces along the sensor's axes, at (m, 3) from it, mm, in Table A1."""
    rows = [
        (str(i), q, np.concatenate([f, np.cross(p, f) / 1e3]))
        for i, q in enumerate(abb_angles(np.radians(TABLE_A1_DEG), "dh"), 1)
        for p in at
        for f in FORCE_N * np.vstack([np.eye(3), -np.eye(3)])
    ]
    labels, joints, wrench = zip(*rows, strict=True)
    return labels, np.array(joints), np.array(wrench)


def _planned(cell: Cell) -> tuple[tuple[str, ...], Float, Float]:
    """Loads as `stiffness.plan_loads` proposes them, at postures of its own."""
    plan, _ = plan_loads(cell, JointStiffness(K, np.zeros((6, 6)), 0.0, 0, 0, "Table 2"), targets=0)
    return plan.labels, plan.joints, plan.wrench


def _bound(cell: Cell, setup: LoadingSetup, exact: LoadingTests, targets: int) -> Float:
    """From the information about the logarithms of the stiffness: sum of D^T S^-1 D over the loads.

    D: derivative of the displacement; S: noise of the displacement and of the wrench, which acts through the robot.
    """

    def moved(off: Float, more: Float) -> Float:
        k, wrench = K * np.exp(off), exact.wrench + more
        return simulate_tests(cell.chain, setup, k, exact.joints, wrench, exact.labels, targets=targets).moved

    rows = setup.moved_noise(targets)
    by_wrench = differences(lambda more: moved(np.zeros(6), more), np.full(6, STEP_N)).reshape(-1, len(rows), 6)
    through = by_wrench * setup.wrench_noise
    noise = through @ np.swapaxes(through, 1, 2) + np.diag(rows**2)
    bound = cramer_rao(lambda off: moved(off, np.zeros(6)), np.full(6, STEP), noise, np.zeros(6))
    return np.sqrt(np.diag(bound))
