"""From the results of calibrations to the figures of one condition, and these as tables."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from math import isfinite

import numpy as np
from scipy.stats import beta, chi2

from bench.drawn.spheres import DEGENERATE, SOUND
from bench.metrology.calibration.part import CalibrationResult
from bench.metrology.quantity import percentile
from bench.metrology.table import markdown, study_text

CALIBRATION_CONDITIONS = (*SOUND, "sphere_planned", *DEGENERATE)
ELLIPSOID = float(chi2.ppf(0.95, 6))
NEVER_REFUSED = ("sphere_nine", "sphere_six")  # the sound sets of the goal
VOL_GOAL = {"sphere_nine": 1.05, "sphere_stray": 1.10}  # over the bound
COVER_GOAL = {
    "sphere_nine": (0.93, 0.97),
    "sphere_six": (0.93, 0.97),
    "sphere_stray": (0.93, 0.97),
    "sphere_equator": (0.90, 1.0),
    "sphere_gross": (0.90, 1.0),
}
SCANS = ("sphere_scans", "sphere_weaved", "sphere_scans_common", "sphere_weaved_common")
COVER_GOAL |= dict.fromkeys(SCANS, (0.93, 0.97))
CORRELATED_GOAL = (0.90, 0.98)
FLAGGED_GOAL, GROSS_GOAL, PLAN_GOAL, OFFSET_GOAL, ROTATION_GOAL_DEG = 0.90, 1.1, 0.67, 1.15, 0.03


NAMED = re.compile(r"do not determine the (translation|rotation|clock's offset)|distinct postures.*undetermined")


@dataclass(frozen=True, slots=True)
class Share:
    """A share of trials, with its 95 % interval (Clopper and Pearson)."""

    count: int
    of: int

    @property
    def value(self) -> float:
        return self.count / self.of if self.of else float("nan")

    @property
    def interval(self) -> tuple[float, float]:
        k, n = self.count, self.of
        low = float(beta.ppf(0.025, k, n - k + 1)) if k else 0.0
        high = float(beta.ppf(0.975, k + 1, n - k)) if k < n else 1.0
        return low, high

    def outside(self, low: float, high: float) -> bool:
        """Whether even the interval that the number of trials leaves open lies outside."""
        return bool(self.of and (self.interval[1] < low or self.interval[0] > high))


@dataclass(frozen=True, slots=True)
class CalibrationSummary:
    """The figures of one condition. NaN: not measured there."""

    condition: str
    trials: int
    refused: list[CalibrationResult]
    crashed: list[CalibrationResult]
    named: int  # refusals that say in words what is not determined
    vol_mm: float  # RMS over the trials
    bound_mm: float
    u_mm: float  # as stated
    covered: Share
    correlated: Share
    correlated_mm: float
    signs_wrong: int  # trials with a posture on the wrong side of the laser plane
    silently_wrong: int  # trials whose error is beyond all uncertainty, and no warning
    flagged: Share
    gross_found: Share
    sound_rejected: int  # postures, in all trials
    offset_ratio: float  # RMS error of the clock's offset over the RMS of its bound
    offset_ms: float
    offset_covered: Share
    rotation_deg: float  # RMS
    plan_ratio: tuple[float, float]  # planned over the median of random sets: median and 95th percentile
    others: dict[str, float] = field(default_factory=dict)  # method -> RMS vol error
    solve_ms: float = float("nan")

    @property
    def ratio(self) -> float:
        return self.vol_mm / self.bound_mm

    @property
    def shortcomings(self) -> Iterable[str]:
        """In words, what does not reach its goal."""
        return [f"{self.condition}: {words}" for wrong, words in self._checks() if wrong]

    def _checks(self) -> Iterator[tuple[bool, str]]:
        c = self.condition
        yield bool(self.crashed), f"{len(self.crashed)} crashed"
        if c in DEGENERATE:
            yield len(self.refused) < self.trials, f"{self.trials - len(self.refused)} not refused"
            yield self.named < len(self.refused), f"{len(self.refused) - self.named} refusals name no direction"
            return
        yield c in NEVER_REFUSED and bool(self.refused), f"{len(self.refused)} sound sets refused"
        yield self.signs_wrong > 0 and c != "sphere_equator", f"{self.signs_wrong} with wrong signs"
        yield self.silently_wrong > 0, f"{self.silently_wrong} silently wrong"
        yield c in VOL_GOAL and self.ratio > VOL_GOAL[c], "error over its bound"
        yield c in COVER_GOAL and self.covered.outside(*COVER_GOAL[c]), "coverage of the ellipsoid"
        yield c == "sphere_gross" and self.vol_mm > GROSS_GOAL * self.u_mm, "error over the predicted one"
        yield c == "sphere_gross" and self.gross_found.value < 1, "gross poses that were not rejected"
        yield c == "sphere_systematic" and self.flagged.value < FLAGGED_GOAL, "flagged"
        yield c == "sphere_systematic" and self.correlated.outside(*CORRELATED_GOAL), "coverage, correlated"
        yield c in SCANS and self.offset_covered.outside(*COVER_GOAL[c]), "coverage of the clock offset"
        yield c in ("sphere_scans", "sphere_weaved") and self.offset_ratio > OFFSET_GOAL, "clock offset over its bound"
        yield c == "sphere_weaved" and self.rotation_deg > ROTATION_GOAL_DEG, "rotation"
        yield c == "sphere_planned" and self.plan_ratio[0] > PLAN_GOAL, "planned over random"


def summarise_calibrations(condition: str, results: list[CalibrationResult]) -> CalibrationSummary:
    """All figures of one condition."""
    results = sorted(results, key=lambda r: r.seed)
    refused, crashed = [r for r in results if r.refused], [r for r in results if r.crashed]
    good = [r for r in results if not (r.refused or r.crashed)]
    names = list(dict.fromkeys(name for r in good for name in r.others))
    ratios = [r.bound_mm / r.random_mm for r in good if r.bound_mm and r.random_mm]
    return CalibrationSummary(
        condition=condition,
        trials=len(results),
        refused=refused,
        crashed=crashed,
        named=sum(named(r.refused) for r in refused if r.refused),
        vol_mm=_rms(r.vol_mm for r in good),
        bound_mm=_rms(r.bound_mm for r in good),
        u_mm=_rms(r.u_mm for r in good),
        covered=_inside(r.nees for r in good),
        correlated=_inside(r.correlated_nees for r in good),
        correlated_mm=_rms(r.correlated_vol_mm for r in good),
        signs_wrong=sum(r.signs_wrong > 0 for r in good),
        silently_wrong=sum(r.wrong and not r.warned for r in good),
        flagged=Share(sum(r.flagged for r in good), len(good)),
        gross_found=Share(sum(bool(r.gross_found) for r in good), sum(r.gross_found is not None for r in good)),
        sound_rejected=sum(r.sound_rejected for r in good),
        offset_ratio=_rms(r.offset_ms for r in good) / _rms(r.offset_bound_ms for r in good),
        offset_covered=Share(
            sum(r.offset_covered is True for r in good), sum(r.offset_covered is not None for r in good)
        ),
        offset_ms=_rms(r.offset_ms for r in good),
        rotation_deg=_rms(r.rotation_deg for r in good),
        plan_ratio=(percentile(ratios, 50), percentile(ratios, 95)),
        others={name: _rms(r.others.get(name) for r in good) for name in names},
        solve_ms=percentile([1e3 * r.seconds["solve"] for r in good if "solve" in r.seconds], 50),
    )


def named(refusal: str) -> bool:
    """Whether a refusal says in words what is not determined."""
    return bool(NAMED.search(refusal))


def worst_calibrations(results: list[CalibrationResult], count: int) -> Iterator[str]:
    """The trials whose error is largest beside their bound, as lines."""
    known = [r for r in results if r.vol_mm and r.bound_mm]
    for r in sorted(known, key=lambda r: -(r.vol_mm or 0) / (r.bound_mm or 1))[:count]:
        yield f"{r.condition}, seed {r.seed}: vol {r.vol_mm:.3f} mm, bound {r.bound_mm:.3f}, stated {r.u_mm or 0:.3f}"


def _rms(values: Iterable[float | None]) -> float:
    known = np.array([v for v in values if v is not None], float)
    return float(np.sqrt(np.mean(known**2))) if len(known) else float("nan")


def _inside(values: Iterable[float | None]) -> Share:
    known = [v for v in values if v is not None]
    return Share(sum(v < ELLIPSOID for v in known), len(known))


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
