"""From the results of identifications to the figures of one condition, and these as tables."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from functools import cached_property
from typing import Any

import numpy as np
from scipy.stats import chi2

from bench.metrology.summary import CONDITION, Share, Summary, columns, largest, spelt
from workbench.units import Float

ELLIPSOID = float(chi2.ppf(0.95, 6))
HONEST = ("table_a1", "table_a1_points", "planned", "planned_points")  # the goals of errors and coverage hold for these
RATIO_GOAL, COVER_GOAL = 1.05, (0.93, 0.97)
PLANNED_GOAL, LOADS_GOAL = 0.05, 40  # all six joints within 5 % in 95 % of cases, loads a posture
JOINTS = [f"joint {j}" for j in range(1, 7)]


class StiffnessSummary(Summary):
    """Arrays over the six joints, relative."""

    conditions = ("table_a1", "table_a1_points", "one_lever", "table_a1_planned", "planned", "planned_points")

    def _of(self, name: str) -> Float:
        return np.array([getattr(r, name) for r in self.good]).reshape(-1, 6)

    @cached_property
    def bound(self) -> Float:
        return np.array(self.results[0].bound)

    @cached_property
    def rmse_ratio(self) -> Float:
        """RMS errors over their bound."""
        return np.sqrt(np.mean(self._of("error") ** 2, axis=0)) / self.bound

    @cached_property
    def stated_ratio(self) -> Float:
        return np.sqrt(np.mean(self._of("stated") ** 2, axis=0)) / self.bound

    @property
    def pooled(self) -> float:
        return float(np.sqrt(np.mean(self.rmse_ratio**2)))

    @property
    def least_ratio(self) -> float:
        """What the number of trials leaves open: the ratio of all joints together is above this (95 %)."""
        n = 6 * len(self.good)
        return self.pooled * float(np.sqrt(n / chi2.ppf(0.975, n)))

    @cached_property
    def covered(self) -> Share:
        return Share(sum((r.nees or 0) < ELLIPSOID for r in self.good), len(self.good))

    @property
    def within(self) -> Share:
        """Trials whose worst joint is within PLANNED_GOAL, joints one by one."""
        inside = (np.abs(self._of("error")) <= PLANNED_GOAL).sum(axis=0)
        return Share(int(inside.min()) if self.good else 0, len(self.good))

    def checks(self) -> Iterator[tuple[bool, str]]:
        if self.condition not in HONEST:
            return
        yield bool(self.refused), f"{len(self.refused)} refused"
        yield self.least_ratio > RATIO_GOAL, "errors over their bound"
        yield bool(self.stated_ratio.max() > RATIO_GOAL), "stated uncertainty over the bound"
        yield self.covered.outside(*COVER_GOAL), "coverage of the ellipsoid"
        if self.condition.startswith("planned"):
            yield bool(2 * self.bound.max() > PLANNED_GOAL), "a joint beyond 5 %"
            yield max(self.results[0].loads) > LOADS_GOAL, "too many loads at a posture"

    @classmethod
    def tables(cls, every: Sequence[Any]) -> Iterable[tuple[str, Iterable[str]]]:
        yield (
            "Cramer-Rao bound of each joint, twice the relative standard error, %",
            columns(
                every,
                CONDITION,
                ("loads at each posture", lambda s: " + ".join(map(str, s.results[0].loads))),
                (JOINTS, lambda s: [f"{200 * b:.2f}" for b in s.bound]),
                ("least certain joint within 5 %, % of trials", lambda s: s.within.percent),
            ),
        )
        yield (
            "RMSE of each joint and stated u over their bound; coverage of the 95 % ellipsoid",
            columns(
                every,
                CONDITION,
                ("trials", lambda s: len(s.results)),
                ("refused", lambda s: len(s.refused)),
                (JOINTS, lambda s: [f"{r:.3f}" for r in s.rmse_ratio]),
                ("all joints", lambda s: f"{s.pooled:.3f}"),
                ("goal of both", lambda s: spelt(RATIO_GOAL if s.condition in HONEST else None)),
                ("stated u / bound, greatest", lambda s: f"{s.stated_ratio.max():.3f}"),
                (
                    ["covers, %", "95 % interval", "its goal"],
                    lambda s: s.covered.cells(COVER_GOAL if s.condition in HONEST else None, bold=False),
                ),
                ("sound loads rejected", lambda s: sum(r.put_aside for r in s.good)),
                ("identification, ms (median)", lambda s: f"{s.median_ms('identify'):.1f}"),
            ),
        )

    @classmethod
    def worst(cls, results: list[Any], count: int) -> Iterator[str]:
        """The trials whose error is largest in units of their stated covariance."""
        for r in largest(results, lambda r: r.nees, count):
            errors = ", ".join(f"{e:.2%}" for e in r.error)
            yield f"{r.condition}, seed {r.seed}: chi-square {r.nees:.1f}, errors {errors}"
