"""`python -m bench.score --parts 3 --seed 0`: value and uncertainty judged together, by group and simulator."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from bench.harness import each, made_by
from bench.open.rivals import NAMES
from bench.score.measure import Result, one
from bench.score.parts import GROUPS, group, kept, simulators
from bench.score.table import lines_of, put, table

FIRST_SEED = 5_000_000  # seeds below 10,000 are for developing


def main(arguments: list[str] | None = None) -> int:
    given = parse(arguments)
    keep = given.keep or kept()
    tasks = [
        (name, simulator, given.seed + k, keep, given.engine)
        for k in range(given.parts)
        for name in given.conditions or given.groups
        for simulator, draws in simulators().items()
        if simulator in given.simulators and group(name).recordings in draws
    ]
    results: list[Result] = []
    for result in each(one, tasks, given.workers):
        results.append(result)
        print(*lines_of(result), sep="\n", file=sys.stderr, flush=True)
    order = [*GROUPS, *(given.conditions or ())]
    results.sort(key=lambda r: (order.index(r.group), r.simulator, r.seed))
    text = f"`python -m bench.score {command(given)}`{made_by() if given.docs else ''}\n\n{table(results)}"
    print(text)
    if given.docs:
        put(text, "score")
    return 0


def parse(arguments: list[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m bench.score", description=__doc__)
    parser.add_argument("--parts", type=int, default=25, help="a group and simulator (25); 3: a quick look")
    parser.add_argument("--seed", type=int, default=FIRST_SEED, help=f"of the first part ({FIRST_SEED})")
    parser.add_argument("--groups", nargs="+", choices=GROUPS, default=list(GROUPS))
    parser.add_argument(
        "--conditions", nargs="+", choices=simulators()["named"], metavar="NAME", help="instead of groups"
    )
    parser.add_argument("--simulators", nargs="+", choices=simulators(), default=list(simulators()))
    parser.add_argument("--engine", choices=NAMES, default="product")
    parser.add_argument("--workers", type=int, default=2, help="processes (2)")
    parser.add_argument("--keep", type=Path, help="folder of the recordings; one that was named keeps them for ever")
    parser.add_argument("--docs", action="store_true", help="write the table into docs/score.md")
    return parser.parse_args(arguments)


def command(given: argparse.Namespace) -> str:
    """What was run, as it can be typed again."""
    words = [f"--parts {given.parts} --seed {given.seed}"]
    words += [f"--conditions {' '.join(given.conditions)}"] if given.conditions else []
    words += [] if given.groups == list(GROUPS) else [f"--groups {' '.join(given.groups)}"]
    words += [] if given.simulators == list(simulators()) else [f"--simulators {' '.join(given.simulators)}"]
    return " ".join([*words, *([] if given.engine == "product" else [f"--engine {given.engine}"])])


if __name__ == "__main__":
    sys.exit(main())
