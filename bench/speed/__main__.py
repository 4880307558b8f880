"""`python -m bench.speed`: how fast, and in how much memory; `--docs` writes docs/benchmarks.md."""

from __future__ import annotations

import os
import platform
from argparse import Namespace
from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path

from bench.harness import Option, Study
from bench.speed import computing, waiting
from bench.speed.timing import REPEATS, Row
from bench.tables import markdown
from workbench.geometry.blocks import cores
from workbench.pipeline.run import versions

HEAD = ("measurement; compared with", "result", "goal")
GROUPS = {  # by name, how the rows are made
    "start": waiting.starting,
    "install": waiting.installing,
    "follow": waiting.following,
    "import": waiting.importing,
    "inspection": computing.inspecting,
    "batch": computing.batches,
    "planning": computing.planning,
    "calibration": computing.calibrating,
    "posture": computing.posturing,
}
ON_ONE_CORE = ("planning", "calibration", "posture")


def measured(task: tuple[str, str, int]) -> list[Row]:
    """Rows of a group; some keep to one core."""
    name, folder, parts = task
    Path(folder).mkdir(parents=True, exist_ok=True)
    make = partial(computing.batches, count=parts) if name == "batch" else GROUPS[name]
    known = os.sched_getaffinity(0) if hasattr(os, "sched_setaffinity") else set()
    if known and name in ON_ONE_CORE:
        os.sched_setaffinity(0, {max(known)})
    try:
        return list(make(Path(folder)))
    finally:
        if known:
            os.sched_setaffinity(0, known)


def report(found: Sequence[list[Row]], _: Namespace) -> Iterator[str]:
    """On what machine, and the table: goals that are missed in bold."""
    rows = [row for some in found for row in some]
    with_goal, known = [row for row in rows if row.goal is not None], versions()
    packages = ", ".join(f"{name} {known[name]}" for name in ("numpy", "numba", "h5py", "open3d"))
    yield f"Medians of {REPEATS} unless a row says otherwise. {machine()}; {packages}."
    met = f"{sum(row.met for row in with_goal)} of {len(with_goal)} goals are met; a result in bold misses its goal."
    yield from ("", met, "", *markdown(HEAD, (row.cells for row in rows)))


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


STUDY = Study(
    "speed",
    str(__doc__),
    {
        "rows": Option(tuple(GROUPS), choices=GROUPS),
        "parts": Option(1000, "of the batches"),
        "folder": Option("out/speed", "where the recordings are kept for the next time (1 GB)", said=False),
    },
    lambda given: [(name, given.folder, given.parts) for name in given.rows],
    measured,
    report,
    "benchmarks.md",
    told=lambda rows: [f"| {' | '.join(row.cells)} |" for row in rows],
    workers=1,
)
if __name__ == "__main__":
    STUDY()
