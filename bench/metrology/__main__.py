"""`python -m bench.metrology`: simulate, inspect, compare with the truth, write the tables."""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

from bench.metrology.part_result import PartResult
from bench.metrology.run import ROOT, Task, measure_all
from bench.metrology.summary import summarise, worst_parts
from bench.metrology.table import put_into, tables
from workbench.synthetic import CONDITIONS

FIRST_SEED = 1_000_000  # seeds below 10,000 are for developing
PAGE = ROOT / "docs" / "metrology.md"


def main(arguments: list[str] | None = None) -> int:
    options = parse(arguments)
    results: dict[str, list[PartResult]] = {name: [] for name in options.conditions}
    todo, start = tasks(options), time.monotonic()
    for done, result in enumerate(measure_all(todo, options.out, options.workers), 1):
        results[result.condition].append(result)
        if done % 20 == 0 or done == len(todo):
            print(f"{done} of {len(todo)} parts, {time.monotonic() - start:.0f} s", file=sys.stderr, flush=True)
    summaries = [summarise(name, found) for name, found in results.items()]
    text = tables(summaries, command(options))
    print(text)
    print_worst(results, options.worst)
    if options.docs:
        put_into(PAGE, text)
    return int(any(s.shortcomings for s in summaries))


def parse(arguments: list[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m bench.metrology", description=__doc__)
    parser.add_argument("--parts", type=int, default=200, help="parts a condition (200)")
    parser.add_argument("--others", type=int, default=40, help="parts a condition with bound and other methods (40)")
    parser.add_argument("--seed", type=int, default=FIRST_SEED, help="seed of each condition's first part (1000000)")
    parser.add_argument("--conditions", nargs="+", choices=CONDITIONS, default=list(CONDITIONS), metavar="NAME")
    parser.add_argument("--workers", type=int, default=2, help="processes (2)")
    parser.add_argument("--out", type=Path, default=ROOT / "out" / "metrology", help="results, to resume")
    parser.add_argument("--worst", type=int, default=0, help="print so many of the worst parts of each condition (0)")
    parser.add_argument("--docs", action="store_true", help="write the tables into docs/metrology.md")
    return parser.parse_args(arguments)


def tasks(options: argparse.Namespace) -> list[Task]:
    """Every part to measure, all conditions in turn. The other methods are slow: they get the first few of each."""
    return [
        (name, options.seed + k, ("per_profile", "open3d") if k < options.others else ())
        for k in range(options.parts)
        for name in options.conditions
    ]


def command(options: argparse.Namespace) -> str:
    """What was run, as it can be typed again."""
    words = f"python -m bench.metrology --parts {options.parts} --others {options.others} --seed {options.seed}"
    chosen = "" if options.conditions == list(CONDITIONS) else f" --conditions {' '.join(options.conditions)}"
    return words + chosen


def print_worst(results: dict[str, list[PartResult]], count: int) -> None:
    for name, found in results.items():
        for what, value, part in worst_parts(found, count):
            quantity, unit = ("root", "mm") if what.startswith("root") else ("bevel", "deg")
            print(f"\n{name}, seed {part.seed}: {what} {value:.3f}")
            for column in ("", "_true", "_u", "_bound"):
                numbers = getattr(part, f"{quantity}{column}_{unit}")
                print(f"  {column[1:] or 'value':6}", *(f"{v:8.4f}" if v is not None else "    null" for v in numbers))


if __name__ == "__main__":
    sys.exit(main())
