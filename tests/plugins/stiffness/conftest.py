"""The shipped cell, the paper's stiffness and postures, and loading tests simulated at them."""

import dataclasses
import json
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from workbench.plugins import stiffness as stages
from workbench.plugins.stiffness.simulate_loads import loads_csv, simulate_tests
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
def exact(cell: Cell, table_a1: Float) -> Make:
    """`exact(targets)`: +-200 N along three axes at every load point and posture of Table A1, without noise."""
    setup = cell.loading
    assert setup is not None
    made: dict[tuple[int, int], LoadingTests] = {}

    def make(targets: int = 0, points: slice = slice(None)) -> LoadingTests:
        key = (targets, points.stop or 0)
        if key not in made:
            rows = [
                (str(i), q, np.concatenate([f, np.cross(p - setup.flange_from_sensor[:3, 3], f) / 1e3]))
                for i, q in enumerate(table_a1, 1)
                for p in setup.load_points_mm[points]
                for f in 200.0 * np.vstack([np.eye(3), -np.eye(3)])
            ]
            labels, joints, wrench = zip(*rows, strict=True)
            made[key] = simulate_tests(
                cell.chain, setup, K, np.array(joints), np.array(wrench), labels, targets=targets
            )
        return made[key]

    return make


@pytest.fixture(scope="session")
def noisy(cell: Cell, exact: Make) -> Make:
    """`noisy(seed, targets)`: the same with the cell's noise."""
    setup = cell.loading
    assert setup is not None

    def make(seed: int, targets: int = 0, points: slice = slice(None)) -> LoadingTests:
        clean, rng = exact(targets, points), np.random.default_rng(seed)
        wrench = clean.wrench + rng.normal(size=clean.wrench.shape) * (
            [setup.force_noise_n] * 3 + [setup.torque_noise_nm] * 3
        )
        tool = [setup.displacement_noise_mm] * 3 + [setup.rotation_noise] * 3
        moved = clean.moved + rng.normal(size=clean.moved.shape) * (setup.target_noise_mm if targets else tool)
        return dataclasses.replace(clean, wrench=wrench, moved=moved)

    return make


@pytest.fixture
def identified(cell: Cell, tmp_path: Path) -> Callable[..., tuple[JointStiffness, dict[str, Any]]]:
    """`identified(tests)`: what `stiffness.identify` finds in them as a file, and what stands in its own."""

    def identify(tests: LoadingTests, robot: Cell = cell, **more: Any) -> tuple[JointStiffness, dict[str, Any]]:
        path = tmp_path / "loads.csv"
        path.write_bytes(loads_csv(tests))
        found, _, document = stages.identify(robot, loads=path, **more)
        return found, json.loads(document.content)

    return identify


@pytest.fixture(scope="module", autouse=True)
def small_robots() -> Iterator[None]:
    """Robots are drawn small, half of what a stage takes: nobody here looks at them, tests/docs does."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("workbench.robot.report_picture.SIZE_PX", (69, 63))
        yield
