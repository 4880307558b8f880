"""`python -m bench.calibration STATEMENT`: prints the table behind a statement of docs/calibration.md."""

from __future__ import annotations

import argparse
from pathlib import Path

from bench.calibration.statements import STATEMENTS, write_figure

FIGURE = Path("docs/gallery/calibration_fig5.svg")


def main(arguments: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(prog="python -m bench.calibration", description=__doc__)
    parser.add_argument("statement", choices=[*STATEMENTS, "figure"])
    parser.add_argument("--trials", type=int, default=100, help="simulated sets (100), seeds from 0")
    parser.add_argument("--out", type=Path, default=FIGURE, help="of the figure")
    options = parser.parse_args(arguments)
    if options.statement == "figure":
        write_figure(options.out)
        print(options.out)
    else:
        print(*STATEMENTS[options.statement](options.trials), sep="\n")


if __name__ == "__main__":
    main()
