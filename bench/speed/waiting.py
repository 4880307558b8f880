"""Rows about what a user waits for: commands in processes of their own.

Set-up compiles the kernels, a wheel of `make wheel` brings them. `installing` goes from `git clone` to the demo's
report: packages come from the package index (or pip's cache), so the row is left out where none can be reached.
"""

from __future__ import annotations

import os
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import h5py

from bench.harness import ROOT
from bench.recordings import write_tables
from bench.speed.recordings import simulated
from bench.speed.timing import REPEATS, Row, peak_gb, spent

RECORDING = ROOT / "data" / "synthetic" / "milled_edge.h5"
INSPECT = ("run", "pipelines/inspect_bevel.json", "--input", f"recording={RECORDING}")
BATCH_PARTS = (2, 8)  # what a part costs is told by the difference
PARTS, PAUSE_S = 20, 0.4  # in which a growing recording comes
MILLION = 50  # points that are imported
OWN = ("PYTHONPATH", "VIRTUAL_ENV", "NUMBA_CACHE_DIR")  # of this checkout, not of the clone


def starting(_: Path) -> Iterator[Row]:
    """Processor seconds of commands, kernels kept; those of a wheel without."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        out = ("--out", str(folder / "out"))
        yield _inspected_from_wheel(folder)
        workbench(ROOT, folder, *INSPECT, *out)  # bytecode and kernels are there from now on
        rounds = [
            (
                workbench(ROOT, folder, *INSPECT, "--no-report", *out),
                workbench(ROOT, folder, *INSPECT, *out),
                workbench(ROOT, folder, "run", "pipelines/closed_loop.json", *out),
                _part_of_a_batch(folder),
            )
            for _ in range(REPEATS)
        ]
    without, whole, loop, part = map(statistics.median, zip(*rounds, strict=True))
    yield Row("small part, new process, without report, processor time", without, goal=1)
    yield Row("first inspection after set-up, report included, processor time", whole, goal=6)
    yield Row("an inspection report, processor time", whole - without, goal=1)
    yield Row("closed loop after set-up, processor time", loop, goal=7)
    yield Row("a part in a batch, report included, processor time", part, goal=1.2)


def workbench(side: Path, folder: Path, *arguments: str) -> float:
    """Processor seconds of the command from the sources in `side`, whose bytecode is kept as that of installed ones."""
    kernels = folder / f"kernels-{side.name}"
    kernels.mkdir(exist_ok=True)
    own = {"PYTHONPATH": str(side), "PYTHONPYCACHEPREFIX": str(folder / f"bytecode-{side.name}")}
    own |= {"NUMBA_CACHE_DIR": str(kernels), "PYTHONDONTWRITEBYTECODE": ""}
    return spent([sys.executable, "-m", "workbench", *arguments], side, own)


def _inspected_from_wheel(folder: Path) -> Row:
    """The first inspection from a wheel of `make wheel`, unpacked as pip does."""
    kernels, wheel, installed = folder / "wheel-kernels", folder / "wheel", folder / "installed"
    compiled = [sys.executable, "scripts/compile_kernels.py", "--into", str(kernels)]
    built = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(wheel)]
    for command in (compiled, built):
        spent(command, more={"WORKBENCH_KERNELS": str(kernels)})
    shutil.unpack_archive(next(wheel.iterdir()), installed, "zip")
    taken = []
    for _ in range(REPEATS + 1):
        shutil.rmtree(folder / f"kernels-{installed.name}", ignore_errors=True)
        pipeline = str(installed / "workbench" / "shipped" / INSPECT[1])
        given = (INSPECT[0], pipeline, *INSPECT[2:], "--out", str(folder / "out"))
        taken.append(workbench(installed, folder, *given))
    what = "first inspection from a wheel of `make wheel`, no kernel kept, processor time"
    return Row(what, statistics.median(taken[1:]), goal=6)  # the first one writes bytecode


def _part_of_a_batch(folder: Path) -> float:
    taken = []
    for count in BATCH_PARTS:
        parts = [folder / f"part-{k}.h5" for k in range(count)]
        for part in parts:
            shutil.copy(RECORDING, part)
        out = folder / "batch"
        shutil.rmtree(out, ignore_errors=True)
        taken.append(
            workbench(ROOT, folder, "batch", INSPECT[1], *map(str, parts), "--workers", "1", "--out", str(out))
        )
    return (taken[1] - taken[0]) / (BATCH_PARTS[1] - BATCH_PARTS[0])


def installing(_: Path) -> Iterator[Row]:
    """Processor seconds of clone, set-up and `make demo`, run once."""
    with tempfile.TemporaryDirectory() as name:
        clone = Path(name) / "workbench"
        script = 'git clone --quiet "$0" "$1" && make -C "$1" demo YES=1 || exit 2'
        without = [word for variable in OWN for word in ("-u", variable)]
        try:
            taken = spent(
                ["env", *without, "sh", "-c", script, str(ROOT), str(clone)], more={"XDG_CACHE_HOME": f"{name}/cache"}
            )
        except RuntimeError as error:
            print(f"no row of the installation: {str(error).strip().splitlines()[-1:]}", file=sys.stderr)
            return
    yield Row("`git clone` to the demo's report, packages from the index, processor time (one run)", taken, goal=110)


def following(folder: Path) -> Iterator[Row]:
    """From a recording's last frame to the verdict of `workbench run --follow`, wall seconds."""
    for what, path in (("small part", RECORDING), ("1 M points", simulated(1, folder))):
        taken = statistics.median(_to_verdict(path) for _ in range(REPEATS))
        yield Row(f"`--follow`, {what}: last frame to verdict, wall time", taken, goal=0.2)


def _to_verdict(path: Path) -> float:
    with tempfile.TemporaryDirectory() as name:
        grown = Path(name) / "grown.h5"
        command = [sys.executable, "-m", "workbench", *INSPECT[:2], "--no-report"]
        command += ["--follow", str(grown), "--out", f"{name}/out"]
        with subprocess.Popen(
            command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True, cwd=ROOT
        ) as process:
            assert process.stdout is not None
            _send(path, grown)
            closed = time.monotonic()
            for told in process.stdout:
                if told.startswith("part: "):
                    return time.monotonic() - closed
    raise RuntimeError(f"no verdict about {path}")


def _send(path: Path, grown: Path) -> None:
    """In SWMR mode, in twenty parts over eight seconds, as a scan of that length would come; poses come first."""
    with h5py.File(path) as old, h5py.File(grown, "w", libver="latest") as new:
        new.attrs.update(old.attrs)
        made: list[tuple[Any, Any]] = []
        for group in old:
            if group not in ("robot", "profiles"):
                old.copy(group, new)
                continue
            new.create_group(group).attrs.update(old[group].attrs)
            for name, values in old[group].items():
                rest = values.shape[1:]
                sink = new.create_dataset(
                    f"{group}/{name}", (0, *rest), values.dtype, maxshape=(None, *rest), chunks=(64, *rest)
                )
                made.append((values[()], sink))
        new.swmr_mode = True
        for part in range(1, PARTS + 1):
            for values, sink in made:
                first, last = len(sink), len(values) * (PARTS if sink.name.startswith("/robot") else part) // PARTS
                sink.resize(last, 0)
                sink[first:last] = values[first:last]
                sink.flush()
            time.sleep(PAUSE_S)


def importing(folder: Path) -> Iterator[Row]:
    """50 million points of a table, a point per row, and a table of poses: processor seconds and peak memory, once."""
    with tempfile.TemporaryDirectory() as name:
        tables = Path(name)
        frames = write_tables(simulated(MILLION, folder), tables)
        sources = [str(tables / one) for one in ("scan.csv", "robot.csv")]
        command = ["import", *sources, "--mapping", str(tables / "map.json"), "--out", str(tables / "part.h5")]
        size = os.path.getsize(sources[0]) / 1e9
        what = f"import of {frames:,} profiles, a CSV of {MILLION} M points and {size:.1f} GB (one run)"
        yield Row(f"{what}, processor time", spent([sys.executable, "-m", "workbench", *command]), goal=8)
        yield Row(f"{what}, peak memory", peak_gb(*command), "GB", goal=1)
