"""Do the tests tell errors in the code: `python -m bench.mutation --count 64 --seed 1`.

Mutants are drawn at random: a file of a room, by its length, and one of the changes that are possible in it. Each is
put into a copy of the sources, on which the tests of its room are run, then those that name the room or a stage of it,
the laws and the contracts. A mutant that survives is an error that no test tells, unless it changes nothing that
counts.
"""

from __future__ import annotations

import os
import re
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from bench.harness import Option, Study
from bench.mutation.changes import changes
from bench.mutation.mutant import ROOT, fails

ROOMS = (
    "workbench/edge",
    "workbench/geometry",
    "workbench/checks",
    "workbench/inspect",
    "workbench/path",
    "workbench/program",
    "workbench/robot",
    "workbench/plugins/calibration",
    "workbench/plugins/stiffness",
    "workbench/pipeline",
    "workbench/report",
    "workbench/compare",
    "workbench/export",
    "workbench/batch",
)
LAST = ["tests/laws", "tests/contracts"]  # of what every room makes


class Mutant(NamedTuple):
    """One change of one source."""

    path: Path
    number: int  # of the line
    was: str
    line: str  # that it has become
    source: str

    @property
    def tests(self) -> list[str]:
        """The tests of its room, those that name it, and the laws."""
        room = next(one for one in ROOMS if self.path.is_relative_to(one))
        return [room.replace("workbench", "tests"), *naming(room), *LAST]


def naming(room: str) -> list[str]:
    """Files of tests that name the room's modules or a stage of it."""
    name = re.compile(rf'{room.replace("/", "[.]")}\b|"{Path(room).name}[.]\w')
    files = sorted((ROOT / "tests").rglob("test_*.py"))
    return [str(one.relative_to(ROOT)) for one in files if name.search(one.read_text("utf-8"))]


def drawn(room: str, rng: np.random.Generator) -> Mutant:
    """A mutant of a room, anywhere in its code."""
    files = sorted((ROOT / room).rglob("*.py"))
    sources = [one.read_text(encoding="utf-8") for one in files]
    sizes = np.array([len(one) for one in sources], float)
    while True:
        k = int(rng.choice(len(files), p=sizes / sizes.sum()))
        known = changes(sources[k])
        if not known:
            continue
        mutated = known[rng.integers(len(known))].made(sources[k])
        pairs = list(zip(sources[k].splitlines(), mutated.splitlines(), strict=False))
        number = next(n for n, (was, line) in enumerate(pairs, 1) if was != line)
        was, line = pairs[number - 1]
        return Mutant(files[k].relative_to(ROOT), number, was, line, mutated)


def tried(task: tuple[int, str, int]) -> dict[str, Any]:
    """A mutant, and whether a test tells it."""
    seed, room, trial = task
    mutant = drawn(room, np.random.default_rng([seed, trial, ROOMS.index(room)]))
    started = time.monotonic()
    os.nice(max(0, 10 - os.nice(0)))  # of a nicer process it stays
    return {
        "room": room,
        "where": f"{mutant.path}:{mutant.number}",
        "was": mutant.was.strip(),
        "line": mutant.line.strip(),
        "killed": fails(mutant.path, mutant.source, mutant.tests),
        "seconds": round(time.monotonic() - started, 1),
    }


def table(rows: list[dict[str, Any]], _: Any) -> Iterator[str]:
    """Killed by room, and each survivor."""
    yield "| room | mutants | killed |\n| --- | --- | --- |"
    for room in ROOMS:
        own = [row["killed"] for row in rows if row["room"] == room]
        if own:
            yield f"| {room} | {len(own)} | {sum(own)} |"
    yield f"| all | {len(rows)} | {sum(row['killed'] for row in rows)} |"
    for row in rows:
        if not row["killed"]:
            yield f"\n{row['where']}: `{row['was']}` became `{row['line']}`"


STUDY = Study(
    "mutation",
    str(__doc__),
    {
        "count": Option(64, "mutants, the same number of each room"),
        "seed": Option(1),
        "rooms": Option(ROOMS, choices=ROOMS),
    },
    lambda given: [(given.seed, given.rooms[k % len(given.rooms)], k // len(given.rooms)) for k in range(given.count)],
    tried,
    table,
    workers=1,
)
if __name__ == "__main__":
    STUDY()
