"""A study: parts drawn by seed under named conditions, what is measured of each, what its tables say."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import beta

from bench.harness import ROOT
from bench.tables import markdown, not_met
from workbench.errors import WorkbenchError
from workbench.units import Float

Row = dict[str, Any]  # of a part: `condition`, `seed` and what was measured; or `refused`, or `crashed`, in one line
Task = tuple[str, int]  # condition, seed
COVERAGE = (0.93, 0.97)  # of |error| <= 2u
CAUSES = "| condition | outcome | parts | first seed | its cause |\n| --- | --- | --- | --- | --- |"
RESAMPLES, LEAST_PARTS = 2000, 10  # with fewer parts, resampling them says nothing about the interval


@dataclass(frozen=True, slots=True)
class Share:
    """A share of trials, with its 95 % interval (Clopper and Pearson)."""

    count: int
    of: int

    @property
    def value(self) -> float:
        return self.count / self.of if self.of else float("nan")

    @property
    def percent(self) -> str:
        return f"{100 * self.value:.1f}"

    @property
    def interval(self) -> tuple[float, float]:
        k, n = self.count, self.of
        low = float(beta.ppf(0.025, k, n - k + 1)) if k else 0.0
        high = float(beta.ppf(0.975, k + 1, n - k)) if k < n else 1.0
        return low, high

    def outside(self, low: float, high: float) -> bool:
        """Whether even the interval that the number of trials leaves open lies outside."""
        return bool(self.of and (self.interval[1] < low or self.interval[0] > high))

    def beside(self, goal: tuple[float, float] | None) -> str:
        """Percent and interval, bold outside the goal; the goal."""
        if not self.of:
            return ""
        low, high = self.interval
        bold = "**" * (goal is not None and not goal[0] <= self.value <= goal[1])
        words = "" if goal is None else f"; goal {100 * goal[0]:g} to {100 * goal[1]:g}"
        return f"{bold}{self.percent}{bold} ({100 * low:.1f} to {100 * high:.1f}{words})"


@dataclass(frozen=True, slots=True)
class Cover:
    """Errors beside their standard uncertainties, pooled over all places of all parts."""

    parts: int
    share: float  # with |error| <= 2u
    low: float  # 95 % interval of it, by resampling parts
    high: float
    bias: float  # mean error
    rms: float
    mean_u: float

    @property
    def surely_not_covered(self) -> bool:
        """Even the interval that the number of parts leaves open lies outside the goal."""
        return self.parts >= LEAST_PARTS and (self.high < COVERAGE[0] or self.low > COVERAGE[1])


def cover(pairs: Iterable[tuple[Any, Any]]) -> Cover:
    """Of (errors, uncertainties) of each part; None and NaN: not measured.

    Parts are resampled whole for the interval, since the places of one share their errors.
    """
    known = []
    for pair in pairs:
        e, u = np.broadcast_arrays(*(np.array(one, dtype=float) for one in pair))
        good = np.isfinite(e) & np.isfinite(u)
        known += [(e[good], u[good])] if good.any() else []
    if not known:
        return Cover(0, *[float("nan")] * 6)
    hits, counts = np.array([[(np.abs(e) <= 2 * u).sum(), len(e)] for e, u in known]).T
    chosen = np.random.default_rng(0).integers(0, len(known), (RESAMPLES, len(known)))
    low, high = np.percentile(hits[chosen].sum(axis=1) / counts[chosen].sum(axis=1), (2.5, 97.5))
    error, u = (np.concatenate(values) for values in zip(*known, strict=True))
    rms = float(np.sqrt(np.mean(error**2)))
    return Cover(
        len(known),
        float(hits.sum() / counts.sum()),
        float(low),
        float(high),
        float(error.mean()),
        rms,
        float(u.mean()),
    )


class Condition:
    """The rows of one condition, and figures over them. NaN: no part has it."""

    def __init__(self, name: str, rows: Iterable[Row]) -> None:
        self.name, self.rows = name, sorted(rows, key=lambda row: row["seed"])

    @cached_property
    def good(self) -> list[Row]:
        """Those of which all was measured."""
        return [row for row in self.rows if not any(row.get(name) for name in ("refused", "crashed", "beyond"))]

    def having(self, name: str) -> list[Row]:
        """Those of which a field says something."""
        return [row for row in self.rows if row.get(name)]

    def values(self, name: str) -> Float:
        """Of the good rows that have it; lists one after the other."""
        found = [np.atleast_1d(np.array(row[name], float)) for row in self.good if row.get(name) is not None]
        return np.concatenate([np.empty(0), *found])

    def rms(self, name: str) -> float:
        return float(np.sqrt(np.mean(v**2))) if len(v := self.values(name)) else float("nan")

    def at(self, name: str, *percentiles: float) -> Float:
        """Percentiles."""
        known = self.values(name)
        return np.asarray(np.percentile(known, percentiles) if len(known) else np.full(len(percentiles), np.nan))

    def worst(self, name: str) -> float:
        return float(self.at(name, 100)[0])

    def share(self, name: str, most: float | None = None) -> Share:
        """How many of the rows that say so say yes, or a number below `most`."""
        known = self.values(name)
        return Share(int((known < most if most is not None else known > 0).sum()), len(known))

    def total(self, name: str) -> int:
        return int(self.values(name).sum())


Column = tuple[str, Callable[[Condition], object]]  # head, cell
Table = tuple[str, Sequence[Column], Callable[[Condition], bool] | None]  # heading, columns, conditions of which (all)
NAME: Column = ("condition", lambda c: c.name)
PARTS: Column = ("parts", lambda c: len(c.rows))
REFUSED: Column = ("refused", lambda c: len(c.having("refused")))
HEAD = (NAME, PARTS, REFUSED)


@dataclass(frozen=True)
class Study:
    """What is measured of a part, and what is said of a condition."""

    conditions: tuple[str, ...]
    parts: int  # a condition, unless the command says otherwise
    page: str  # in docs/
    measure: Callable[[str, int], Row]  # condition, seed -> what was measured, as JSON has it
    tables: Sequence[Table]
    goals: Callable[[Condition], Iterable[tuple[bool, str]]]  # whether one is missed, and its words
    outcomes: tuple[str, ...] = ("refused", "crashed")  # fields that tell why a part has no values, or what else befell

    @property
    def place(self) -> Path:
        return ROOT / "docs" / self.page

    def measured(self, task: Task) -> Row:
        """A row of one part."""
        row = {"condition": task[0], "seed": task[1]}
        try:
            return row | self.measure(*task)
        except WorkbenchError as error:
            return row | {"refused": str(error)}
        except Exception as error:  # a defect, to be counted and not to stop the study
            return row | {"crashed": repr(error)}

    def short(self, every: Iterable[Condition]) -> list[str]:
        """What does not reach its goal, each "condition: goal"."""
        found = []
        for c in every:
            crashed = len(c.having("crashed"))
            goals = chain([(crashed > 0, f"{crashed} crashed")], self.goals(c))
            found += [f"{c.name}: {words}" for missed, words in goals if missed]
        return found

    def text(self, every: Sequence[Condition], told: str) -> str:
        """All tables, the first cause of each outcome, and what fell short."""
        lines = [told, ""]
        for heading, columns, of in self.tables:
            rows = [[str(cell(c)) for _, cell in columns] for c in every if of is None or of(c)]
            lines += [f"### {heading}", "", *markdown([head for head, _ in columns], rows), ""] if rows else []
        causes = [
            f"| {c.name} | {name} | {len(found)} | {found[0]['seed']} | {found[0][name]} |"
            for c in every
            for name in self.outcomes
            if (found := c.having(name))
        ]
        if causes:
            lines += [f"### First causes in {self.tables[0][0]}", "", CAUSES, *causes, ""]
        return "\n".join([*lines, not_met(self.short(every))])


def marked(value: float, goal: float | None, digits: int = 3) -> str:
    """Bold beyond its goal, which is told; nothing of NaN."""
    if goal is None or np.isnan(value):
        return "" if np.isnan(value) else f"{value:.{digits}f}"
    bold = "**" * (not value <= goal)
    return f"{bold}{value:.{digits}f}{bold} (goal {goal:g})"


def spread(values: Iterable[float], digits: int) -> str:
    """One after the other."""
    return ", ".join(f"{v:.{digits}f}" for v in values)
