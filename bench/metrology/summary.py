"""What every study says of a condition: figures worked out where a table asks for them, goals, refusals, the worst."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import chain
from typing import Any, ClassVar

import numpy as np
from scipy.stats import beta

from bench.metrology.quantity import percentile
from bench.tables import markdown, not_met


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

    def cells(self, goal: tuple[float, float] | None, bold: bool = True) -> list[str]:
        """Percent, interval and goal."""
        if not self.of:
            return ["", "", ""]
        low, high = self.interval
        off = bold and goal is not None and not goal[0] <= self.value <= goal[1]
        words = "" if goal is None else f"{100 * goal[0]:g} to {100 * goal[1]:g}"
        return [f"**{self.percent}**" if off else self.percent, f"{100 * low:.1f} to {100 * high:.1f}", words]


class Summary:
    """Results of one condition; a study adds its figures, its goals (`checks`) and its tables."""

    conditions: ClassVar[tuple[str, ...]]
    outcomes: ClassVar[dict[str, str]] = {"refused": "refused", "crashed": "**crashed**"}  # field -> word

    def __init__(self, condition: str, results: Iterable[Any]) -> None:
        self.condition, self.results = condition, sorted(results, key=lambda r: r.seed)

    def having(self, name: str) -> list[Any]:
        """Those of which a field says something."""
        return [r for r in self.results if getattr(r, name)]

    @cached_property
    def refused(self) -> list[Any]:
        return self.having("refused")

    @cached_property
    def crashed(self) -> list[Any]:
        return self.having("crashed")

    @cached_property
    def good(self) -> list[Any]:
        return [r for r in self.results if not (r.refused or r.crashed)]

    def checks(self) -> Iterable[tuple[bool, str]]:
        """Whether a goal is missed, and its words."""
        raise NotImplementedError

    @property
    def shortcomings(self) -> list[str]:
        """In words, what does not reach its goal."""
        crashed = (bool(self.crashed), f"{len(self.crashed)} crashed")
        return [f"{self.condition}: {words}" for wrong, words in chain([crashed], self.checks()) if wrong]

    def rms(self, name: str) -> float:
        """Of a field, over the good results that have it."""
        return rms(getattr(r, name) for r in self.good)

    def count(self, name: str) -> Share:
        """How many of the good results that say so say yes."""
        said = [getattr(r, name) for r in self.good if getattr(r, name) is not None]
        return Share(sum(map(bool, said)), len(said))

    def median_s(self, *left_out: str) -> float:
        """Seconds a part, but for what is left out."""
        return percentile([sum(v for k, v in r.seconds.items() if k not in left_out) for r in self.good], 50)

    def median_ms(self, name: str) -> float:
        return percentile([1e3 * r.seconds[name] for r in self.good if name in r.seconds], 50)

    @classmethod
    def tables(cls, every: Sequence[Any]) -> Iterable[tuple[str, Iterable[str]]]:
        """Headings, and the lines of a table below each."""
        raise NotImplementedError

    @classmethod
    def causes(cls, every: Sequence[Any]) -> list[str]:
        """How many parts of a condition have an outcome of their own, with the first one's cause."""
        return [
            f"- {s.condition}: {len(found)} {word}, the first (seed {found[0].seed}): {getattr(found[0], name)}"
            for s in every
            for name, word in cls.outcomes.items()
            if (found := s.having(name))
        ]

    @classmethod
    def worst(cls, results: list[Any], count: int) -> Iterator[str]:
        """Parts to look at, as lines."""
        raise NotImplementedError

    @classmethod
    def text(cls, every: Sequence[Any], command: str) -> str:
        """All tables, and what fell short."""
        lines = [f"`{command}`", ""]
        for heading, table in cls.tables(every):
            rows = list(table)
            lines += [f"### {heading}", "", *rows, ""] if rows else []
        causes = cls.causes(every)
        return "\n".join([*lines, *causes, *[""] * bool(causes), not_met(w for s in every for w in s.shortcomings)])


def rms(values: Iterable[float | None]) -> float:
    known = np.array([v for v in values if v is not None], float)
    return float(np.sqrt(np.mean(known**2))) if len(known) else float("nan")


def largest(results: Iterable[Any], of: Callable[[Any], float | None], count: int) -> list[Any]:
    """The results of which a figure is largest."""
    known = [r for r in results if of(r) is not None]
    return sorted(known, key=lambda r: -(of(r) or 0.0))[:count]


Column = tuple[str | list[str], Callable[[Any], str | int | list[str]]]  # head or heads; of a summary its cell or cells


def columns(every: Iterable[Any], *given: Column) -> list[str]:
    """A table with a row a summary; nothing of none."""

    def flat(cells: Iterable[Any]) -> list[str]:
        return [str(text) for cell in cells for text in (cell if isinstance(cell, list) else [cell])]

    rows = [flat(cell(s) for _, cell in given) for s in every]
    return markdown(flat(head for head, _ in given), rows) if rows else []


def marked(value: float, goal: float | None) -> str:
    """Bold beyond its goal."""
    return f"{value:.3f}" if goal is None or value <= goal else f"**{value:.3f}**"


def spelt(goal: float | None, none: str = "") -> str:
    return none if goal is None else f"{goal:g}"


CONDITION: Column = ("condition", lambda s: s.condition)
