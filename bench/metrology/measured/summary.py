"""From the results of the measured loop to the figures of one condition, and these as tables."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from bench.metrology.figures import Cover, cover, told
from bench.metrology.measured.part import CELLS, MeasuredResult
from bench.metrology.planning.summary import covered, covered_head
from bench.metrology.quantity import percentile
from bench.metrology.table import markdown, study_text
from workbench.artefacts import Requirements
from workbench.units import DEG, Float

MEASURED_CONDITIONS = tuple(CELLS)
ROOT_P95_MM, LOUD_P95_MM, BEVEL_P95_DEG = 0.05, 0.10, 0.1
LOUD_MM = 0.05  # of noise that does not repeat, from which the wider goal holds
ROOT_MM, BEVEL_DEG = Requirements().root_nominal_mm, Requirements().bevel_nominal_deg
SINE = math.sin(BEVEL_DEG * DEG)


@dataclass(frozen=True, slots=True)
class MeasuredSummary:
    """The figures of one condition; errors are of places every 2 mm, of all parts together."""

    condition: str
    parts: int
    finished: int
    refused: list[MeasuredResult]
    beyond: list[MeasuredResult]
    crashed: list[MeasuredResult]
    blind: Float  # |root - 1.5| mm: median, 95th percentile, worst
    corrected: Float  # the same of the finished parts
    blind_bevel: Float  # |bevel - 40| deg, likewise
    bevel: Float  # of the finished parts
    goal_mm: float
    floor_mm: float  # 95th percentile of what the robot alone does to a root face in one run: nothing can be better
    predicted: Cover  # finished root beside what correction and repeatability say, along b, mm
    predicted_turn: Cover  # finished bevel angle beside what the correction says, deg
    root_cover: Cover
    sharp_cover: Cover  # of the root, where the lower edge is declared to be sharp
    bevel_cover: Cover
    too_deep: list[int]  # seeds of parts below the root's tolerance that a blind run would have left in it
    blind_too_deep: int  # parts below the tolerance when milled blindly
    seconds: float  # a part, median

    @property
    def shortcomings(self) -> Iterable[str]:
        """In words, what does not reach its goal."""
        checks = [
            (bool(self.crashed), f"{len(self.crashed)} crashed"),
            (not self.corrected[1] <= self.goal_mm, "root"),
            (not self.bevel[1] <= BEVEL_P95_DEG, "bevel"),
            (bool(self.too_deep), f"{len(self.too_deep)} cut too deep"),
            (self.root_cover.surely_not_covered, "inspected root within 2u"),
            (self.sharp_cover.surely_not_covered, "inspected root within 2u, edge declared sharp"),
            (self.bevel_cover.surely_not_covered, "inspected bevel within 2u"),
            (self.predicted.surely_not_covered, "finished root within 2u of the correction"),
            (self.predicted_turn.surely_not_covered, "finished bevel within 2u of the correction"),
        ]
        return [f"{self.condition}: {words}" for wrong, words in checks if wrong]


def summarise_measured(condition: str, results: list[MeasuredResult]) -> MeasuredSummary:
    """All figures of one condition."""
    results = sorted(results, key=lambda r: r.seed)
    good = [r for r in results if not (r.refused or r.crashed or r.beyond)]
    cell = CELLS[condition]
    tolerance = ROOT_MM + Requirements().root_tolerance_mm[0]
    return MeasuredSummary(
        condition=condition,
        parts=len(results),
        finished=len(good),
        refused=[r for r in results if r.refused],
        beyond=[r for r in results if r.beyond],
        crashed=[r for r in results if r.crashed],
        blind=_three(_pooled(good, "places", "root_blind_mm") - ROOT_MM),
        corrected=_three(_pooled(good, "places", "root_mm") - ROOT_MM),
        blind_bevel=_three(_pooled(good, "places", "bevel_blind_deg") - BEVEL_DEG),
        bevel=_three(_pooled(good, "places", "bevel_deg") - BEVEL_DEG),
        goal_mm=LOUD_P95_MM if cell.noise_mm >= LOUD_MM else ROOT_P95_MM,
        floor_mm=1.96 * cell.noise_mm / SINE,
        predicted=cover(
            (
                (_column(r, "places", "root_mm") - ROOT_MM) * SINE,
                np.hypot(_column(r, "places", "correction_u_mm"), cell.noise_mm),
            )
            for r in good
        ),
        predicted_turn=cover(
            (_column(r, "places", "bevel_deg") - BEVEL_DEG, _column(r, "places", "correction_u_deg")) for r in good
        ),
        root_cover=_cover(good, "root", "mm"),
        sharp_cover=cover(
            (
                _column(r, "sections", "sharp_mm") - _column(r, "sections", "root_true_mm"),
                _column(r, "sections", "sharp_u_mm"),
            )
            for r in good
        ),
        bevel_cover=_cover(good, "bevel", "deg"),
        too_deep=[r.seed for r in good if _least(r, "root_mm") < tolerance <= _least(r, "root_blind_mm")],
        blind_too_deep=sum(_least(r, "root_blind_mm") < tolerance for r in (*good, *(r for r in results if r.beyond))),
        seconds=percentile([sum(r.seconds.values()) for r in good], 50),
    )


def _cover(good: list[MeasuredResult], name: str, unit: str) -> Cover:
    """Inspected less true, beside its u."""
    return cover(
        (
            _column(r, "sections", f"{name}_{unit}") - _column(r, "sections", f"{name}_true_{unit}"),
            _column(r, "sections", f"{name}_u_{unit}"),
        )
        for r in good
    )


def _column(result: MeasuredResult, table: str, name: str) -> Float:
    return np.array(getattr(result, table).get(name, []), dtype=float)


def _pooled(results: list[MeasuredResult], table: str, name: str) -> Float:
    return np.concatenate([np.empty(0), *(_column(r, table, name) for r in results)])


def _three(errors: Float) -> Float:
    known = np.abs(errors[np.isfinite(errors)])
    return np.array([percentile(known, q) for q in (50, 95, 100)])


def _least(result: MeasuredResult, name: str) -> float:
    values = _column(result, "places", name)
    return float(np.nanmin(values)) if np.isfinite(values).any() else math.inf


def worst_measured(results: list[MeasuredResult], count: int) -> Iterator[str]:
    """The finished parts whose root is farthest from what was asked."""
    known = [(float(np.nanmax(np.abs(off))), r) for r in results if (off := _column(r, "places", "root_mm") - 1.5).size]
    for most, r in sorted(known, key=lambda pair: -pair[0])[:count]:
        yield f"{r.condition}, seed {r.seed}, {r.shape}: root off by up to {most:.3f} mm"


def measured_tables(summaries: list[MeasuredSummary], command: str) -> str:
    """All tables, and what fell short."""
    parts = [
        (
            "Blind and corrected: all places of the finished parts; median, 95th percentile, worst",
            accuracy(summaries),
        ),
        ("What the uncertainties are worth", uncertainty(summaries)),
    ]
    return study_text(command, parts, causes(summaries), summaries)


def accuracy(summaries: list[MeasuredSummary]) -> list[str]:
    head = ["condition", "parts", "finished", "beyond the allowance", "refused", "blind, abs(root - 1.5), mm"]
    head += ["corrected, abs(root - 1.5), mm", "goal (95 %)", "the robot alone (95 %)"]
    head += [
        "blind, abs(bevel - 40), deg",
        f"corrected, abs(bevel - 40), deg (goal {BEVEL_P95_DEG:g})",
        "too deep: blind, corrected",
        "s a part",
    ]
    rows = []
    for s in summaries:
        row = [s.condition, f"{s.parts}", f"{s.finished}", f"{len(s.beyond)}", f"{len(s.refused)}", three(s.blind, 3)]
        row += [three(s.corrected, 3), f"{s.goal_mm:g}", f"{s.floor_mm:.3f}", three(s.blind_bevel, 3)]
        rows.append([*row, three(s.bevel, 3), f"{s.blind_too_deep}, {len(s.too_deep)}", f"{s.seconds:.1f}"])
    return markdown(head, rows)


def uncertainty(summaries: list[MeasuredSummary]) -> list[str]:
    head = ["condition"]
    for name, unit in (
        ("finished, along b", "mm"),
        ("finished, bevel", "deg"),
        ("inspected root", "mm"),
        ("inspected root, edge declared sharp", "mm"),
        ("inspected bevel", "deg"),
    ):
        head += covered_head(name, unit)
    rows = [
        [
            s.condition,
            *covered(s.predicted, 3),
            *covered(s.predicted_turn, 3),
            *covered(s.root_cover, 4),
            *covered(s.sharp_cover, 4),
            *covered(s.bevel_cover, 3),
        ]
        for s in summaries
    ]
    return markdown(head, rows)


def causes(summaries: list[MeasuredSummary]) -> list[str]:
    """Every part that was refused or crashed, with the cause; those beyond the allowance are only counted."""
    found = [
        (s.condition, word, cause, r)
        for s in summaries
        for word, cause, r in (
            *(("refused", r.refused, r) for r in s.refused),
            *(("**crashed**", r.crashed, r) for r in s.crashed),
        )
    ]
    return told(found)


def three(values: Float, digits: int) -> str:
    return ", ".join(f"{v:.{digits}f}" for v in values)
