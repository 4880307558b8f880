"""Do the tests tell errors in the code: `python -m bench.mutation --count 64 --seed 1`.

Mutants are drawn at random: a file of a room, by its length, and one of the changes that are possible in it. Each is
put into a copy of the sources, on which the tests of its room are run, those of its own file first. A mutant that
survives is an error that no test tells, unless it changes nothing that counts.
"""

from __future__ import annotations

import os
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from bench.harness import Option, Study
from bench.mutation.changes import changes
from bench.mutation.mutant import ROOT, fails

TESTS = {
    "workbench/edge": ["tests/edge", "tests/laws", "tests/inspect"],
    "workbench/geometry": ["tests/geometry", "tests/laws", "tests/edge"],
    "workbench/checks": ["tests/checks", "tests/laws", "tests/acceptance/test_refusals.py"],
    "workbench/inspect": ["tests/inspect", "tests/laws"],
    "workbench/path": ["tests/path"],
    "workbench/program": ["tests/program", "tests/robot/test_judge.py"],
    "workbench/robot": ["tests/robot", "tests/program"],
    "workbench/plugins/calibration": ["tests/plugins/calibration"],
    "workbench/plugins/stiffness": ["tests/plugins/stiffness"],
    "workbench/pipeline": ["tests/pipeline", "tests/test_storage.py", "tests/test_cli.py"],
    "workbench/report": ["tests/report"],
    "workbench/compare": ["tests/compare"],
    "workbench/export": ["tests/export"],
    "workbench/batch": ["tests/batch"],
}
DEFAULTS = "tests/laws/test_defaults.py"  # of the stages of every room


class Mutant(NamedTuple):
    """One change of one source."""

    path: Path
    number: int  # of the line
    was: str
    line: str  # that it has become
    source: str

    @property
    def tests(self) -> list[str]:
        """The tests of its room, those of its file first."""
        every = [*TESTS[next(one for one in TESTS if self.path.is_relative_to(one))], DEFAULTS]
        own = Path(every[0], f"test_{self.path.stem}.py")
        return [str(own)] * (ROOT / own).is_file() + every


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
    mutant = drawn(room, np.random.default_rng([seed, trial, list(TESTS).index(room)]))
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
    for room in TESTS:
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
        "rooms": Option(tuple(TESTS), choices=TESTS),
    },
    lambda given: [(given.seed, given.rooms[k % len(given.rooms)], k // len(given.rooms)) for k in range(given.count)],
    tried,
    table,
    workers=1,
)
if __name__ == "__main__":
    STUDY()
