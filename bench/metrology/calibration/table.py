"""The figures of calibration as Markdown tables."""

from __future__ import annotations

import re
from collections.abc import Iterable
from math import isfinite

from bench.metrology.calibration.summary import (
    CORRELATED_GOAL,
    COVER_GOAL,
    FLAGGED_GOAL,
    GROSS_GOAL,
    OFFSET_GOAL,
    PLAN_GOAL,
    ROTATION_GOAL_DEG,
    VOL_GOAL,
    CalibrationSummary,
    Share,
)
from bench.metrology.table import markdown, study_text
from workbench.synthetic.sphere_conditions import DEGENERATE


def calibration_tables(summaries: list[CalibrationSummary], command: str) -> str:
    """All tables, and what fell short."""
    sound = [s for s in summaries if s.condition not in DEGENERATE]
    parts: list[tuple[str, Iterable[str]]] = [
        ("Error over the field of view against the Cramer-Rao bound, coverage of the 95 % ellipsoid", accuracy(sound)),
        ("Gross poses, systematic errors of the robot", robot(sound)),
        ("Scans over the sphere: clock offset, rotation", clock(sound)),
        ("Nine planned postures beside the median of random nines, by their bounds", plans(sound)),
        ("Methods side by side, `sphere_grid`: three orientations, three places each", methods(sound)),
        ("Sets that determine nothing", refusals(summaries)),
    ]
    return study_text(command, parts, crashes(summaries), summaries)


def accuracy(summaries: list[CalibrationSummary]) -> Iterable[str]:
    head = [
        "condition",
        "trials",
        "refused",
        "vol RMSE, mm",
        "bound, mm",
        "ratio",
        "goal of the ratio",
        "stated u, mm",
        "covers, %",
        "95 % interval",
        "goal of the coverage",
        "wrong signs",
        "silently wrong",
        "solve, ms (median)",
    ]
    rows = [
        [
            s.condition,
            f"{s.trials}",
            f"{len(s.refused)}",
            f"{s.vol_mm:.3f}",
            f"{s.bound_mm:.3f}",
            _marked(s.ratio, VOL_GOAL.get(s.condition)),
            _goal(VOL_GOAL.get(s.condition)),
            f"{s.u_mm:.3f}",
            *_share(s.covered, COVER_GOAL.get(s.condition)),
            f"{s.signs_wrong}",
            f"{s.silently_wrong}",
            f"{s.solve_ms:.1f}",
        ]
        for s in summaries
        if s.condition != "sphere_planned"
    ]
    return markdown(head, rows) if rows else []


def robot(summaries: list[CalibrationSummary]) -> Iterable[str]:
    head = [
        "condition",
        "all gross poses rejected, %",
        "sound postures rejected, in all trials",
        f"vol over predicted (goal {GROSS_GOAL:g})",
        f"misfit flagged, % (goal {100 * FLAGGED_GOAL:g})",
        "`correlated`: covers, %",
        "95 % interval",
        "goal",
        "`correlated`: vol RMSE, mm",
    ]
    rows = []
    for s in summaries:
        if s.condition == "sphere_gross":
            rows.append(
                [
                    s.condition,
                    _percent(s.gross_found),
                    f"{s.sound_rejected}",
                    _marked(s.vol_mm / s.u_mm, GROSS_GOAL),
                    _percent(s.flagged),
                    "",
                    "",
                    "",
                    "",
                ]
            )
        if s.correlated.of:
            goal = CORRELATED_GOAL if s.condition == "sphere_systematic" else None
            rows.append(
                [
                    s.condition,
                    "",
                    f"{s.sound_rejected}",
                    "",
                    _percent(s.flagged),
                    *_share(s.correlated, goal),
                    f"{s.correlated_mm:.3f}",
                ]
            )
    return markdown(head, rows) if rows else []


def clock(summaries: list[CalibrationSummary]) -> Iterable[str]:
    head = [
        "condition",
        "offset RMSE, ms",
        f"over its bound (goal {OFFSET_GOAL:g})",
        "covers, %",
        "95 % interval",
        "goal",
        f"rotation RMSE, deg (goal, weaved: {ROTATION_GOAL_DEG:g})",
    ]
    rows = [
        [
            s.condition,
            f"{s.offset_ms:.3f}",
            _marked(s.offset_ratio, OFFSET_GOAL),
            *_share(s.offset_covered, COVER_GOAL.get(s.condition)),
            f"{s.rotation_deg:.4f}",
        ]
        for s in summaries
        if isfinite(s.offset_ms)
    ]
    return markdown(head, rows) if rows else []


def plans(summaries: list[CalibrationSummary]) -> Iterable[str]:
    head = [
        "trials",
        f"planned over random: median (goal {PLAN_GOAL:g})",
        "95th percentile",
        "bound, mm",
        "vol RMSE, mm",
    ]
    rows = [
        [
            f"{s.trials}",
            _marked(s.plan_ratio[0], PLAN_GOAL),
            f"{s.plan_ratio[1]:.3f}",
            f"{s.bound_mm:.3f}",
            f"{s.vol_mm:.3f}",
        ]
        for s in summaries
        if isfinite(s.plan_ratio[0])
    ]
    return markdown(head, rows) if rows else []


def methods(summaries: list[CalibrationSummary]) -> Iterable[str]:
    for s in summaries:
        if s.others:
            rows = [[name, f"{value:.3f}", f"{value / s.bound_mm:.3f}"] for name, value in s.others.items()]
            yield from markdown(["method", "vol RMSE, mm", "over the bound"], rows)
            yield ""
            yield "All but the bundle are given the signs and postures that the bundle has found."


def refusals(summaries: list[CalibrationSummary]) -> Iterable[str]:
    rows = [
        [
            s.condition,
            *(f"{n}" for n in (s.trials, len(s.refused), s.named)),
            advice(s.refused[0].refused if s.refused else ""),
        ]
        for s in summaries
        if s.condition in DEGENERATE
    ]
    return (
        markdown(
            [
                "set",
                "trials",
                "refused",
                "direction named",
                "the first one: predicted u over the field of view, advice",
            ],
            rows,
        )
        if rows
        else []
    )


def advice(refusal: str | None) -> str:
    """Of a refusal the predicted uncertainty, and what it says last: what would mend it."""
    predicted = re.search(r"predicted uncertainty ([\d.]+ mm)", refusal or "")
    last = (refusal or "").rpartition("; ")[2]
    return f"{predicted[1]}: {last}" if predicted else last


def crashes(summaries: list[CalibrationSummary]) -> list[str]:
    lines = [f"- {s.condition}, seed {r.seed}: **crashed**: {r.crashed}" for s in summaries for r in s.crashed]
    sound = [s for s in summaries if s.condition not in DEGENERATE]
    lines += [f"- {s.condition}, seed {r.seed}: refused: {r.refused}" for s in sound for r in s.refused[:5]]
    return [*lines, ""] if lines else []


def _marked(value: float, goal: float | None) -> str:
    return f"{value:.3f}" if goal is None or value <= goal else f"**{value:.3f}**"


def _goal(goal: float | None) -> str:
    return "" if goal is None else f"{goal:g}"


def _percent(share: Share) -> str:
    return f"{100 * share.value:.1f}"


def _share(share: Share, goal: tuple[float, float] | None) -> list[str]:
    if not share.of:
        return ["", "", ""]
    low, high = share.interval
    value = _percent(share)
    if goal and not goal[0] <= share.value <= goal[1]:
        value = f"**{value}**"
    words = "" if goal is None else f"{100 * goal[0]:g} to {100 * goal[1]:g}"
    return [value, f"{100 * low:.1f} to {100 * high:.1f}", words]
