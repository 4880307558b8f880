"""`make fuzz`: mutated files for every reader, each in a process of its own; the table in docs/reliability.md."""

from __future__ import annotations

import sys
from argparse import Namespace
from collections.abc import Iterator, Sequence
from functools import partial
from typing import Any

from bench.fuzz.run import outcome_of
from bench.fuzz.targets import TARGETS
from bench.harness import ROOT, Option, Study, forked
from bench.tables import folded, markdown

SHARES = {target.name: target.share for target in TARGETS}
Row = dict[str, Any]


def tasks(given: Namespace) -> Iterator[tuple[str, int, int, str]]:
    """Reader, executions, seed, and the folder for files that made trouble."""
    for name in given.only:
        yield name, max(1, round(given.executions * SHARES[name])), given.seed, given.keep


def fuzzed(task: tuple[str, int, int, str]) -> Row:
    """A reader that crashes is told, and ends no other."""
    try:
        return forked(partial(outcome_of, *task))
    except ChildProcessError as died:
        nothing = {"executions": 0, "accepted": 0, "refused": 0, "seconds": 0.0, "slowest_s": 0.0}
        return {"target": task[0], **nothing, "failures": {str(died): 1}}


def lines_of(row: Row) -> Iterator[str]:
    """What became of a reader, and of which kinds its failures are."""
    judged = f"{row['accepted']:8,} accepted, {row['refused']:9,} refused"
    done = f"{row['target']:12} {row['executions']:9,} executions, {judged}, slowest {row['slowest_s']:.2f} s"
    yield f"{done}, {sum(row['failures'].values())} failures, {row['seconds']:.0f} s"
    yield from (f"  {count} x {what}" for what, count in row["failures"].items())


def report(rows: Sequence[Row], _: Namespace) -> Iterator[str]:
    """All readers together, then each."""
    failed = sum(sum(row["failures"].values()) for row in rows)
    slowest = max(row["slowest_s"] for row in rows)
    yield f"{sum(row['executions'] for row in rows):,} executions; slowest {slowest:.2f} s. Failures: {failed}."
    yield from ("", "### Fuzz", "")
    head = ["reader", "executions", "accepted, the rest refused with one line", "slowest, s"]
    cells = [[r["target"], f"{r['executions']:,}", f"{r['accepted']:,}", f"{r['slowest_s']:.2f}"] for r in rows]
    yield from markdown(head, cells)


STUDY = Study(
    "fuzz",
    str(__doc__),
    {
        "executions": Option(100_000, "of each reader, times its share"),
        "seed": Option(1),
        "only": Option(tuple(SHARES), "readers", SHARES),
        "keep": Option(str(ROOT / "out" / "fuzz"), "folder for files that made trouble", said=False),
    },
    tasks,
    fuzzed,
    report,
    "reliability.md",
    "fuzz",
    folded,
    lines_of,
    lambda row: row["failures"],
    workers=1,
)
if __name__ == "__main__":
    sys.exit(STUDY())
