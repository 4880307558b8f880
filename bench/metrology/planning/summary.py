"""From the results of planning to the figures of one condition, and these as tables."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

from bench.drawn.plates import RAW_CONDITIONS
from bench.metrology.figures import Cover, Spread, cover, spread, told
from bench.metrology.planning.part import PlanResult
from bench.metrology.quantity import percentile
from bench.metrology.table import markdown, study_text

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


def plan_tables(summaries: list[PlanSummary], command: str) -> str:
    """All tables, and what fell short."""
    parts = [
        (
            "Final layer: the worst point of each part; median, 95th percentile and worst of the parts",
            accuracy(summaries),
        ),
        ("The edge that it rests on, and its uncertainties", uncertainty(summaries)),
        ("Sides, hidden stretches, refusals, time", counts(summaries)),
    ]
    return study_text(command, parts, causes(summaries), summaries)


def accuracy(summaries: list[PlanSummary]) -> list[str]:
    """Errors beside their goals."""
    head = ["condition", "parts", "distance from the bevel, mm", "distance goal", "axis, deg", "axis goal"]
    head += [f"spacing: worst, % (goal {100 * SPACING_GOAL:g})", "seen edge not cut, %"]
    head += [f"clear of hidden stretches, % (goal {100 * (1 - COVERED_GOAL):g})", "met"]
    rows = []
    for s in summaries:
        met = all(part.met for part in (s.distance, s.axis, s.spacing, s.reachable_lost))
        row = [s.condition, f"{s.parts}", three(s.distance, 4), goal(s.distance), three(s.axis, 3), goal(s.axis)]
        row += [f"{100 * s.spacing.worst:.1f}", three(s.lost, 1, 100.0), three(s.reachable_lost, 1, 100.0)]
        rows.append([*row, "yes" if met else "**no**"])
    return markdown(head, rows)


def three(s: Spread, digits: int, unit: float = 1.0) -> str:
    """Median, 95th percentile, worst."""
    return ", ".join(f"{unit * v:.{digits}f}" for v in (s.median, s.p95, s.worst))


def goal(s: Spread) -> str:
    return "none" if s.goal is None else f"{s.goal:g}"


def uncertainty(summaries: list[PlanSummary]) -> list[str]:
    """Coverage of 2u, errors and u of the lower edge along n and m, and of the direction of n about t."""
    head = ["condition"]
    for name, unit in (("along n", "mm"), ("along m", "mm"), ("direction of n", "deg")):
        head += covered_head(name, unit)
    head += ["plane through the true face, deg"]
    rows = [
        [s.condition, *covered(s.normal, 4), *covered(s.across, 4), *covered(s.turn, 3), three(s.plane, 3)]
        for s in summaries
    ]
    return markdown(head, rows)


def covered_head(name: str, unit: str) -> list[str]:
    """The columns of `covered`."""
    return [f"{name}: within 2u, %", "95 % interval", f"{name}: mean, RMS error, {unit}", f"{name}: mean u, {unit}"]


def covered(c: Cover, digits: int) -> list[str]:
    share = f"{100 * c.share:.1f}"
    return [
        f"**{share}**" if c.surely_not_covered else share,
        f"{100 * c.low:.1f} to {100 * c.high:.1f}",
        f"{c.bias:+.{digits}f}, {c.rms:.{digits}f}",
        f"{c.mean_u:.{digits}f}",
    ]


def counts(summaries: list[PlanSummary]) -> list[str]:
    head = ["condition", "wrong side", "cutting points where hidden", "stations seen where hidden", "refused"]
    head += ["rejected by `path.check`", "layers (median)", "s a part (median)"]
    rows = [
        [
            s.condition,
            f"{s.wrong_side}",
            f"{s.blind_points}",
            f"{s.stations_invented}",
            f"{len(s.refused)}",
            f"{len(s.rejected)}",
            f"{s.layers:.0f}",
            f"{s.seconds:.2f}",
        ]
        for s in summaries
    ]
    return markdown(head, rows)


def causes(summaries: list[PlanSummary]) -> list[str]:
    """Every part that was refused, crashed or rejected, with the cause."""
    return told(
        (s.condition, word, cause, r)
        for s in summaries
        for word, cause, r in (
            *(("refused", r.refused, r) for r in s.refused),
            *(("**crashed**", r.crashed, r) for r in s.crashed),
            *(("rejected", r.rejected, r) for r in s.rejected),
        )
    )
