"""`stiffness.simulate_loads`: planned loading tests carried out on a robot of known stiffness."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from pydantic import Field

from workbench.api import Cell, Document, InputError, Seed, stage
from workbench.plugins.stiffness.simulate import loads_csv, simulate_tests
from workbench.plugins.stiffness.values import JointStiffness, LoadPlan


@stage("stiffness.simulate_loads")
def simulate_loads(
    plan: LoadPlan,
    cell: Cell,
    stiffness: JointStiffness,
    *,
    targets: Annotated[int, Field(ge=0, le=50, description="count of tracked points; 0: six-dimensional")] = 0,
    seed: Annotated[Seed, Field(description="of the noise")] = 0,
) -> Document:
    """Simulate planned loading tests: `loads.csv` of a robot whose springs and loads are in balance, with noise.

    Args:
        plan: postures and loads.
        cell: where sensor, tool and targets sit, and their noise.
        stiffness: the truth.
        targets: how many tracked points; 0: displacement of the tool frame in six dimensions.
        seed: of the noise.

    Raises:
        InputError: the cell says nothing of loading tests, or has fewer targets.
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
