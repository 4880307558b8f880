"""Joint stiffness from simulated loading tests, against the truth and the Cramer-Rao bound."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator

import numpy as np
from scipy.stats import chi2

from bench.metrology.loading_truth import K, known, noisy
from bench.metrology.study import COVERAGE, HEAD, Condition, Row, Share, Study, marked, spread
from workbench.plugins.stiffness.identify import identify_from
from workbench.units import Float

ELLIPSOID = float(chi2.ppf(0.95, 6))
HONEST = ("table_a1", "table_a1_points", "planned", "planned_points")  # the goals of errors and coverage hold for these
RATIO_GOAL = 1.05
PLANNED_GOAL, LOADS_GOAL = 0.05, 40  # all six joints within 5 % in 95 % of cases, loads a posture


def measure(condition: str, seed: int) -> Row:
    """Errors of the six joints, their bound and stated u, relative; squared error by the stated covariance."""
    truth = known(condition)
    tests = noisy(truth.exact, truth.setup, seed)
    found, notes = identify_from(truth.cell.chain, truth.setup, tests)
    off = found.nm_per_rad - K
    return {
        "loads": sorted(Counter(tests.labels).values(), reverse=True),
        "bound": truth.bound.tolist(),
        "error": (off / K).tolist(),
        "stated": (found.u_nm_per_rad / K).tolist(),
        "nees": float(off @ np.linalg.solve(found.covariance, off)),
        "rejected_loads": len(notes["rejected"]),  # none is in error
    }


def ratio(c: Condition, name: str) -> Float:
    """RMS of each joint over its bound."""
    return np.asarray(np.sqrt(np.mean(c.values(name).reshape(-1, 6) ** 2, axis=0)) / bound(c))


def bound(c: Condition) -> Float:
    return c.values("bound")[:6]


def pooled(c: Condition) -> float:
    return float(np.sqrt(np.mean(ratio(c, "error") ** 2)))


def within(c: Condition) -> Share:
    """Trials whose worst joint is within PLANNED_GOAL, joints one by one."""
    inside = (np.abs(c.values("error").reshape(-1, 6)) <= PLANNED_GOAL).sum(axis=0)
    return Share(int(inside.min()), len(c.good))


def goals(c: Condition) -> Iterator[tuple[bool, str]]:
    if c.name not in HONEST:
        return
    refused, n = len(c.having("refused")), 6 * len(c.good)
    yield refused > 0, f"{refused} refused"
    if not n:
        return
    least = pooled(c) * float(np.sqrt(n / chi2.ppf(0.975, n)))  # the ratio of all joints is above this (95 %)
    yield least > RATIO_GOAL, "errors over their bound"
    yield bool(ratio(c, "stated").max() > RATIO_GOAL), "stated uncertainty over the bound"
    yield c.share("nees", ELLIPSOID).outside(*COVERAGE), "coverage of the ellipsoid"
    if c.name.startswith("planned"):
        yield bool(2 * bound(c).max() > PLANNED_GOAL), "a joint beyond 5 %"
        yield max(c.good[0]["loads"]) > LOADS_GOAL, "too many loads at a posture"


STUDY = Study(
    conditions=("table_a1", "table_a1_points", "one_lever", "table_a1_planned", "planned", "planned_points"),
    parts=1000,
    page="stiffness_metrology.md",
    measure=measure,
    goals=goals,
    tables=(
        (
            "Cramer-Rao bound of each joint, RMSE beside it, coverage of the 95 % ellipsoid",
            (
                *HEAD,
                ("loads at each posture", lambda c: " + ".join(map(str, c.good[0]["loads"]))),
                ("bound of joints 1 to 6, twice the relative standard error, %", lambda c: spread(200 * bound(c), 2)),
                ("least certain joint within 5 %, % of trials", lambda c: within(c).percent),
                ("RMSE / bound of joints 1 to 6", lambda c: spread(ratio(c, "error"), 3)),
                ("all joints", lambda c: marked(pooled(c), RATIO_GOAL if c.name in HONEST else None)),
                ("stated u / bound, greatest", lambda c: f"{ratio(c, 'stated').max():.3f}"),
                ("covers, %", lambda c: c.share("nees", ELLIPSOID).beside(COVERAGE if c.name in HONEST else None)),
                ("sound loads rejected", lambda c: c.total("rejected_loads")),
            ),
            lambda c: bool(c.good),
        ),
    ),
)
