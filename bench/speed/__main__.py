"""`python -m bench.speed`: measures, prints the table and writes docs/benchmarks.md."""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

from bench.speed import batch_rows, follow_rows, import_rows, postures_rows, rows, start_rows
from bench.speed.recordings import simulated
from bench.speed.table import cells, document, line
from bench.speed.timing import Row

PAGE = Path("docs/benchmarks.md")


def inspecting(sizes: list[int], folder: Path, also_largest: bool, open3d: bool = True) -> Iterator[Row]:
    """Recordings of several sizes from file to inspection."""
    paths = {}
    for size in sizes:
        print(f"simulating {size} M points", file=sys.stderr, flush=True)
        paths[size] = simulated(size, folder)
    times: rows.Times = {}
    for size, path in paths.items():
        yield from rows.reading(size, path, times)
    yield from rows.linearity(times)
    yield from rows.memory(sizes[-1], paths[sizes[-1]])
    if not open3d:
        return
    yield from rows.starting()
    for size in sizes:
        yield from rows.fusing(size)
    yield from rows.routes(paths, times, also_largest)


GROUPS = {
    "start": start_rows.starting,
    "follow": follow_rows.following,
    "install": start_rows.installing,
    "import": None,  # wants a folder
    "inspection": None,  # wants sizes and a folder
    "planning": rows.planning,
    "calibration": rows.calibrating,
    "posture": postures_rows.postures,
    "batch": None,  # wants a number of parts
}


def measure(
    groups: list[str], sizes: list[int], parts: int, folder: Path, also_largest: bool, open3d: bool
) -> Iterator[Row]:
    """Rows of the groups asked for."""
    for name in groups:
        group = GROUPS[name]
        if group is not None:
            yield from group()
        elif name == "batch":
            yield from batch_rows.batches(parts)
        elif name == "import":
            yield from import_rows.importing(folder)
        else:
            yield from inspecting(sizes, folder, also_largest, open3d)


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m bench.speed", description=__doc__)
    parser.add_argument("--sizes", type=int, nargs="+", default=[1, 10, 50], help="million points, smallest first")
    parser.add_argument("--parts", type=int, default=1000, help="of the batches")
    parser.add_argument("--all", action="store_true", help="run Open3D at the largest size too (many minutes, 12 GB)")
    parser.add_argument("--rows", nargs="+", choices=GROUPS, help="only these rows; the page is then not written")
    parser.add_argument("--without-open3d", action="store_true", help="leave its rows out")
    parser.add_argument("--folder", type=Path, help="keep the recordings here for the next time (1 GB)")
    parser.add_argument("--out", type=Path, help="the page to write (docs/benchmarks.md, if all rows are measured)")
    arguments = parser.parse_args()
    found: list[list[str]] = []
    with tempfile.TemporaryDirectory() as scratch:
        folder = arguments.folder or scratch
        groups, sizes = arguments.rows or list(GROUPS), sorted(arguments.sizes)
        for row in measure(groups, sizes, arguments.parts, Path(folder), arguments.all, not arguments.without_open3d):
            found.append(cells(row))
            print(line(found[-1]), flush=True)
    page = arguments.out or (None if arguments.rows else PAGE)
    if page is not None:
        page.write_text(document(found, sys.argv[1:], page), encoding="utf-8")


if __name__ == "__main__":
    main()
