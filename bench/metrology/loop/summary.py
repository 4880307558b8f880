"""From the results of the closed loop to the figures of one condition, and these as tables."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from bench.metrology.figures import Cover, Spread, cover, spread, told
from bench.metrology.loop.part import LoopResult
from bench.metrology.planning.summary import covered, covered_head, three
from bench.metrology.quantity import percentile
from bench.metrology.table import markdown, study_text
from workbench.artefacts import Requirements
from workbench.units import Float

LOOP_CONDITIONS = ("raw_straight", "raw_arc", "raw_wavy", "raw_drift", "raw_outliers_5", "raw_clamps", "raw_rough")
ROOT_GOAL_MM, BEVEL_GOAL_DEG = 0.03, 0.1  # every section, perfect mechanics


@dataclass(frozen=True, slots=True)
class LoopCase:
    """The figures of one case. `Spread`: of each part's worst section; `Cover`: of inspected less milled."""

    root: Spread  # mm, |inspected - nominal|
    bevel: Spread  # deg
    milled_root: Spread  # mm, |milled - nominal|
    milled_bevel: Spread  # deg
    root_cover: Cover  # mm
    bevel_cover: Cover  # deg
    mean_off: Spread  # mm, |mean over the sections of (inspected - nominal) - what the injected offset implies|
    measured: int  # sections
    sections: int
    left_out: int  # sections beside stretches that the plan leaves alone


@dataclass(frozen=True, slots=True)
class LoopSummary:
    """The figures of one condition."""

    condition: str
    parts: int
    refused: list[LoopResult]
    crashed: list[LoopResult]
    warned: list[LoopResult]  # by the mill, with perfect mechanics
    cases: dict[str, LoopCase]
    seconds: float  # a part, median

    @property
    def shortcomings(self) -> Iterable[str]:
        """In words, what does not reach its goal."""
        checks = [(bool(self.crashed), f"{len(self.crashed)} crashed"), (bool(self.warned), "the mill warns")]
        for name, case in self.cases.items():
            checks += [
                (not case.root.met, f"root, {name}"),
                (not case.bevel.met, f"bevel, {name}"),
                (case.root_cover.surely_not_covered, f"root within 2u, {name}"),
                (case.bevel_cover.surely_not_covered, f"bevel within 2u, {name}"),
            ]
        return [f"{self.condition}: {words}" for wrong, words in checks if wrong]


def summarise_loops(condition: str, results: list[LoopResult]) -> LoopSummary:
    """All figures of one condition."""
    results = sorted(results, key=lambda r: r.seed)
    good = [r for r in results if not (r.refused or r.crashed)]
    return LoopSummary(
        condition=condition,
        parts=len(results),
        refused=[r for r in results if r.refused],
        crashed=[r for r in results if r.crashed],
        warned=[r for r in good if r.warnings["perfect"]],
        cases={name: _case(name, good) for name in dict.fromkeys(n for r in good for n in r.cases)},
        seconds=percentile([sum(r.seconds.values()) for r in good], 50),
    )


def _case(name: str, parts: list[LoopResult]) -> LoopCase:
    values = [_cut_sections(part, name) for part in parts]
    nominal, perfect = Requirements(), name == "perfect"

    def worst(key: str, about: float, goal: float | None = None) -> Spread:
        return spread((_greatest(v[key] - about) for v in values), goal if perfect else None)

    root, bevel = nominal.root_nominal_mm, nominal.bevel_nominal_deg
    return LoopCase(
        root=worst("root_mm", root, ROOT_GOAL_MM),
        bevel=worst("bevel_deg", bevel, BEVEL_GOAL_DEG),
        milled_root=worst("root_milled_mm", root),
        milled_bevel=worst("bevel_milled_deg", bevel),
        root_cover=cover((v["root_mm"] - v["root_milled_mm"], v["root_u_mm"]) for v in values),
        bevel_cover=cover((v["bevel_deg"] - v["bevel_milled_deg"], v["bevel_u_deg"]) for v in values),
        mean_off=spread(_mean_off(v["root_mm"] - v["root_injected_mm"]) for v in values),
        measured=sum(int(np.isfinite(v["root_mm"]).sum()) for v in values),
        sections=sum(len(v["root_mm"]) for v in values),
        left_out=sum(not cut for part in parts for cut in part.cut[name]),
    )


def _cut_sections(result: LoopResult, case: str) -> dict[str, Float]:
    """Values of the sections that the plan cuts."""
    cut = np.array(result.cut[case], dtype=bool)
    return {key: np.array(column, dtype=float)[cut] for key, column in result.cases[case].items()}


def _greatest(errors: Float) -> float | None:
    return float(np.nanmax(np.abs(errors))) if np.isfinite(errors).any() else None


def _mean_off(errors: Float) -> float | None:
    return abs(float(np.nanmean(errors))) if np.isfinite(errors).any() else None


def worst_loops(results: list[LoopResult], count: int) -> Iterator[str]:
    """The parts whose worst section, with perfect mechanics, is farthest from nominal, section by section."""
    known = [(_section_errors(r), r) for r in results if "perfect" in r.cases]
    for errors, r in sorted(known, key=lambda pair: -np.nanmax(np.abs(pair[0]), initial=0.0))[:count]:
        sections = " ".join(f"{e:+.4f}" for e in errors)
        yield f"{r.condition}, seed {r.seed}: inspected root - 1.5, mm: {sections}"


def _section_errors(result: LoopResult) -> Float:
    return _cut_sections(result, "perfect")["root_mm"] - Requirements().root_nominal_mm


def loop_tables(summaries: list[LoopSummary], command: str) -> str:
    """All tables, and what fell short."""
    parts = [
        (
            "Perfect mechanics: the worst section of each part; median, 95th percentile and worst of the parts",
            perfect(summaries),
        ),
        ("Hand-eye error of 0.4 mm and robot noise of 0.1 mm: inspected beside injected", injected(summaries)),
        ("Inspected less milled, beside its uncertainty", uncertainty(summaries)),
    ]
    return study_text(command, parts, causes(summaries), summaries)


def perfect(summaries: list[LoopSummary]) -> list[str]:
    """How far root face and bevel angle lie from their nominal values, as inspected and as milled."""
    head = ["condition", "parts", f"inspected root - 1.5, mm (goal {ROOT_GOAL_MM:g})"]
    head += [f"inspected bevel - 40, deg (goal {BEVEL_GOAL_DEG:g})", "milled root - 1.5, mm", "milled bevel - 40, deg"]
    head += ["sections measured", "beside what is not cut", "refused", "s a part", "met"]
    rows = []
    for s in summaries:
        if "perfect" in s.cases:
            c = s.cases["perfect"]
            row = [s.condition, f"{s.parts}", three(c.root, 4), three(c.bevel, 3), three(c.milled_root, 4)]
            row += [
                three(c.milled_bevel, 3),
                f"{c.measured} of {c.sections}",
                f"{c.left_out}",
                f"{len(s.refused)}",
                f"{s.seconds:.1f}",
            ]
            rows.append([*row, "yes" if c.root.met and c.bevel.met else "**no**"])
    return markdown(head, rows)


def injected(summaries: list[LoopSummary]) -> list[str]:
    """The hand-eye error moves the whole bevel, the robot's noise comes on top, differently at each section."""
    head = ["condition", "inspected root - 1.5, mm", "milled root - 1.5, mm"]
    head += ["its mean over the part less what the hand-eye error implies, mm", "inspected bevel - 40, deg"]
    rows = [
        [s.condition, three(c.root, 3), three(c.milled_root, 3), three(c.mean_off, 3), three(c.bevel, 2)]
        for s in summaries
        for name, c in s.cases.items()
        if name == "errors"
    ]
    return markdown(head, rows)


def uncertainty(summaries: list[LoopSummary]) -> list[str]:
    head = ["condition", "mechanics"]
    for name, unit in (("root", "mm"), ("bevel", "deg")):
        head += covered_head(name, unit)
    rows = [
        [s.condition, name, *covered(c.root_cover, 4), *covered(c.bevel_cover, 3)]
        for s in summaries
        for name, c in s.cases.items()
    ]
    return markdown(head, rows)


def causes(summaries: list[LoopSummary]) -> list[str]:
    """Every part that was refused or crashed, or of which the mill warned, with the cause."""
    return told(
        (s.condition, word, cause, r)
        for s in summaries
        for word, cause, r in (
            *(("refused", r.refused, r) for r in s.refused),
            *(("**crashed**", r.crashed, r) for r in s.crashed),
            *(("the mill warns", "; ".join(r.warnings["perfect"]), r) for r in s.warned),
        )
    )
