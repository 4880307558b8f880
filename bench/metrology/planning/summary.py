"""From the results of planning to the figures of one condition."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

from bench.metrology.figures import Cover, Spread, cover, spread
from bench.metrology.planning.result import PlanResult
from bench.metrology.quantity import percentile
from workbench.synthetic import RAW_CONDITIONS

GOALS: dict[str, tuple[float, float] | None] = dict.fromkeys(RAW_CONDITIONS, (0.04, 0.1)) | {
    "raw_rough": (0.06, 0.15),
    "raw_robot": None,  # the whole edge is displaced, and no recording shows it
}
SPACING_GOAL = 0.05
COVERED_GOAL = 0.99
MOST_SEEN = 0.6  # an edge that is seen on less may be refused (`least_seen_share` of path.layers is 0.5)


@dataclass(frozen=True, slots=True)
class PlanSummary:
    """The figures of one condition."""

    condition: str
    parts: int
    refused: list[PlanResult]
    crashed: list[PlanResult]
    rejected: list[PlanResult]
    distance: Spread  # mm
    axis: Spread  # deg
    spacing: Spread
    lost: Spread  # share of the seen edge without cutting points
    reachable_lost: Spread  # likewise, of what is clear of hidden stretches
    wrong_side: int  # parts
    blind_points: int
    stations_invented: int
    normal: Cover  # mm
    across: Cover  # mm
    turn: Cover  # deg
    plane: Spread  # deg, what roughness alone turns the best plane through the true face by
    layers: float  # median
    seconds: float  # a part, without simulation, median

    @property
    def shortcomings(self) -> Iterable[str]:
        """In words, what does not reach its goal."""
        checks = (
            (bool(self.crashed), f"{len(self.crashed)} crashed"),
            (self.refused_seen > 0, f"{self.refused_seen} refused although most of the edge is in view"),
            (bool(self.rejected), f"{len(self.rejected)} rejected by path.check"),
            (not self.distance.met, "distance"),
            (not self.axis.met, "axis"),
            (not self.spacing.met, "spacing"),
            (not self.reachable_lost.met, "coverage of the edge"),
            (self.wrong_side > 0, "wrong side"),
            (self.blind_points + self.stations_invented > 0, "invented edge"),
            *((c.surely_not_covered, f"{name} within 2u") for name, c in self._covers() if self.distance.goal),
        )
        return [f"{self.condition}: {words}" for wrong, words in checks if wrong]

    @property
    def refused_seen(self) -> int:
        """Refused parts whose edge is in view, by truth, on most of its length."""
        return sum(r.seen_share >= MOST_SEEN for r in self.refused)

    def _covers(self) -> Iterable[tuple[str, Cover]]:
        return ("edge along n", self.normal), ("edge along m", self.across), ("direction of n", self.turn)


def summarise_plans(condition: str, results: list[PlanResult]) -> PlanSummary:
    """All figures of one condition."""
    results = sorted(results, key=lambda r: r.seed)
    good = [r for r in results if not (r.refused or r.crashed)]
    distance_goal, axis_goal = GOALS[condition] or (None, None)
    return PlanSummary(
        condition=condition,
        parts=len(results),
        refused=[r for r in results if r.refused],
        crashed=[r for r in results if r.crashed],
        rejected=[r for r in good if r.rejected],
        distance=spread((r.distance_mm for r in good), distance_goal),
        axis=spread((r.axis_deg for r in good), axis_goal),
        spacing=spread((r.spacing_error for r in good), SPACING_GOAL),
        lost=spread(1 - r.covered for r in good if r.covered is not None),
        reachable_lost=spread(
            (1 - r.reachable_covered for r in good if r.reachable_covered is not None), 1 - COVERED_GOAL
        ),
        wrong_side=sum(r.wrong_side for r in good),
        blind_points=sum(r.blind_points for r in good),
        stations_invented=sum(r.stations_invented for r in good),
        normal=cover((r.normal_error_mm, r.normal_u_mm) for r in good),
        across=cover((r.across_error_mm, r.across_u_mm) for r in good),
        turn=cover((r.turn_error_deg, r.turn_u_deg) for r in good),
        plane=spread(r.plane_deg for r in good),
        layers=percentile([r.layers for r in good], 50),
        seconds=percentile([sum(v for k, v in r.seconds.items() if k != "simulation") for r in good], 50),
    )


def worst_plans(results: list[PlanResult], count: int) -> Iterator[str]:
    """The worst parts, by each of the errors, as lines."""
    for name in ("distance_mm", "axis_deg", "spacing_error"):
        known = [r for r in results if getattr(r, name) is not None]
        for r in sorted(known, key=lambda r: -getattr(r, name))[:count]:
            yield f"{r.condition}, seed {r.seed}: {name} {getattr(r, name):.4f}, {100 * (r.covered or 0):.1f} % covered"
