"""`python -m bench.score --parts 3 --seed 0`: value and uncertainty judged together, by group and simulator."""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Iterator, Sequence
from pathlib import Path

from bench.harness import Option, Study
from bench.open.rivals import NAMES
from bench.score.measure import Result, Task, one
from bench.score.parts import GROUPS, group, kept, simulators
from bench.score.table import lines_of, summary, table


def tasks(given: Namespace) -> Iterator[Task]:
    """Every group of every simulator that draws it, part by part."""
    keep = Path(given.keep or kept())
    for k in range(given.parts):
        for name in given.conditions or given.groups:
            for simulator, draws in simulators().items():
                if simulator in given.simulators and group(name).recordings in draws:
                    yield name, simulator, given.seed + k, keep, given.engine


def lines(results: Sequence[Result], given: Namespace) -> Iterator[str]:
    order = [*GROUPS, *given.conditions]
    yield table(sorted(results, key=lambda r: (order.index(r.group), r.simulator, r.seed)))


STUDY = Study(
    "score",
    str(__doc__),
    {
        "parts": Option(25, "a group and simulator; 3: a quick look"),
        "seed": Option(5_000_000, "of the first part; below 10,000 are for developing"),
        "conditions": Option((), "instead of groups", simulators()["named"]),
        "groups": Option(tuple(GROUPS), choices=GROUPS),
        "simulators": Option(tuple(simulators()), choices=simulators()),
        "engine": Option("product", choices=NAMES),
        "keep": Option("", "folder of the recordings; one that was named keeps them for ever", said=False),
    },
    tasks,
    one,
    lines,
    "score.md",
    "score",
    summary,
    lines_of,
)
if __name__ == "__main__":
    STUDY()
