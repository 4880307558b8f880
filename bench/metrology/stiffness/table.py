"""The figures of identification as Markdown tables."""

from __future__ import annotations

from collections.abc import Iterable

from bench.metrology.stiffness.summary import COVER_GOAL, HONEST, RATIO_GOAL, StiffnessSummary
from bench.metrology.table import markdown, study_text

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
