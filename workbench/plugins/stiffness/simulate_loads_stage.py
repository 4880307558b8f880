"""`stiffness.simulate_loads`: planned loading tests carried out on a robot of known stiffness."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from workbench.api import (
    Cell,
    Chain,
    Document,
    Float,
    InputError,
    LoadingSetup,
    Seed,
    stage,
)
from workbench.plugins.csv_table import csv_bytes
from workbench.plugins.ranges import Targets
from workbench.plugins.stiffness.equations import displaced
from workbench.plugins.stiffness.read_stage import ANGLES, WRENCH
from workbench.plugins.stiffness.values import JointStiffness, LoadingTests, LoadPlan


@stage("stiffness.simulate_loads")
def simulate_loads(
    plan: LoadPlan,
    cell: Cell,
    stiffness: JointStiffness,
    *,
    targets: Targets = 0,
    seed: Seed = 0,
) -> Document:
    """Simulate planned loading tests: `loads.csv` of a robot whose springs and loads are in balance, with noise.

    Args:
        plan: postures and loads.
        cell: where sensor, tool and targets sit, and their noise.
        stiffness: the truth.
        targets: count of tracked points; 0: displacement of the tool frame in six dimensions.
        seed: of the noise.

    Raises:
        InputError: the cell says nothing of loading tests, or has fewer targets.

    Example:
        >>> from workbench import robot
        >>> from workbench.plugins import stiffness
        >>> cell = robot.cell(cell="data/robot/cell.json")
        >>> springs = stiffness.read(cell)
        >>> loads, *files = stiffness.plan_loads(cell, springs)
        >>> stiffness.simulate_loads(loads, cell, springs).name
        'loads.csv'
    """
    if cell.loading is None or targets > len(cell.loading.targets_mm):
        raise InputError(f"{cell.source}: $.loading", f"expected the set-up of loading tests with {targets} targets")
    tests = simulate_tests(
        cell.chain,
        cell.loading,
        stiffness.nm_per_rad,
        plan.joints,
        plan.wrench,
        plan.labels,
        targets=targets,
        rng=np.random.default_rng(seed),
    )
    truth = ", ".join(f"{k:.6g}" for k in stiffness.nm_per_rad)
    comment = f"Simulated loading tests: seed {seed}, joint stiffness {truth} Nm/rad, noise as in the cell file."
    return Document("loads.csv", loads_csv(tests, comment))


# Loading tests of a robot whose stiffness is known: springs and load in balance, then noise.


def simulate_tests(
    chain: Chain,
    setup: LoadingSetup,
    stiffness: Float,
    joints: Float,
    wrench: Float,
    labels: tuple[str, ...],
    *,
    targets: int = 0,
    rng: np.random.Generator | None = None,
) -> LoadingTests:
    """Tests at postures (L, 6), rad, under wrenches (L, 6) in the sensor's axes; `targets` > 0: that many points.

    The robot rests where springs and load are in balance; the wrench keeps its direction in space. Noise out of the
    cell is added to wrench and displacement where `rng` is given.
    """
    lines = tuple(range(2, len(joints) + 2))
    tests = LoadingTests("simulated", labels, lines, joints, wrench, np.zeros((len(joints), 0)), targets)
    moved = displaced(chain, setup, 1 / stiffness, tests)
    if rng is not None:
        wrench = wrench + rng.normal(size=wrench.shape) * setup.wrench_noise
        moved = moved + rng.normal(size=moved.shape) * setup.moved_noise(targets)
    return replace(tests, wrench=wrench, moved=moved)


def loads_csv(tests: LoadingTests, comment: str = "") -> bytes:
    """The tests as a `loads.csv`."""
    columns = tests.labels, np.degrees(tests.joints), tests.wrench, tests.moved / tests.units
    rows = (
        [label, *(f"{v:.6f}" for v in q), *(f"{v:.4f}" for v in w), *("" if np.isnan(v) else f"{v:.6f}" for v in m)]
        for label, q, w, m in zip(*columns, strict=True)
    )
    said = "".join(f"# {line}\n" for line in comment.splitlines())
    return said.encode() + csv_bytes(["posture", *ANGLES, *WRENCH, *tests.columns], rows)
