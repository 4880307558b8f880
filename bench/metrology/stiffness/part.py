"""One simulated set of loading tests, identified and compared with its truth."""

from __future__ import annotations

import time
from collections import Counter

import numpy as np

from bench.metrology.stiffness.result import StiffnessResult
from bench.metrology.stiffness.truth import K, known, noisy
from workbench.errors import WorkbenchError
from workbench.plugins.stiffness.identify import identify_from


def measure_stiffness(condition: str, seed: int, peers: tuple[str, ...] = ()) -> StiffnessResult:
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
