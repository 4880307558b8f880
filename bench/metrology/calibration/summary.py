"""From the results of calibrations to the figures of one condition, and these as tables."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence
from functools import cached_property
from math import isfinite
from typing import Any

from scipy.stats import chi2

from bench.drawn.spheres import DEGENERATE, SOUND
from bench.metrology.calibration.part import SCANS
from bench.metrology.quantity import percentile
from bench.metrology.summary import CONDITION, Share, Summary, columns, largest, marked, rms, spelt
from bench.tables import markdown

ELLIPSOID = float(chi2.ppf(0.95, 6))
NEVER_REFUSED = ("sphere_nine", "sphere_six")  # the sound sets of the goal
VOL_GOAL = {"sphere_nine": 1.05, "sphere_stray": 1.10}  # over the bound
COVER_GOAL = dict.fromkeys(("sphere_nine", "sphere_six", "sphere_stray", *SCANS), (0.93, 0.97)) | dict.fromkeys(
    ("sphere_equator", "sphere_gross"), (0.90, 1.0)
)
CORRELATED_GOAL = (0.90, 0.98)
FLAGGED_GOAL, GROSS_GOAL, PLAN_GOAL, OFFSET_GOAL, ROTATION_GOAL_DEG = 0.90, 1.1, 0.67, 1.15, 0.03
NAMED = re.compile(r"do not determine the (translation|rotation|clock's offset)|distinct postures.*undetermined")


class CalibrationSummary(Summary):
    """Errors of a point over the field of view, RMS over the trials. NaN: not measured there."""

    conditions = (*SOUND, "sphere_planned", *DEGENERATE)

    @cached_property
    def vol_mm(self) -> float:
        return self.rms("vol_mm")

    @cached_property
    def bound_mm(self) -> float:
        return self.rms("bound_mm")

    @property
    def ratio(self) -> float:
        return self.vol_mm / self.bound_mm

    @property
    def named(self) -> int:
        """Refusals that say in words what is not determined."""
        return sum(named(r.refused) for r in self.refused)

    def _inside(self, name: str) -> Share:
        known = [getattr(r, name) for r in self.good if getattr(r, name) is not None]
        return Share(sum(v < ELLIPSOID for v in known), len(known))

    @cached_property
    def covered(self) -> Share:
        return self._inside("nees")

    @cached_property
    def correlated(self) -> Share:
        return self._inside("correlated_nees")

    @property
    def signs_wrong(self) -> int:
        """Trials with a posture on the wrong side of the laser plane."""
        return sum(r.signs_wrong > 0 for r in self.good)

    @property
    def silently_wrong(self) -> int:
        """Trials whose error is beyond all uncertainty, and no warning."""
        return sum(r.wrong and not r.warned for r in self.good)

    @property
    def offset_ratio(self) -> float:
        """RMS error of the clock's offset over the RMS of its bound."""
        return self.rms("offset_ms") / self.rms("offset_bound_ms")

    @cached_property
    def plan_ratio(self) -> tuple[float, float]:
        """Bound as planned over the median of random sets: median and 95th percentile."""
        ratios = [r.bound_mm / r.random_mm for r in self.good if r.bound_mm and r.random_mm]
        return percentile(ratios, 50), percentile(ratios, 95)

    @property
    def others(self) -> dict[str, float]:
        """By method, RMS error."""
        names = dict.fromkeys(name for r in self.good for name in r.others)
        return {name: rms(r.others.get(name) for r in self.good) for name in names}

    def checks(self) -> Iterator[tuple[bool, str]]:
        c, trials = self.condition, len(self.results)
        if c in DEGENERATE:
            yield len(self.refused) < trials, f"{trials - len(self.refused)} not refused"
            yield self.named < len(self.refused), f"{len(self.refused) - self.named} refusals name no direction"
            return
        yield c in NEVER_REFUSED and bool(self.refused), f"{len(self.refused)} sound sets refused"
        yield self.signs_wrong > 0 and c != "sphere_equator", f"{self.signs_wrong} with wrong signs"
        yield self.silently_wrong > 0, f"{self.silently_wrong} silently wrong"
        yield c in VOL_GOAL and self.ratio > VOL_GOAL[c], "error over its bound"
        yield c in COVER_GOAL and self.covered.outside(*COVER_GOAL[c]), "coverage of the ellipsoid"
        yield c == "sphere_gross" and self.vol_mm > GROSS_GOAL * self.rms("u_mm"), "error over the predicted one"
        yield c == "sphere_gross" and self.count("gross_found").value < 1, "gross poses that were not rejected"
        yield c == "sphere_systematic" and self.count("flagged").value < FLAGGED_GOAL, "flagged"
        yield c == "sphere_systematic" and self.correlated.outside(*CORRELATED_GOAL), "coverage, correlated"
        yield c in SCANS and self.count("offset_covered").outside(*COVER_GOAL[c]), "coverage of the clock offset"
        yield c in ("sphere_scans", "sphere_weaved") and self.offset_ratio > OFFSET_GOAL, "clock offset over its bound"
        yield c == "sphere_weaved" and self.rms("rotation_deg") > ROTATION_GOAL_DEG, "rotation"
        yield c == "sphere_planned" and self.plan_ratio[0] > PLAN_GOAL, "planned over random"

    @classmethod
    def tables(cls, every: Sequence[Any]) -> Iterable[tuple[str, Iterable[str]]]:
        sound = [s for s in every if s.condition not in DEGENERATE]
        yield (
            "Error over the field of view against the Cramer-Rao bound, coverage of the 95 % ellipsoid",
            columns(
                (s for s in sound if s.condition != "sphere_planned"),
                CONDITION,
                ("trials", lambda s: len(s.results)),
                ("refused", lambda s: len(s.refused)),
                ("vol RMSE, mm", lambda s: f"{s.vol_mm:.3f}"),
                ("bound, mm", lambda s: f"{s.bound_mm:.3f}"),
                ("ratio", lambda s: marked(s.ratio, VOL_GOAL.get(s.condition))),
                ("goal of the ratio", lambda s: spelt(VOL_GOAL.get(s.condition))),
                ("stated u, mm", lambda s: f"{s.rms('u_mm'):.3f}"),
                (
                    ["covers, %", "95 % interval", "goal of the coverage"],
                    lambda s: s.covered.cells(COVER_GOAL.get(s.condition)),
                ),
                ("wrong signs", lambda s: s.signs_wrong),
                ("silently wrong", lambda s: s.silently_wrong),
                ("solve, ms (median)", lambda s: f"{s.median_ms('solve'):.1f}"),
            ),
        )
        yield "Gross poses, systematic errors of the robot", _robot(sound)
        yield (
            "Scans over the sphere: clock offset, rotation",
            columns(
                (s for s in sound if isfinite(s.rms("offset_ms"))),
                CONDITION,
                ("offset RMSE, ms", lambda s: f"{s.rms('offset_ms'):.3f}"),
                (f"over its bound (goal {OFFSET_GOAL:g})", lambda s: marked(s.offset_ratio, OFFSET_GOAL)),
                (
                    ["covers, %", "95 % interval", "goal"],
                    lambda s: s.count("offset_covered").cells(COVER_GOAL.get(s.condition)),
                ),
                (
                    f"rotation RMSE, deg (goal, weaved: {ROTATION_GOAL_DEG:g})",
                    lambda s: f"{s.rms('rotation_deg'):.4f}",
                ),
            ),
        )
        yield (
            "Nine planned postures beside the median of random nines, by their bounds",
            columns(
                (s for s in sound if isfinite(s.plan_ratio[0])),
                ("trials", lambda s: len(s.results)),
                (
                    f"planned over random: median (goal {PLAN_GOAL:g})",
                    lambda s: marked(s.plan_ratio[0], PLAN_GOAL),
                ),
                ("95th percentile", lambda s: f"{s.plan_ratio[1]:.3f}"),
                ("bound, mm", lambda s: f"{s.bound_mm:.3f}"),
                ("vol RMSE, mm", lambda s: f"{s.vol_mm:.3f}"),
            ),
        )
        yield "Methods side by side, `sphere_grid`: three orientations, three places each", _methods(sound)
        yield (
            "Sets that determine nothing",
            columns(
                (s for s in every if s.condition in DEGENERATE),
                ("set", lambda s: s.condition),
                ("trials", lambda s: len(s.results)),
                ("refused", lambda s: len(s.refused)),
                ("direction named", lambda s: s.named),
                (
                    "the first one: predicted u over the field of view, advice",
                    lambda s: advice(s.refused[0].refused if s.refused else ""),
                ),
            ),
        )

    @classmethod
    def worst(cls, results: list[Any], count: int) -> Iterator[str]:
        """The trials whose error is largest beside their bound."""
        for r in largest(results, lambda r: r.vol_mm / r.bound_mm if r.vol_mm and r.bound_mm else None, count):
            told = f"vol {r.vol_mm:.3f} mm, bound {r.bound_mm:.3f}, stated {r.u_mm or 0:.3f}"
            yield f"{r.condition}, seed {r.seed}: {told}"


def named(refusal: str) -> bool:
    """Whether a refusal says in words what is not determined."""
    return bool(NAMED.search(refusal))


def _robot(every: Sequence[CalibrationSummary]) -> list[str]:
    """A row of gross poses, a row of errors that hang together."""
    heads = ["condition", "all gross poses rejected, %", "sound postures rejected, in all trials"]
    heads += [f"vol over predicted (goal {GROSS_GOAL:g})", f"misfit flagged, % (goal {100 * FLAGGED_GOAL:g})"]
    heads += ["`correlated`: covers, %", "95 % interval", "goal", "`correlated`: vol RMSE, mm"]
    rows = []
    for s in every:
        rejected, flagged = f"{sum(r.sound_rejected for r in s.good)}", s.count("flagged").percent
        if s.condition == "sphere_gross":
            over = marked(s.vol_mm / s.rms("u_mm"), GROSS_GOAL)
            rows.append([s.condition, s.count("gross_found").percent, rejected, over, flagged, "", "", "", ""])
        if s.correlated.of:
            cells = s.correlated.cells(CORRELATED_GOAL if s.condition == "sphere_systematic" else None)
            rows.append([s.condition, "", rejected, "", flagged, *cells, f"{s.rms('correlated_vol_mm'):.3f}"])
    return markdown(heads, rows) if rows else []


def _methods(every: Sequence[CalibrationSummary]) -> Iterator[str]:
    for s in every:
        if s.others:
            rows = [[name, f"{value:.3f}", f"{value / s.bound_mm:.3f}"] for name, value in s.others.items()]
            yield from markdown(["method", "vol RMSE, mm", "over the bound"], rows)
            yield ""
            yield "All but the bundle are given the signs and postures that the bundle has found."


def advice(refusal: str) -> str:
    """Of a refusal the predicted uncertainty, and what it says last: what would mend it."""
    predicted = re.search(r"predicted uncertainty ([\d.]+ mm)", refusal)
    last = refusal.rpartition("; ")[2]
    return f"{predicted[1]}: {last}" if predicted else last
