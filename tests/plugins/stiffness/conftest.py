"""The shipped cell, the paper's stiffness and postures, and loading tests simulated at them."""

import functools
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bench.loading_truth import loads_at
from bench.loading_truth import noisy as with_noise
from workbench.plugins import stiffness as stages
from workbench.plugins.stiffness.simulate_loads_stage import loads_csv, simulate_tests
from workbench.plugins.stiffness.values import TABLE_2_NM_PER_RAD, TABLE_A1_DEG, JointStiffness, LoadingTests
from workbench.robot import Cell, abb_angles, read_cell
from workbench.units import Float

ROOT = Path(__file__).parents[3]
K = np.array(TABLE_2_NM_PER_RAD)


@pytest.fixture(scope="session")
def cell() -> Cell:
    return read_cell(ROOT / "data" / "robot" / "cell.json")


@pytest.fixture(scope="session")
def stiffness() -> JointStiffness:
    return JointStiffness(K, np.zeros((6, 6)), 0.0, 0, 0, "Table 2")


@pytest.fixture(scope="session")
def table_a1() -> Float:
    return abb_angles(np.radians(TABLE_A1_DEG), "dh")


Make = Callable[..., LoadingTests]


@pytest.fixture(scope="session")
def exact(cell: Cell) -> Make:
    """`exact(targets)`: +-200 N along three axes at every load point and posture of Table A1, without noise."""
    setup = cell.loading

    @functools.cache
    def make(targets: int = 0, points: int | None = None) -> LoadingTests:
        labels, joints, wrench = loads_at(setup.load_points_mm[:points] - setup.flange_from_sensor[:3, 3])
        return simulate_tests(cell.chain, setup, K, joints, wrench, labels, targets=targets)

    return make


@pytest.fixture(scope="session")
def noisy(cell: Cell, exact: Make) -> Make:
    """`noisy(seed, targets)`: the same with the cell's noise."""
    setup = cell.loading
    assert setup is not None
    return lambda seed, *which: with_noise(exact(*which), setup, seed)


@pytest.fixture
def identified(cell: Cell, tmp_path: Path) -> Callable[..., tuple[JointStiffness, dict[str, Any]]]:
    """`identified(tests)`: what `stiffness.identify` finds in them as a file, and what stands in its own."""

    def identify(tests: LoadingTests, robot: Cell = cell, **more: Any) -> tuple[JointStiffness, dict[str, Any]]:
        path = tmp_path / "loads.csv"
        path.write_bytes(loads_csv(tests))
        found, _, document = stages.identify(robot, loads=path, **more)
        return found, json.loads(document.content)

    return identify
