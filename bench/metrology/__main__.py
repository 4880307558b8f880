"""`python -m bench.metrology`: what the score does not tell: plans, measured loops, calibrations, stiffness."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from bench.harness import ROOT, made_by
from bench.metrology.run import Task, measure_all
from bench.metrology.studies import STUDIES, Study
from bench.tables import folded, put_into

FIRST_SEED = 1_000_000  # seeds below 10,000 are for developing


def main(arguments: list[str] | None = None) -> int:
    options = parse(arguments)
    return max(run(name, options) for name in options.studies)


def run(name: str, options: argparse.Namespace) -> int:
    """One study: 1 if it does not reach a goal."""
    study = STUDIES[name]
    results: dict[str, list[object]] = {condition: [] for condition in conditions(study, options)}
    todo = tasks(name, options)
    for result in measure_all(todo, options.out / name, options.workers, study.measurement):
        results[result.condition].append(result)
    if not results:
        return 0
    summaries = [study.summary(condition, found) for condition, found in results.items()]
    told = command(name, options)
    text = study.summary.text(summaries, told)
    if options.docs:
        text = text.replace(f"`{told}`", f"`{told}`{made_by()}", 1)
    print(text)
    for found in results.values():
        print(*study.summary.worst(found, options.worst), sep="\n", end="\n" if options.worst else "")
    if options.docs:
        put_into(study.page, folded(study.page, text), study.marks)
    return int(any(s.shortcomings for s in summaries))


def parse(arguments: list[str] | None) -> argparse.Namespace:
    known = list(dict.fromkeys(c for study in STUDIES.values() for c in study.conditions))
    parser = argparse.ArgumentParser(prog="python -m bench.metrology", description=__doc__)
    parser.add_argument(
        "--studies",
        nargs="+",
        choices=STUDIES,
        default=list(STUDIES),
        metavar="STUDY",
        help="of planning, measured_loop, calibration, stiffness (all)",
    )
    parser.add_argument(
        "--parts",
        type=int,
        help="parts a condition (planning and measured_loop 100, calibration 500, stiffness 1000)",
    )
    parser.add_argument("--seed", type=int, default=FIRST_SEED, help="seed of each condition's first part (1000000)")
    parser.add_argument("--conditions", nargs="+", choices=known, default=known, metavar="NAME")
    parser.add_argument("--workers", type=int, default=2, help="processes (2)")
    parser.add_argument("--out", type=Path, default=ROOT / "out" / "metrology", help="results, to resume")
    parser.add_argument("--worst", type=int, default=0, help="print so many of the worst parts of each condition (0)")
    parser.add_argument("--docs", action="store_true", help="write the tables into the pages in docs/")
    return parser.parse_args(arguments)


def conditions(study: Study, options: argparse.Namespace) -> list[str]:
    return [name for name in study.conditions if name in options.conditions]


def tasks(name: str, options: argparse.Namespace) -> list[Task]:
    """Every part to measure, all conditions in turn."""
    return [
        (condition, options.seed + k)
        for k in range(options.parts or STUDIES[name].parts)
        for condition in conditions(STUDIES[name], options)
    ]


def command(name: str, options: argparse.Namespace) -> str:
    """What was run, as it can be typed again."""
    study = STUDIES[name]
    words = f"python -m bench.metrology --studies {name} --parts {options.parts or study.parts}"
    chosen = conditions(study, options)
    only = "" if chosen == list(study.conditions) else f" --conditions {' '.join(chosen)}"
    return f"{words} --seed {options.seed}{only}"


if __name__ == "__main__":
    sys.exit(main())
