"""From the results of planning to the figures of one condition, and these as tables."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from functools import cached_property
from typing import Any

from bench.drawn.plates import RAW_CONDITIONS
from bench.metrology.figures import Spread, spread
from bench.metrology.quantity import percentile
from bench.metrology.summary import CONDITION, Summary, columns, largest, spelt

GOALS: dict[str, tuple[float, float] | None] = dict.fromkeys(RAW_CONDITIONS, (0.04, 0.1)) | {
    "raw_rough": (0.06, 0.15),
    "raw_robot": None,  # the whole edge is displaced, and no recording shows it
}
SPACING_GOAL = 0.05
COVERED_GOAL = 0.99
MOST_SEEN = 0.6  # an edge that is seen on less may be refused (`least_seen_share` of path.layers is 0.5)


class PlanSummary(Summary):
    """Errors are of the worst point of each part."""

    conditions = tuple(RAW_CONDITIONS)
    outcomes = Summary.outcomes | {"rejected": "rejected"}

    def _spread(self, name: str, goal: float | None = None) -> Spread:
        return spread((getattr(r, name) for r in self.good), goal)

    def _lost(self, name: str, goal: float | None = None) -> Spread:
        """Share without cutting points."""
        return spread((1 - found for r in self.good if (found := getattr(r, name)) is not None), goal)

    @cached_property
    def distance(self) -> Spread:  # mm
        return self._spread("distance_mm", (GOALS[self.condition] or (None, None))[0])

    @cached_property
    def axis(self) -> Spread:  # deg
        return self._spread("axis_deg", (GOALS[self.condition] or (None, None))[1])

    @cached_property
    def spacing(self) -> Spread:
        return self._spread("spacing_error", SPACING_GOAL)

    @cached_property
    def reachable_lost(self) -> Spread:
        """Of the seen edge that is clear of hidden stretches."""
        return self._lost("reachable_covered", 1 - COVERED_GOAL)

    def _sum(self, name: str) -> int:
        return sum(getattr(r, name) for r in self.good)

    def checks(self) -> Iterator[tuple[bool, str]]:
        in_view = sum(r.seen_share >= MOST_SEEN for r in self.refused)
        rejected = [r for r in self.good if r.rejected]
        yield in_view > 0, f"{in_view} refused although most of the edge is in view"
        yield bool(rejected), f"{len(rejected)} rejected by path.check"
        yield not self.distance.met, "distance"
        yield not self.axis.met, "axis"
        yield not self.spacing.met, "spacing"
        yield not self.reachable_lost.met, "coverage of the edge"
        yield self._sum("wrong_side") > 0, "wrong side"
        yield self._sum("blind_points") + self._sum("stations_invented") > 0, "invented edge"

    @property
    def met(self) -> str:
        goals = (self.distance, self.axis, self.spacing, self.reachable_lost)
        return "yes" if all(one.met for one in goals) else "**no**"

    @classmethod
    def tables(cls, every: Sequence[Any]) -> Iterable[tuple[str, Iterable[str]]]:
        yield (
            "Final layer: the worst point of each part; median, 95th percentile and worst of the parts",
            columns(
                every,
                CONDITION,
                ("parts", lambda s: len(s.results)),
                ("distance from the bevel, mm", lambda s: three(s.distance, 4)),
                ("distance goal", lambda s: spelt(s.distance.goal, "none")),
                ("axis, deg", lambda s: three(s.axis, 3)),
                ("axis goal", lambda s: spelt(s.axis.goal, "none")),
                (f"spacing: worst, % (goal {100 * SPACING_GOAL:g})", lambda s: f"{100 * s.spacing.worst:.1f}"),
                ("seen edge not cut, %", lambda s: three(s._lost("covered"), 1, 100.0)),
                (
                    f"clear of hidden stretches, % (goal {100 * (1 - COVERED_GOAL):g})",
                    lambda s: three(s.reachable_lost, 1, 100.0),
                ),
                ("met", lambda s: s.met),
            ),
        )
        yield (
            "Sides, hidden stretches, refusals, time",
            columns(
                every,
                CONDITION,
                ("wrong side", lambda s: s._sum("wrong_side")),
                ("cutting points where hidden", lambda s: s._sum("blind_points")),
                ("stations seen where hidden", lambda s: s._sum("stations_invented")),
                ("refused", lambda s: len(s.refused)),
                ("rejected by `path.check`", lambda s: sum(bool(r.rejected) for r in s.good)),
                ("layers (median)", lambda s: f"{percentile([r.layers for r in s.good], 50):.0f}"),
                ("s a part (median)", lambda s: f"{s.median_s('simulation'):.2f}"),
            ),
        )

    @classmethod
    def worst(cls, results: list[Any], count: int) -> Iterator[str]:
        """By each of the errors."""
        for name in ("distance_mm", "axis_deg", "spacing_error"):
            for r in largest(results, lambda r, name=name: getattr(r, name), count):
                seen = f"{100 * (r.covered or 0):.1f} % covered"
                yield f"{r.condition}, seed {r.seed}: {name} {getattr(r, name):.4f}, {seen}"


def three(s: Spread, digits: int, unit: float = 1.0) -> str:
    """Median, 95th percentile, worst."""
    return ", ".join(f"{unit * v:.{digits}f}" for v in (s.median, s.p95, s.worst))
