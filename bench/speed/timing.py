"""A row of the table, and how its times are taken."""

from __future__ import annotations

import os
import resource
import statistics
import subprocess
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from bench.harness import ROOT

REPEATS = 5
PEAK = """
import sys
from workbench.cli import main
status = main(sys.argv[1:])
line = next(line for line in open("/proc/self/status") if line.startswith("VmHWM"))
print("peak", int(line.split()[1]) * 1024)
sys.exit(status)
"""


@dataclass(frozen=True)
class Row:
    """What was measured. The goal is an upper limit, unless `at_least`."""

    what: str
    value: float
    unit: str = "s"
    goal: float | None = None
    at_least: bool = False

    @property
    def met(self) -> bool:
        """Whether the goal is reached; true where there is none."""
        return self.goal is None or (self.value >= self.goal if self.at_least else self.value <= self.goal)

    @property
    def cells(self) -> list[str]:
        """As the table has it."""
        goal = "" if self.goal is None else f"at {'least' if self.at_least else 'most'} {self.goal:g}"
        shown = f"{self.value:.3g} {self.unit}"
        return [self.what, shown if self.met else f"**{shown}**", goal]


def median_s(action: Callable[[], Any], repeats: int = REPEATS) -> float:
    """Median seconds of processor time; one round that is not counted comes first."""
    taken = []
    for _ in range(repeats + 1):
        start = time.process_time()
        action()
        taken.append(time.process_time() - start)
    return statistics.median(taken[1:])


def spent(command: Sequence[str], cwd: Path = ROOT, more: Mapping[str, str] | None = None) -> float:
    """Processor seconds of a command and its children, so that other work on the machine counts little.

    Raises:
        RuntimeError: it ended with a status above 1.
    """
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    environment = {**os.environ, **(more or {})}
    done = subprocess.run(command, capture_output=True, text=True, check=False, cwd=cwd, env=environment)
    if done.returncode > 1:
        raise RuntimeError(done.stderr)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime - before.ru_utime + after.ru_stime - before.ru_stime


def peak_gb(*arguments: str) -> float:
    """Largest resident memory of `workbench ARGUMENTS`, GB.

    By the kernel's count of that process: `resource.getrusage` also counts the one that started it.
    """
    command = [sys.executable, "-c", PEAK, *arguments]
    done = subprocess.run(command, capture_output=True, text=True, check=False, cwd=ROOT)
    if done.returncode > 1:
        raise RuntimeError(done.stderr)
    return int(done.stdout.split()[-1]) / 1e9
