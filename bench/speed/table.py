"""The page that a run writes: what was measured, on what machine, and how to measure it again."""

from __future__ import annotations

import os
import platform
from collections.abc import Iterable, Sequence
from pathlib import Path

from bench.speed.timing import REPEATS, Row
from bench.tables import written
from workbench.geometry.blocks import cores
from workbench.pipeline.run import versions

COLUMNS = ("what; beside what", "workbench", "the other", "factor", "goal", "met")
MISSED = "**no**"
TABLE = "all rows"  # in the name of the CSV beside the page
FIRST = (  # what a reader asks first, by how its row begins
    "first inspection after set-up",
    "first inspection from a wheel",
    "small part, new process",
    "an inspection report",
    "a part in a batch",
    "`--follow`, small part",
    "recording to inspection, 50 M points, gzip and shuffle",
    "peak memory, 50 M points",
    "5 m raw edge to RAPID",
    "hand-eye pose of 9 profiles after circle fits",
    "the optimum with exact collision checks, proven, cluttered cell",
    "1,000 small parts",
)

HEAD = """<!-- Written by `make bench`: measure again rather than edit. -->

# Benchmarks

One run of `{command}`, both sides of a line in turn; medians of {repeats} at least unless the line says otherwise.
Recordings are simulated (`bench/speed/recordings.py`): a milled edge, a frame every 0.1 mm, 1,000 columns; 50 million
points are 5 m of edge. Files are read from a warm cache.

Machine: {machine}. {packages}.

{met} of {goals} goals are met. [All rows]({place}).

## What is asked first

"""

FOOT = """
## How it is measured

Each row is made by a module of `bench/speed/`, which says how. Planning, calibration and postures: processor time on
one core. "Extrapolated": a straight line through the two largest sizes run (`python -m bench.speed --all` runs all).
"""


def cells(row: Row) -> list[str]:
    """One row as the table has it, by `COLUMNS`."""
    goal = "" if row.goal is None else f"{'at most' if row.at_most else 'at least'} {row.goal:g}"
    verdict = {None: "", True: "yes", False: MISSED}[row.met]
    return [row.what, row.ours, row.other, row.factor_is.format(row.factor), goal, verdict]


def line(row: Sequence[str]) -> str:
    """One row in Markdown."""
    return f"| {' | '.join(row)} |"


def document(found: Sequence[Sequence[str]], arguments: list[str], page: Path) -> str:
    """The whole page, for `page`, of rows as `cells` gives them; beside it a CSV of all of them."""
    command = " ".join(["make bench"] if not arguments else ["python -m bench.speed", *arguments])
    known = versions()
    packages = ", ".join(f"{name} {known[name]}" for name in ("numpy", "numba", "h5py", "open3d"))
    missed = [row for row in found if row[-1] == MISSED]
    head = HEAD.format(
        command=command,
        repeats=REPEATS,
        machine=machine(),
        packages=packages,
        met=sum(row[-1] == "yes" for row in found),
        goals=sum(bool(row[-1]) for row in found),
        place=written(page, TABLE, list(COLUMNS), [list(row) for row in found]),
    )
    first = _table([row for row in found if row[0].startswith(FIRST) and row not in missed])
    return "\n".join([head + first, "## Goals not met", "", _table(missed)]) + FOOT


def _table(rows: Iterable[Sequence[str]]) -> str:
    """What was measured, what came out and the goal; the times behind a factor stand in the CSV."""
    shown = (("what; beside what", "result", "goal"), ["---"] * 3, *((row[0], row[3], row[4]) for row in rows))
    return "\n".join(map(line, shown)) + "\n"


def machine() -> str:
    """Processor, cores, memory and load, in words."""
    words = [f"{cores()} cores of {_processor()}"]
    if hasattr(os, "sysconf"):
        memory_gb = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 1e9
        words.append(f"{memory_gb:.0f} GB of memory")
    if hasattr(os, "getloadavg"):
        words.append(f"load average {os.getloadavg()[2]:.1f} over the last quarter of an hour")
    return ", ".join([*words, f"{platform.system()}, Python {platform.python_version()}"])


def _processor() -> str:
    info = Path("/proc/cpuinfo")
    text = info.read_text() if info.exists() else ""
    names = [line.partition(":")[2].strip() for line in text.splitlines() if line.startswith("model name")]
    return names[0] if names else platform.machine()
