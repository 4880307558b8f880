"""`python -m bench.speed`: measures, prints the table and writes docs/benchmarks.md."""

from __future__ import annotations

import argparse
import json
import os
import platform
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from functools import partial
from pathlib import Path

from bench.harness import ROOT, THREADS, made_by
from bench.speed import computing, waiting
from bench.speed.timing import REPEATS, Row
from bench.tables import markdown, put_into
from workbench.geometry.blocks import cores
from workbench.pipeline.run import versions

PAGE = ROOT / "docs" / "benchmarks.md"
HEAD = ("measurement; compared with", "result", "goal")
GROUPS = {  # by name, how the rows are made; of those on one core in a process of their own
    "start": waiting.starting,
    "install": waiting.installing,
    "follow": waiting.following,
    "import": waiting.importing,
    "inspection": computing.inspecting,
    "batch": computing.batches,
}
ON_ONE_CORE = {"planning": computing.planning, "calibration": computing.calibrating, "posture": computing.posturing}


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m bench.speed", description=__doc__)
    parser.add_argument("--parts", type=int, default=1000, help="of the batches")
    parser.add_argument("--rows", nargs="+", choices=[*GROUPS, *ON_ONE_CORE], help="only these; no page is written")
    parser.add_argument("--folder", type=Path, help="keep the recordings here for the next time (1 GB)")
    parser.add_argument("--json", action="store_true", help=argparse.SUPPRESS)
    given = parser.parse_args()
    made, found = made_by(), list[Row]()
    with tempfile.TemporaryDirectory() as scratch:
        for name in given.rows or [*GROUPS, *ON_ONE_CORE]:
            for row in measured(name, given.folder or Path(scratch), given.parts, given.json):
                found.append(row)
                print(json.dumps(asdict(row)) if given.json else f"| {' | '.join(row.cells)} |", flush=True)
    if not given.rows:
        put_into(PAGE, page(found, made))


def measured(name: str, folder: Path, parts: int, here: bool) -> Iterator[Row]:
    """Rows of a group, here or in a process that keeps to one core."""
    if name in GROUPS:
        yield from (partial(computing.batches, count=parts) if name == "batch" else GROUPS[name])(folder)
    elif here:
        if hasattr(os, "sched_setaffinity"):
            os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})
        yield from ON_ONE_CORE[name](folder)
    else:
        command = [sys.executable, "-m", "bench.speed", "--json", "--rows", name]
        alone = {**os.environ, **dict.fromkeys(THREADS, "1")}
        done = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True, env=alone, cwd=ROOT)
        yield from (Row(**json.loads(line)) for line in done.stdout.splitlines())


def page(found: Sequence[Row], made: str) -> str:
    """What was run, on what machine, and the table: goals that are missed in bold."""
    with_goal = [row for row in found if row.goal is not None]
    known = versions()
    packages = ", ".join(f"{name} {known[name]}" for name in ("numpy", "numba", "h5py", "open3d"))
    told = f"`python -m bench.speed`{made}; medians of {REPEATS} unless a row says otherwise. {machine()}; {packages}."
    met = f"{sum(row.met for row in with_goal)} of {len(with_goal)} goals are met; a result in bold misses its goal."
    return "\n".join([told, "", met, "", *markdown(HEAD, (row.cells for row in found))])


def machine() -> str:
    """Processor, cores, memory and load, in words."""
    info = Path("/proc/cpuinfo")
    text = info.read_text() if info.exists() else ""
    names = [line.partition(":")[2].strip() for line in text.splitlines() if line.startswith("model name")]
    words = [f"{cores()} cores of {(names or [platform.machine()])[0]}"]
    if hasattr(os, "sysconf"):
        words.append(f"{os.sysconf('SC_PAGE_SIZE') * os.sysconf('SC_PHYS_PAGES') / 1e9:.0f} GB of memory")
    if hasattr(os, "getloadavg"):
        words.append(f"load average {os.getloadavg()[2]:.1f} over the last quarter of an hour")
    return ", ".join([*words, f"{platform.system()}, Python {platform.python_version()}"])


if __name__ == "__main__":
    main()
