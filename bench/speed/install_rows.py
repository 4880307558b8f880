"""The row of the table about a new user: from `git clone` to the demo's report.

Packages come from the package index (or pip's cache), so the row is left out where none can be reached. The kernels are
compiled by set-up; nothing of an earlier run is used.
"""

from __future__ import annotations

import os
import resource
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

from bench.speed.timing import Row

ROOT = Path(__file__).resolve().parents[2]
GOAL_S = 110
OWN = ("PYTHONPATH", "VIRTUAL_ENV", "NUMBA_CACHE_DIR")  # of this checkout, not of the clone


def installing() -> Iterator[Row]:
    """Processor seconds of clone, set-up and `make demo`, run once."""
    with tempfile.TemporaryDirectory() as name:
        clone = Path(name) / "workbench"
        environment = {
            key: value
            for key, value in os.environ.items()
            if key not in ("PYTHONPATH", "VIRTUAL_ENV", "NUMBA_CACHE_DIR")
        }
        environment |= {"XDG_CACHE_HOME": str(Path(name) / "cache")}
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        for command in (
            ["git", "clone", "--quiet", str(ROOT), str(clone)],
            ["make", "-C", str(clone), "demo", "YES=1"],
        ):
            done = subprocess.run(command, capture_output=True, text=True, check=False, env=environment)
            if done.returncode:
                print(f"no row of the installation: {done.stderr.strip().splitlines()[-1:]}", file=sys.stderr)
                return
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
    spent = after.ru_utime - before.ru_utime + after.ru_stime - before.ru_stime
    told = "`git clone` to the demo's report, packages from the index, processor time (one run)"
    yield Row(told, f"{spent:.0f} s", "", spent, "{:.0f} s", goal=GOAL_S, at_most=True)
