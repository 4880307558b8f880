"""Rows of the table about `workbench run --follow`: from a recording's last frame to the verdict.

A writer in SWMR mode sends a recording in twenty parts over eight seconds, as a scan of that length would come, and
closes it; the time runs from there to the line that tells the verdict. Other work on the machine lengthens it. Poses,
those of a uniform motion's two ends, come first: a frame counts once there is a pose after it.
"""

from __future__ import annotations

import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import h5py

from bench.speed.recordings import simulated
from bench.speed.timing import REPEATS, Row, seconds

ROOT = Path(__file__).resolve().parents[2]
SMALL = ROOT / "data" / "synthetic" / "milled_edge.h5"
GOAL_S = 0.2
PARTS, PAUSE_S = 20, 0.4


def following(repeats: int = REPEATS) -> Iterator[Row]:
    """Wall seconds from the last frame to the verdict, of a small part and of a million points; median of `repeats`."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for what, path in (("small part", SMALL), ("1 M points", simulated(1, folder))):
            taken = statistics.median(_to_verdict(path, folder) for _ in range(repeats))
            told = f"`--follow`, {what}: last frame to verdict, wall time"
            yield Row(told, seconds(taken), "", taken, "{:.2f} s", goal=GOAL_S, at_most=True)


def _to_verdict(path: Path, folder: Path) -> float:
    grown = folder / "grown.h5"
    grown.unlink(missing_ok=True)
    command = [sys.executable, "-m", "workbench", "run", "pipelines/inspect_bevel.json", "--no-report"]
    command += ["--follow", str(grown), "--out", str(folder / "out")]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True, cwd=ROOT) as process:
        assert process.stdout is not None
        _send(path, grown)
        closed = time.monotonic()
        for told in process.stdout:
            if told.startswith("part: "):
                return time.monotonic() - closed
    raise RuntimeError(f"no verdict about {path}")


def _send(path: Path, grown: Path) -> None:
    with h5py.File(path) as old, h5py.File(grown, "w", libver="latest") as new:
        new.attrs.update(old.attrs)
        made: dict[str, tuple[Any, Any]] = {}
        for group in old:
            if group not in ("robot", "profiles"):
                old.copy(group, new)
                continue
            new.create_group(group).attrs.update(old[group].attrs)
            for name, values in old[group].items():
                shape = (0, *values.shape[1:])
                sink = new.create_dataset(
                    f"{group}/{name}", shape, values.dtype, maxshape=(None, *shape[1:]), chunks=(64, *shape[1:])
                )
                made[f"{group}/{name}"] = values[()], sink
        new.swmr_mode = True
        for part in range(1, PARTS + 1):
            for values, sink in made.values():
                first, last = len(sink), len(values) * (PARTS if sink.name.startswith("/robot") else part) // PARTS
                sink.resize(last, 0)
                sink[first:last] = values[first:last]
                sink.flush()
            time.sleep(PAUSE_S)
