"""`python -m bench.speed`: measures, prints the table and writes docs/benchmarks.md."""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

from bench.speed import postures_rows, rows
from bench.speed.recordings import simulated
from bench.speed.table import document, line
from bench.speed.timing import Row

PAGE = Path("docs/benchmarks.md")


def measure(sizes: list[int], folder: Path, also_largest: bool) -> Iterator[Row]:
    paths = {}
    for size in sizes:
        print(f"simulating {size} M points", file=sys.stderr, flush=True)
        paths[size] = simulated(size, folder)
    yield from rows.first_run(paths[sizes[0]], folder / "kernels")
    yield from rows.starting()
    for size in sizes:
        yield from rows.fusing(size)
    yield from rows.memory(sizes[-1], paths[sizes[-1]])
    times: rows.Times = {}
    for size, path in paths.items():
        yield from rows.reading(size, path, times)
    yield from rows.linearity(times)
    yield from rows.routes(paths, times, also_largest)
    yield from rows.planning()
    yield from rows.calibrating()
    yield from postures_rows.postures()


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m bench.speed", description=__doc__)
    parser.add_argument("--sizes", type=int, nargs="+", default=[1, 10, 50], help="million points, smallest first")
    parser.add_argument("--all", action="store_true", help="run Open3D at the largest size too (many minutes, 12 GB)")
    parser.add_argument("--out", type=Path, default=PAGE, help="the page to write")
    arguments = parser.parse_args()
    found = []
    with tempfile.TemporaryDirectory() as folder:
        for row in measure(sorted(arguments.sizes), Path(folder), arguments.all):
            found.append(row)
            print(line(row), flush=True)
    arguments.out.write_text(document(found, sys.argv[1:]), encoding="utf-8")


if __name__ == "__main__":
    main()
