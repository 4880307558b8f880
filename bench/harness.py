"""What every study needs: its parts in several processes, one line now and then, and what its table was made by."""

from __future__ import annotations

import multiprocessing
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TypeVar

ROOT = Path(__file__).resolve().parents[1]
THREADS = ("NUMBA_NUM_THREADS", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
EVERY = 20  # parts
T, R = TypeVar("T"), TypeVar("R")


def each(measure: Callable[[T], R], tasks: Sequence[T], workers: int, what: str = "parts") -> Iterator[R]:
    """What `measure` makes of each task, as they come; a line on standard error after every twentieth.

    A worker has one thread: numba and Open3D would otherwise start as many as there are cores, each.
    """
    start = time.monotonic()
    for number, result in enumerate(_results(measure, tasks, workers), 1):
        yield result
        if number % EVERY == 0 or number == len(tasks):
            print(f"{number} of {len(tasks)} {what}, {time.monotonic() - start:.0f} s", file=sys.stderr, flush=True)


def _results(measure: Callable[[T], R], tasks: Sequence[T], workers: int) -> Iterator[R]:
    if workers <= 1 or len(tasks) < 2:
        yield from map(measure, tasks)
        return
    os.environ.update(dict.fromkeys(THREADS, "1"))
    with multiprocessing.get_context("spawn").Pool(workers, signal.signal, (signal.SIGINT, signal.SIG_IGN)) as pool:
        yield from pool.imap_unordered(measure, tasks)


def made_by() -> str:
    """Commit and date of the code that runs, as they stand behind a table's command."""
    told = ("git", "log", "-1", "--format=, commit %h of %cs")
    return subprocess.run(told, cwd=ROOT, capture_output=True, text=True, check=True).stdout.strip()
