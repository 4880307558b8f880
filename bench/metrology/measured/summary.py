"""From the results of the measured loop to the figures of one condition, and these as tables."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from functools import cached_property
from typing import Any

import numpy as np

from bench.metrology.figures import Cover, cover
from bench.metrology.measured.part import CELLS, MeasuredResult
from bench.metrology.quantity import percentile
from bench.metrology.summary import CONDITION, Column, Summary, columns, largest
from workbench.artefacts import Requirements
from workbench.units import DEG, Float

ROOT_P95_MM, LOUD_P95_MM, BEVEL_P95_DEG = 0.05, 0.10, 0.1
LOUD_MM = 0.05  # of noise that does not repeat, from which the wider goal holds
ROOT_MM, BEVEL_DEG = Requirements().root_nominal_mm, Requirements().bevel_nominal_deg
LEAST_MM = ROOT_MM + Requirements().root_tolerance_mm[0]
SINE = math.sin(BEVEL_DEG * DEG)


class MeasuredSummary(Summary):
    """Errors are of places every 2 mm, of all parts together."""

    conditions = tuple(CELLS)

    @cached_property
    def beyond(self) -> list[Any]:
        return self.having("beyond")

    @cached_property
    def good(self) -> list[Any]:
        return [r for r in self.results if not (r.refused or r.crashed or r.beyond)]

    def off(self, name: str, wanted: float) -> Float:
        """|error| of the finished parts: median, 95th percentile, worst."""
        errors = np.concatenate([np.empty(0), *(_column(r, name) for r in self.good)]) - wanted
        known = np.abs(errors[np.isfinite(errors)])
        return np.array([percentile(known, q) for q in (50, 95, 100)])

    @cached_property
    def corrected(self) -> Float:  # mm
        return self.off("root_mm", ROOT_MM)

    @cached_property
    def blind(self) -> Float:  # mm
        return self.off("root_blind_mm", ROOT_MM)

    @cached_property
    def bevel(self) -> Float:  # deg
        return self.off("bevel_deg", BEVEL_DEG)

    @property
    def goal_mm(self) -> float:
        return LOUD_P95_MM if CELLS[self.condition].noise_mm >= LOUD_MM else ROOT_P95_MM

    @cached_property
    def predicted(self) -> Cover:
        """Finished root beside what correction and repeatability say, along b, mm."""
        noise = CELLS[self.condition].noise_mm
        return cover(
            (
                (_column(r, "root_mm") - ROOT_MM) * SINE,
                np.hypot(_column(r, "correction_u_mm"), noise),
            )
            for r in self.good
        )

    @cached_property
    def predicted_turn(self) -> Cover:
        """Finished bevel angle beside what the correction says, deg."""
        names = ("bevel_deg", "correction_u_deg")
        pairs = ([_column(r, name) for name in names] for r in self.good)
        return cover((bevel - BEVEL_DEG, u) for bevel, u in pairs)

    @property
    def too_deep(self) -> list[int]:
        """Seeds of parts below the root's tolerance that a blind run would have left in it."""
        return [r.seed for r in self.good if _least(r, "root_mm") < LEAST_MM <= _least(r, "root_blind_mm")]

    @property
    def blind_too_deep(self) -> int:
        """Parts below the tolerance when milled blindly."""
        return sum(_least(r, "root_blind_mm") < LEAST_MM for r in (*self.good, *self.beyond))

    def checks(self) -> Iterator[tuple[bool, str]]:
        yield not self.corrected[1] <= self.goal_mm, "root"
        yield not self.bevel[1] <= BEVEL_P95_DEG, "bevel"
        yield bool(self.too_deep), f"{len(self.too_deep)} cut too deep"
        yield self.predicted.surely_not_covered, "finished root within 2u of the correction"
        yield self.predicted_turn.surely_not_covered, "finished bevel within 2u of the correction"

    @classmethod
    def tables(cls, every: Sequence[Any]) -> Iterable[tuple[str, Iterable[str]]]:
        yield (
            "Blind and corrected: all places of the finished parts; median, 95th percentile, worst",
            columns(
                every,
                CONDITION,
                ("parts", lambda s: len(s.results)),
                ("finished", lambda s: len(s.good)),
                ("beyond the allowance", lambda s: len(s.beyond)),
                ("refused", lambda s: len(s.refused)),
                ("blind, abs(root - 1.5), mm", lambda s: three(s.blind)),
                ("corrected, abs(root - 1.5), mm", lambda s: three(s.corrected)),
                ("goal (95 %)", lambda s: f"{s.goal_mm:g}"),
                ("the robot alone (95 %)", lambda s: f"{1.96 * CELLS[s.condition].noise_mm / SINE:.3f}"),
                ("blind, abs(bevel - 40), deg", lambda s: three(s.off("bevel_blind_deg", BEVEL_DEG))),
                (f"corrected, abs(bevel - 40), deg (goal {BEVEL_P95_DEG:g})", lambda s: three(s.bevel)),
                ("too deep: blind, corrected", lambda s: f"{s.blind_too_deep}, {len(s.too_deep)}"),
                ("s a part", lambda s: f"{s.median_s():.1f}"),
            ),
        )
        yield (
            "Uncertainties of the correction",
            columns(
                every,
                CONDITION,
                covered("finished, along b", "mm", lambda s: s.predicted, 3),
                covered("finished, bevel", "deg", lambda s: s.predicted_turn, 3),
            ),
        )

    @classmethod
    def worst(cls, results: list[Any], count: int) -> Iterator[str]:
        """The finished parts whose root is farthest from what was asked."""

        def off(r: MeasuredResult) -> float | None:
            errors = _column(r, "root_mm") - ROOT_MM
            return float(np.nanmax(np.abs(errors))) if errors.size else None

        for r in largest(results, off, count):
            yield f"{r.condition}, seed {r.seed}, {r.shape}: root off by up to {off(r):.3f} mm"


def _column(result: MeasuredResult, name: str) -> Float:
    return np.array(result.places.get(name, []), dtype=float)


def _least(result: MeasuredResult, name: str) -> float:
    values = _column(result, name)
    return float(np.nanmin(values)) if np.isfinite(values).any() else math.inf


def three(values: Float) -> str:
    return ", ".join(f"{v:.3f}" for v in values)


def covered(name: str, unit: str, of: Any, digits: int) -> Column:
    """Columns of how errors of a summary lie beside their u."""

    def cells(summary: Any) -> list[str]:
        c: Cover = of(summary)
        share = f"{100 * c.share:.1f}"
        return [
            f"**{share}**" if c.surely_not_covered else share,
            f"{100 * c.low:.1f} to {100 * c.high:.1f}",
            f"{c.bias:+.{digits}f}, {c.rms:.{digits}f}",
            f"{c.mean_u:.{digits}f}",
        ]

    heads = [f"{name}: within 2u, %", "95 % interval", f"{name}: mean, RMS error, {unit}", f"{name}: mean u, {unit}"]
    return heads, cells
