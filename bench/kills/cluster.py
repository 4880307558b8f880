"""`python -m bench.kills.cluster`: a batch on dask of which a worker is killed, then the scheduler, then run again.

Each part is a real inspection. Watched is run.json of every part: it may appear once and must never change. In the end
all results are compared, byte by byte, with those of one process without a cluster.
"""

from __future__ import annotations

import argparse
import contextlib
import dataclasses
import json
import os
import random
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from bench.harness import ROOT, made_by
from bench.tables import put_into
from workbench.batch import run_batch
from workbench.errors import InputError
from workbench.recording_file import write
from workbench.scan import read

PIPELINE = ROOT / "pipelines" / "inspect_bevel.json"
SMALL = ROOT / "bench" / "fuzz" / "corpus" / "inspecting" / "small.h5"
STARTS_S = 120.0  # a cluster, on a loaded machine too


def recordings(folder: Path, count: int, seed: int) -> list[str]:
    """The small recording with noise of its own each."""
    one, rng = read(recording=str(SMALL)), np.random.default_rng(seed)
    paths = []
    for i in range(count):
        z = one.z_mm + rng.normal(0.0, 0.002, one.z_mm.shape).astype(np.float32)
        write(dataclasses.replace(one, z_mm=z), folder / f"part-{i:03d}.h5")
        paths.append(str(folder / f"part-{i:03d}.h5"))
    return paths


class Cluster:
    """A scheduler and its workers, a process each."""

    def __init__(self, folder: Path, workers: int) -> None:
        told = folder / "scheduler.json"
        told.unlink(missing_ok=True)
        where = ["--scheduler-file", str(told), "--no-dashboard"]
        self.scheduler = _started("dask_scheduler", *where, "--host", "127.0.0.1", "--port", "0")
        alone = ["--nthreads", "1", "--no-nanny", "--local-directory", str(folder)]
        self.workers = [_started("dask_worker", *where, *alone) for _ in range(workers)]
        until = time.monotonic() + STARTS_S
        while not told.exists() and time.monotonic() < until:
            time.sleep(0.1)
        self.address = str(json.loads(told.read_text())["address"])

    def end(self) -> None:
        """Kill what is left of it."""
        for process in (*self.workers, self.scheduler):
            with contextlib.suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
            process.wait()


def _started(program: str, *arguments: str) -> subprocess.Popen[bytes]:
    command = [sys.executable, "-m", f"distributed.cli.{program}", *arguments]
    quiet = subprocess.DEVNULL
    return subprocess.Popen(command, start_new_session=True, stdout=quiet, stderr=quiet, cwd=ROOT)


class Watch(threading.Thread):
    """Every run.json that was ever seen of a part, by its inode and time."""

    def __init__(self, out: Path) -> None:
        super().__init__(daemon=True)
        self.out, self.seen, self.over = out, dict[str, set[tuple[int, int]]](), threading.Event()
        self.start()

    def run(self) -> None:
        """Until it is over."""
        while not self.over.wait(0.05):
            self.look()

    def look(self) -> None:
        """Once."""
        for path in self.out.glob("*/run.json"):
            with contextlib.suppress(FileNotFoundError):
                stat = path.stat()
                self.seen.setdefault(path.parent.name, set()).add((stat.st_ino, stat.st_mtime_ns))


@contextlib.contextmanager
def killed(process: subprocess.Popen[bytes], watch: Watch, after: int) -> Iterator[None]:
    """The process is killed once so many parts are done."""
    stop = threading.Event()

    def kill() -> None:
        while len(watch.seen) < after and not stop.wait(0.02):
            pass
        if not stop.is_set():
            os.killpg(process.pid, signal.SIGKILL)

    killer = threading.Thread(target=kill, daemon=True)
    killer.start()
    yield
    stop.set()
    killer.join()


def main() -> int:
    """The parts, the kills, and what came of them."""
    parser = argparse.ArgumentParser(prog="python -m bench.kills.cluster", description=__doc__)
    parser.add_argument("--parts", type=int, default=200)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--docs", action="store_true", help="write the line into docs/reliability.md")
    options = parser.parse_args()
    rng = random.Random(options.seed)
    first = rng.randint(2, options.parts // 3)
    second = rng.randint(options.parts // 2, options.parts * 9 // 10)
    with tempfile.TemporaryDirectory() as folder:
        paths = recordings(Path(folder), options.parts, options.seed)
        out, single = Path(folder) / "out", Path(folder) / "single"
        watch, told = Watch(out), "the scheduler was not killed"
        cluster = Cluster(Path(folder), options.workers)
        try:
            with killed(cluster.workers[0], watch, first), killed(cluster.scheduler, watch, second):
                run_batch(PIPELINE, paths, str(out), scheduler=cluster.address)
        except InputError as error:
            told = error.expected
        finally:
            cluster.end()
        before = len(watch.seen)
        cluster = Cluster(Path(folder), options.workers)
        try:
            made = run_batch(PIPELINE, paths, str(out), scheduler=cluster.address)
        finally:
            cluster.end()
        watch.over.set()
        watch.join()
        watch.look()
        alone = run_batch(PIPELINE, paths, str(single), workers=0)
        once = sum(len(of) == 1 for of in watch.seen.values())
        equal = sum(
            _contents(out / f"part-{i:03d}") == _contents(single / f"part-{i:03d}") for i in range(options.parts)
        )
        same = [one.outcome for one in made.records] == [one.outcome for one in alone.records]
    text = (
        f"{options.parts} parts on {options.workers} workers, seed {options.seed}{made_by()}: a worker killed after "
        f"{first}, the scheduler after {second} ({before} done, then reported: {told}). Carried on by the same "
        f"command: {once} parts written once, {equal} equal to one process's in every byte, outcomes "
        f"{'' if same else 'not '}the same."
    )
    print(text)
    if options.docs:
        put_into(ROOT / "docs" / "reliability.md", text, "cluster")
    return int(not (once == equal == options.parts and same and "carries on" in told))


def _contents(folder: Path) -> dict[str, bytes]:
    """Of all results but run.json, which has times."""
    return {path.name: path.read_bytes() for path in folder.iterdir() if path.name not in ("run.json", "part.json")}


if __name__ == "__main__":
    sys.exit(main())
