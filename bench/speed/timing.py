"""Timing of two sides in turn, so that a noisy machine disturbs both alike."""

from __future__ import annotations

import json
import os
import statistics
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from bench.harness import THREADS

REPEATS = 5


def print_on_one_core(measure: Callable[[], Any]) -> None:
    """What `measure` gives, as JSON on standard output, from a process that keeps to one core."""
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})
    json.dump(measure(), sys.stdout)


@dataclass(frozen=True)
class Row:
    """One line of the table. `factor`: what is compared with the goal, in words and as a number."""

    what: str
    ours: str
    other: str
    factor: float
    factor_is: str  # e.g. "{:.2f} of its speed"
    goal: float | None = None
    at_most: bool = False  # the goal is an upper limit

    @property
    def met(self) -> bool | None:
        """Whether the goal is reached; None where there is none."""
        if self.goal is None:
            return None
        return self.factor <= self.goal if self.at_most else self.factor >= self.goal


def in_turn(
    *sides: Callable[[], Any],
    repeats: int = REPEATS,
    warm_up: bool = True,
    clock: Callable[[], float] = time.perf_counter,
) -> tuple[float, ...]:
    """Median seconds of each side by `clock` (wall clock), run A B A B; one round that is not counted comes first."""
    taken: list[list[float]] = [[] for _ in sides]
    for repeat in range(-1 if warm_up else 0, repeats):
        for side, times in zip(sides, taken, strict=True):
            start = clock()
            side()
            if repeat >= 0:
                times.append(clock() - start)
    return tuple(statistics.median(times) for times in taken)


def seconds(value_s: float) -> str:
    """A time with three digits and its unit."""
    return f"{value_s * 1e3:.3g} ms" if value_s < 1 else f"{value_s:.3g} s" if value_s < 1000 else f"{value_s:.0f} s"


def alone(module: str) -> dict[str, Any]:
    """What `python -m bench.speed.MODULE` prints as JSON, in a process on one core."""
    command = [sys.executable, "-m", f"bench.speed.{module}"]
    variables = {**os.environ, **dict.fromkeys(THREADS, "1")}
    return dict(json.loads(subprocess.run(command, check=True, capture_output=True, text=True, env=variables).stdout))
