"""The figures of planning as Markdown tables."""

from __future__ import annotations

from bench.metrology.figures import Cover, Spread, told
from bench.metrology.planning.summary import COVERED_GOAL, SPACING_GOAL, PlanSummary
from bench.metrology.table import markdown, study_text


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
