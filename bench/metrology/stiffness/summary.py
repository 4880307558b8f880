"""From the results of identifications to the figures of one condition, and these as tables."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np
from scipy.stats import chi2

from bench.metrology.calibration.summary import ELLIPSOID, Share
from bench.metrology.quantity import percentile
from bench.metrology.stiffness.part import StiffnessResult
from bench.metrology.table import markdown, study_text
from workbench.units import Float

STIFFNESS_CONDITIONS = ("table_a1", "table_a1_points", "one_lever", "table_a1_planned", "planned", "planned_points")
HONEST = ("table_a1", "table_a1_points", "planned", "planned_points")  # the goals of errors and coverage hold for these
RATIO_GOAL, COVER_GOAL = 1.05, (0.93, 0.97)
PLANNED_GOAL, LOADS_GOAL = 0.05, 40  # all six joints within 5 % in 95 % of cases, loads a posture


@dataclass(frozen=True, slots=True)
class StiffnessSummary:
    """The figures of one condition; arrays over the six joints, relative."""

    condition: str
    trials: int
    loads: list[int]  # at each posture
    refused: list[StiffnessResult]
    crashed: list[StiffnessResult]
    bound: Float  # (6,)
    rmse: Float  # (6,)
    stated: Float  # (6,) RMS of the stated standard uncertainties
    bias: Float  # (6,) mean error
    covered: Share
    within: Share  # trials whose worst joint is within PLANNED_GOAL, joints one by one
    put_aside: int  # loads and points, in all trials
    warned: int
    identify_ms: float

    @property
    def rmse_ratio(self) -> Float:
        return self.rmse / self.bound

    @property
    def stated_ratio(self) -> Float:
        return self.stated / self.bound

    @property
    def least_ratio(self) -> float:
        """What the number of trials leaves open: the ratio of all joints together is above this (95 %)."""
        n = 6 * (self.trials - len(self.refused) - len(self.crashed))
        pooled = float(np.sqrt(np.mean(self.rmse_ratio**2)))
        return pooled * float(np.sqrt(n / chi2.ppf(0.975, n)))

    @property
    def shortcomings(self) -> Iterable[str]:
        """In words, what does not reach its goal."""
        return [f"{self.condition}: {words}" for wrong, words in self._checks() if wrong]

    def _checks(self) -> Iterator[tuple[bool, str]]:
        yield bool(self.crashed), f"{len(self.crashed)} crashed"
        if self.condition not in HONEST:
            return
        yield bool(self.refused), f"{len(self.refused)} refused"
        yield self.least_ratio > RATIO_GOAL, "errors over their bound"
        yield bool(self.stated_ratio.max() > RATIO_GOAL), "stated uncertainty over the bound"
        yield self.covered.outside(*COVER_GOAL), "coverage of the ellipsoid"
        if self.condition.startswith("planned"):
            yield bool(2 * self.bound.max() > PLANNED_GOAL), "a joint beyond 5 %"
            yield max(self.loads) > LOADS_GOAL, "too many loads at a posture"


def summarise_stiffness(condition: str, results: list[StiffnessResult]) -> StiffnessSummary:
    """All figures of one condition."""
    results = sorted(results, key=lambda r: r.seed)
    good = [r for r in results if not (r.refused or r.crashed)]
    error, stated = (np.array([getattr(r, name) for r in good]).reshape(-1, 6) for name in ("error", "stated"))
    inside = np.abs(error) <= PLANNED_GOAL
    worst = int(inside.sum(axis=0).argmin()) if len(good) else 0
    return StiffnessSummary(
        condition=condition,
        trials=len(results),
        loads=results[0].loads,
        refused=[r for r in results if r.refused],
        crashed=[r for r in results if r.crashed],
        bound=np.array(results[0].bound),
        rmse=np.sqrt(np.mean(error**2, axis=0)),
        stated=np.sqrt(np.mean(stated**2, axis=0)),
        bias=error.mean(axis=0),
        covered=Share(sum((r.nees or 0) < ELLIPSOID for r in good), len(good)),
        within=Share(int(inside[:, worst].sum()), len(good)),
        put_aside=sum(r.put_aside for r in good),
        warned=sum(r.warned for r in good),
        identify_ms=percentile([1e3 * r.seconds["identify"] for r in good], 50),
    )


def worst_stiffness(results: list[StiffnessResult], count: int) -> Iterator[str]:
    """The trials whose error is largest in units of their stated covariance, as lines."""
    known = [r for r in results if r.nees is not None]
    for r in sorted(known, key=lambda r: -(r.nees or 0))[:count]:
        yield f"{r.condition}, seed {r.seed}: chi-square {r.nees:.1f}, errors {', '.join(f'{e:.2%}' for e in r.error)}"


JOINTS = [f"joint {j}" for j in range(1, 7)]


def stiffness_tables(summaries: list[StiffnessSummary], command: str) -> str:
    """All tables, and what fell short."""
    parts = [
        ("Cramer-Rao bound of each joint, twice the relative standard error, %", bounds(summaries)),
        (
            "RMSE of each joint and stated u over their bound; coverage of the 95 % ellipsoid",
            accuracy(summaries),
        ),
    ]
    causes = [f"- {r.condition}, seed {r.seed}: **crashed**: {r.crashed}" for s in summaries for r in s.crashed]
    causes += [
        f"- {s.condition}: {len(s.refused)} refused, the first: {s.refused[0].refused}" for s in summaries if s.refused
    ]
    return study_text(command, parts, [*causes, ""], summaries)


def bounds(summaries: list[StiffnessSummary]) -> Iterable[str]:
    head = ["condition", "loads at each posture", *JOINTS, "least certain joint within 5 %, % of trials"]
    rows = [
        [
            s.condition,
            " + ".join(map(str, s.loads)),
            *(f"{200 * b:.2f}" for b in s.bound),
            f"{100 * s.within.value:.1f}",
        ]
        for s in summaries
    ]
    return markdown(head, rows)


def accuracy(summaries: list[StiffnessSummary]) -> Iterable[str]:
    head = [
        "condition",
        "trials",
        "refused",
        *(f"{j}" for j in JOINTS),
        "all joints",
        "goal of both",
        "stated u / bound, greatest",
        "covers, %",
        "95 % interval",
        "its goal",
        "sound loads rejected",
        "identification, ms (median)",
    ]
    rows = []
    for s in summaries:
        goal = s.condition in HONEST
        pooled = float((s.rmse_ratio**2).mean() ** 0.5)
        low, high = s.covered.interval
        rows.append(
            [
                s.condition,
                f"{s.trials}",
                f"{len(s.refused)}",
                *(f"{r:.3f}" for r in s.rmse_ratio),
                f"{pooled:.3f}",
                f"{RATIO_GOAL:g}" if goal else "",
                f"{s.stated_ratio.max():.3f}",
                f"{100 * s.covered.value:.1f}",
                f"{100 * low:.1f} to {100 * high:.1f}",
                f"{100 * COVER_GOAL[0]:g} to {100 * COVER_GOAL[1]:g}" if goal else "",
                f"{s.put_aside}",
                f"{s.identify_ms:.1f}",
            ]
        )
    return markdown(head, rows)
