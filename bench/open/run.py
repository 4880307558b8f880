"""Rivals over recordings, in several processes."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

from bench.harness import each
from bench.open.rivals import rival
from bench.open.tracks import Entry, drawn

Task = tuple[str, Entry, tuple[str, ...], Path]  # track, recording, rivals, folder of drawn recordings


def answers(tasks: list[Task], workers: int) -> dict[tuple[str, str, str], Any]:
    """By track, recording and rival."""
    found: dict[tuple[str, str, str], Any] = {}
    for track, name, told in each(one, tasks, workers, "recordings"):
        found |= {(track, name, method): answer for method, answer in told.items()}
    return found


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
