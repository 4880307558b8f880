"""One simulated set of loading tests, identified and compared with its truth."""

from __future__ import annotations

import time
from collections import Counter
from dataclasses import dataclass, field

import numpy as np

from bench.metrology.stiffness.truth import K, known, noisy
from workbench.errors import WorkbenchError
from workbench.plugins.stiffness.identify import identify_from


@dataclass(slots=True)
class StiffnessResult:
    """Relative errors of the six joints, their bound, and what the identification said of itself."""

    condition: str
    seed: int
    refused: str | None = None  # the stage's error, in one line
    crashed: str | None = None  # any other exception: a defect
    loads: list[int] = field(default_factory=list)  # at each posture
    error: list[float] = field(default_factory=list)  # (6,) of the stiffness, relative
    bound: list[float] = field(default_factory=list)  # (6,) Cramer-Rao bound, relative, at the truth
    stated: list[float] = field(default_factory=list)  # (6,) standard uncertainty over the true value
    nees: float | None = None  # squared error in units of the stated covariance: chi-square, 6
    put_aside: int = 0  # loads and points that were taken for gross errors; none is
    warned: bool = False
    seconds: dict[str, float] = field(default_factory=dict)


def measure_stiffness(condition: str, seed: int) -> StiffnessResult:
    """Identify trial `seed` of a condition. There are no peers to ask for."""
    result = StiffnessResult(condition, seed)
    truth = known(condition)
    tests = noisy(truth, seed)
    result.loads, result.bound = sorted(Counter(tests.labels).values(), reverse=True), truth.bound.tolist()
    start = time.process_time()
    try:
        found, notes = identify_from(truth.cell.chain, truth.setup, tests)
    except WorkbenchError as error:
        result.refused = str(error)
        return result
    except Exception as error:  # a defect, to be counted and not to stop the study
        result.crashed = f"{type(error).__name__}: {error}"
        return result
    result.seconds["identify"] = time.process_time() - start
    off = found.nm_per_rad - K
    result.error, result.stated = (off / K).tolist(), (found.u_nm_per_rad / K).tolist()
    result.nees = float(off @ np.linalg.solve(found.covariance, off))
    result.put_aside, result.warned = len(notes["rejected"]), bool(found.warnings)
    return result
