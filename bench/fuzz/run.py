"""Feed mutated files to one reader, in a process of its own, and write down what should not have happened."""

from __future__ import annotations

import random
import resource
import signal
import sys
import tempfile
import time
import traceback
import warnings
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path
from types import FrameType
from typing import Any, NoReturn

from bench.fuzz.targets import TARGETS, Target
from workbench.errors import WorkbenchError

HANG_S = 10  # of processor time; ten times as long by the clock, of a machine that others use too
MEMORY_BYTES = 3 << 30  # beyond what the process holds when it begins


class HangError(BaseException):
    """A reader that does not come back; no `except Exception` may swallow it."""


@dataclass
class Outcome:
    """What became of the executions of one target."""

    target: str
    executions: int = 0
    accepted: int = 0
    refused: int = 0
    seconds: float = 0.0
    slowest_s: float = 0.0
    failures: Counter[str] = field(default_factory=Counter)  # by what was raised and where


def fuzz(target: Target, executions: int, seed: int, keep: Path | None = None) -> Outcome:
    """Mutate, read, judge. `keep`: where a file that made trouble is left, one of each kind."""
    outcome = Outcome(target.name)
    rng = random.Random(f"{target.name} {seed}")
    sources = [(path.suffix, path.read_bytes()) for path in target.files()]
    begun = time.perf_counter()
    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        place = target.surroundings(Path(folder))
        for _ in range(executions):
            suffix, content = rng.choice(sources)
            path = place / f"mutated{suffix}"
            path.write_bytes(target.mutate(content, suffix, rng))
            trouble = judged(target, path, outcome)
            if trouble and keep and not outcome.failures[trouble]:
                keep.mkdir(parents=True, exist_ok=True)
                (keep / f"{target.name}-{len(outcome.failures)}{suffix}").write_bytes(path.read_bytes())
            outcome.failures.update([trouble] if trouble else [])
    outcome.seconds = time.perf_counter() - begun
    return outcome


def judged(target: Target, path: Path, outcome: Outcome) -> str | None:
    """Read once; the trouble in words, or None."""
    outcome.executions += 1
    start = time.process_time()
    try:
        signal.setitimer(signal.ITIMER_PROF, HANG_S)
        signal.alarm(10 * HANG_S)
        target.read(path)
        outcome.accepted += 1
    except WorkbenchError as error:
        outcome.refused += 1
        return None if _is_one_clear_line(str(error)) else f"not one line: {str(error)[:200]!r}"
    except (Exception, HangError) as error:
        place = traceback.extract_tb(error.__traceback__)[-1]
        return f"{type(error).__name__}: {str(error)[:120]} ({Path(place.filename).name}:{place.lineno})"
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
        signal.alarm(0)
        outcome.slowest_s = max(outcome.slowest_s, time.process_time() - start)
    return None


def _is_one_clear_line(text: str) -> bool:
    return ": " in text and len(text) < 2000 and "\n" not in text and "Traceback" not in text


def confine() -> None:
    """For the process that fuzzes: an alarm for what hangs, an end to memory."""

    def hang(number: int, frame: FrameType | None) -> NoReturn:
        raise HangError(f"no answer for {HANG_S} s")

    signal.signal(signal.SIGALRM, hang)
    signal.signal(signal.SIGPROF, hang)
    held = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (held + MEMORY_BYTES, resource.RLIM_INFINITY))
    sys.setrecursionlimit(1000)


def outcome_of(name: str, executions: int, seed: int, keep: str) -> dict[str, Any]:
    """Of one reader, in a process that does nothing else."""
    target = next(target for target in TARGETS if target.name == name)
    target.read(target.files()[0])  # imports and compiles
    confine()
    outcome = fuzz(target, executions, seed, Path(keep))
    return {**vars(outcome), "failures": dict(outcome.failures)}
