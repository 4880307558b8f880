"""`python -m bench.coverage`: parts of both simulators, measured as a user would, beside their truth."""

from __future__ import annotations

import argparse
import multiprocessing
import sys
from collections.abc import Iterator
from pathlib import Path

from bench.coverage.measure import Result, Task, measure, measure_task
from bench.coverage.parts import ANALYTIC, SWEPT
from bench.coverage.table import tables, worst
from bench.metrology.table import put_into

FIRST_SEED = 3_000_000  # seeds below 10,000 are for developing
PAGE = Path(__file__).resolve().parents[2] / "docs" / "coverage.md"


def main(arguments: list[str] | None = None) -> int:
    options = parse(arguments)
    tasks = [
        (condition, options.seed + k, options.cache) for condition in options.conditions for k in range(options.parts)
    ]
    results: list[Result] = []
    for result in results_of(tasks, options.jobs):
        results.append(result)
        if len(results) % 20 == 0:
            print(f"{len(results)} of {len(tasks)}", file=sys.stderr, flush=True)
    text = f"`python -m bench.coverage {command(options)}`\n\n{tables(results)}"
    print(text)
    for line in worst(results, options.worst):
        print("-", line)
    for result in results:
        if options.worst and (result.refused or result.crashed):
            print("-", result.condition, result.seed, result.refused or result.crashed, f"({result.title})")
    if options.docs:
        put_into(PAGE, text)
    return 0


def parse(arguments: list[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m bench.coverage", description=__doc__)
    parser.add_argument("--parts", type=int, default=200, help="parts a condition (200)")
    which = parser.add_mutually_exclusive_group()
    which.add_argument("--simulator", choices=("analytic", "swept", "both"), default="both")
    which.add_argument(
        "--conditions",
        nargs="+",
        choices=(*ANALYTIC, *SWEPT),
        metavar="NAME",
        help=f"of {', '.join((*ANALYTIC, *SWEPT))} (all of the simulator's)",
    )
    parser.add_argument("--seed", type=int, default=FIRST_SEED, help=f"of each condition's first part ({FIRST_SEED})")
    parser.add_argument("--jobs", type=int, default=1, help="processes (1)")
    parser.add_argument("--cache", type=Path, help="folder for recordings, to measure the same ones again")
    parser.add_argument(
        "--worst", type=int, default=0, help="name so many of the parts furthest off, and all refused (0)"
    )
    parser.add_argument("--docs", action="store_true", help="write the tables into docs/coverage.md")
    options = parser.parse_args(arguments)
    if options.conditions is None:
        options.conditions = [
            *(ANALYTIC if options.simulator != "swept" else ()),
            *(SWEPT if options.simulator != "analytic" else ()),
        ]
    return options


def command(options: argparse.Namespace) -> str:
    """What was run, as it can be typed again."""
    chosen = tuple(options.conditions)
    for name, known in (("analytic", ANALYTIC), ("swept", SWEPT), ("both", (*ANALYTIC, *SWEPT))):
        if chosen == known:
            return f"--parts {options.parts} --simulator {name} --seed {options.seed}"
    return f"--parts {options.parts} --seed {options.seed} --conditions {' '.join(chosen)}"


def results_of(tasks: list[Task], jobs: int) -> Iterator[Result]:
    if jobs <= 1:
        yield from (measure(*task) for task in tasks)
        return
    with multiprocessing.get_context("spawn").Pool(jobs) as pool:
        yield from pool.imap(measure_task, tasks)


if __name__ == "__main__":
    sys.exit(main())
