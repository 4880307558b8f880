"""`python -m bench.metrology`: what the score does not tell: measured loops, calibrations, stiffness, joints."""

from __future__ import annotations

import argparse
import sys
from functools import partial

from bench.harness import kept, made_by
from bench.metrology import calibration, joints, measured_loop, stiffness
from bench.metrology.study import Condition, Row, Study, Task
from bench.tables import folded, put_into

FIRST_SEED = 1_000_000  # seeds below 10,000 are for developing
STUDIES: dict[str, Study] = {
    "measured_loop": measured_loop.STUDY,
    "calibration": calibration.STUDY,
    "stiffness": stiffness.STUDY,
    "joints": joints.STUDY,
}


def main(arguments: list[str] | None = None) -> int:
    options = parse(arguments)
    return max(run(name, options) for name in options.studies)


def run(name: str, options: argparse.Namespace) -> int:
    """One study: 1 if it does not reach a goal."""
    study, made = STUDIES[name], made_by()
    if not (todo := tasks(name, options)):
        return 0
    rows = kept(f"metrology-{name}", partial(measured, name), todo, options.workers)
    every = [Condition(one, (row for row in rows if row["condition"] == one)) for one in conditions(study, options)]
    text = study.text(every, f"`{command(name, options)}`{made if options.docs else ''}")
    print(text)
    if options.docs:
        put_into(study.place, folded(study.place, text), name)
    return int(bool(study.short(every)))


def measured(name: str, task: Task) -> Row:
    """A part of a study; by its name, which a process of its own can be told."""
    return STUDIES[name].measured(task)


def parse(arguments: list[str] | None) -> argparse.Namespace:
    known = list(dict.fromkeys(c for study in STUDIES.values() for c in study.conditions))
    parts = ", ".join(f"{name} {study.parts}" for name, study in STUDIES.items())
    parser = argparse.ArgumentParser(prog="python -m bench.metrology", description=__doc__)
    parser.add_argument("--studies", nargs="+", choices=STUDIES, default=list(STUDIES), metavar="STUDY")
    parser.add_argument("--parts", type=int, help=f"a condition ({parts})")
    parser.add_argument("--seed", type=int, default=FIRST_SEED, help="seed of each condition's first part (1000000)")
    parser.add_argument("--conditions", nargs="+", choices=known, default=known, metavar="NAME")
    parser.add_argument("--workers", type=int, default=2, help="processes (2)")
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
