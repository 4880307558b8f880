"""Rivals over recordings, in several processes."""

from __future__ import annotations

import multiprocessing
import signal
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from bench.open.rivals import rival
from bench.open.tracks import Entry, drawn

Task = tuple[str, Entry, tuple[str, ...], Path]  # track, recording, rivals, folder of drawn recordings


def answers(tasks: list[Task], workers: int) -> dict[tuple[str, str, str], Any]:
    """By track, recording and rival, as they come."""
    found: dict[tuple[str, str, str], Any] = {}
    start = time.monotonic()
    for number, (track, name, told) in enumerate(measured(tasks, workers), 1):
        found |= {(track, name, method): answer for method, answer in told.items()}
        if number % 20 == 0 or number == len(tasks):
            print(f"{number} of {len(tasks)} recordings, {time.monotonic() - start:.0f} s", file=sys.stderr, flush=True)
    return found


def measured(tasks: list[Task], workers: int) -> Iterator[tuple[str, str, dict[str, Any]]]:
    if workers <= 1:
        yield from map(one, tasks)
        return
    with multiprocessing.get_context("spawn").Pool(workers, signal.signal, (signal.SIGINT, signal.SIG_IGN)) as pool:
        yield from pool.imap_unordered(one, tasks)


def one(task: Task) -> tuple[str, str, dict[str, Any]]:
    """What every rival says of a recording."""
    track, entry, names, keep = task
    part, told = drawn(entry, keep), {}
    for name in names:
        start = time.process_time()
        try:
            answer = dict(rival(name).measure(part.recording, part.declared))
        except Exception as error:  # a rival that fails has refused; the others go on
            answer = {"refused": f"{type(error).__name__}: {error}"[:300]}
        told[name] = answer | {"seconds": round(time.process_time() - start, 3)}
    return track, entry.name, told
