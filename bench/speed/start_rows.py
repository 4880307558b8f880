"""Rows of the table about waiting: start-up, the first run after installing, reports, a part in a batch.

All are processor seconds of the command and its children, so that other work on the machine counts little. Set-up
compiles the kernels, a wheel of `make wheel` brings them; the first runs begin with an empty folder for them.
`installing` goes from `git clone` to the demo's report: packages come from the package index (or pip's cache), so the
row is left out where none can be reached; the kernels are compiled by set-up; nothing of an earlier run is used.
"""

from __future__ import annotations

import json
import os
import resource
import shutil
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path

from bench.speed.timing import REPEATS, Row

ROOT = Path(__file__).resolve().parents[2]
RECORDING = ROOT / "data" / "synthetic" / "milled_edge.h5"
BATCH_PARTS = (2, 8)  # what a part costs is told by the difference


def starting(repeats: int = REPEATS) -> Iterator[Row]:
    """Processor seconds of what a user waits for; the median of `repeats`, cold ones included."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        inspect, loop, short = "pipelines/inspect_bevel.json", "pipelines/closed_loop.json", str(folder / "short.json")
        Path(short).write_text(json.dumps(_without_pages(ROOT / inspect)))
        given = ("--input", f"recording={RECORDING}")

        def run(pipeline: str, *more: str) -> Callable[[], float]:
            return lambda: _spent(ROOT, folder, "run", pipeline, *more, "--out", str(folder / "out"))

        def cold(pipeline: str, *more: str) -> Callable[[], float]:
            def emptied() -> float:
                shutil.rmtree(folder / f"kernels-{ROOT.name}", ignore_errors=True)
                return run(pipeline, *more)()

            return emptied

        run(inspect, *given)()  # bytecode
        yield _row("first inspection without set-up, all kernels to compile", cold(inspect, *given), repeats)
        yield _row("first closed loop without set-up, all kernels to compile", cold(loop), repeats)
        yield from _from_wheel(folder, repeats)
        run(inspect, *given)()  # all kernels are there from now on
        without = [run(short, *given)() for _ in range(repeats)]
        yield _said("small part, new process, without report", without, 1.0)
        whole = [run(inspect, *given)() for _ in range(repeats)]
        yield _said("first inspection after set-up, report included", whole, 6)
        yield _said("an inspection report", [statistics.median(whole) - statistics.median(without)], 1.0)
        yield _row("closed loop after set-up", run(loop), repeats, 7)
        yield _row("a part in a batch, report included", lambda: _batch_part(folder), repeats, 1.2)
        for command in (("stages",), ("validate", inspect), ("schema",)):
            yield _row(f"`workbench {command[0]}`", lambda c=command: _spent(ROOT, folder, *c), repeats, 0.5)


def _from_wheel(folder: Path, repeats: int) -> Iterator[Row]:
    """First runs from a wheel of `make wheel`, unpacked as pip does."""
    kernels, wheel, installed = folder / "wheel-kernels", folder / "wheel", folder / "installed"
    compiled = [sys.executable, "scripts/compile_kernels.py", "--into", str(kernels)]
    built = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(wheel)]
    for command in (compiled, built):
        subprocess.run(
            command, check=True, capture_output=True, cwd=ROOT, env={**os.environ, "WORKBENCH_KERNELS": str(kernels)}
        )
    shutil.unpack_archive(next(wheel.iterdir()), installed, "zip")
    kept, shipped = folder / f"kernels-{installed.name}", installed / "workbench" / "shipped"
    runs = {  # what is run, and the goal
        "first inspection": (("inspect_bevel.json", "--input", f"recording={RECORDING}"), 6),
        "first closed loop": (("closed_loop.json",), 25),
    }
    for what, ((pipeline, *more), goal) in runs.items():

        def timed(path: Path = shipped / "pipelines" / pipeline, more: list[str] = more) -> float:
            shutil.rmtree(kept, ignore_errors=True)
            return _spent(installed, folder, "run", str(path), *more, "--out", str(folder / "out"))

        timed()  # bytecode
        yield _row(f"{what} from a wheel of `make wheel`, no kernel kept", timed, repeats, goal)


def _batch_part(folder: Path) -> float:
    few, many = (_batch(folder, count) for count in BATCH_PARTS)
    return (many - few) / (BATCH_PARTS[1] - BATCH_PARTS[0])


def _batch(folder: Path, count: int) -> float:
    shutil.rmtree(folder / "batch", ignore_errors=True)
    parts = [folder / f"part-{k}.h5" for k in range(count)]
    for part in parts:
        if not part.exists():
            shutil.copy(RECORDING, part)
    pipeline, out = "pipelines/inspect_bevel.json", str(folder / "batch")
    return _spent(ROOT, folder, "batch", pipeline, *map(str, parts), "--workers", "1", "--out", out)


def _without_pages(path: Path) -> dict[str, object]:
    document = json.loads(path.read_text())
    left = ("report.", "export.")
    document["stages"] = [one for one in document["stages"] if not one["stage"].startswith(left)]
    return dict(document)


def _spent(side: Path, folder: Path, *arguments: str) -> float:
    """Processor seconds of a command, from the sources in `side`, whose bytecode is kept as that of installed ones."""
    kernels = folder / f"kernels-{side.name}"
    kernels.mkdir(exist_ok=True)
    own = {"PYTHONPATH": str(side), "PYTHONPYCACHEPREFIX": str(folder / f"bytecode-{side.name}")}
    own |= {"NUMBA_CACHE_DIR": str(kernels), "PYTHONDONTWRITEBYTECODE": ""}
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    done = subprocess.run(
        [sys.executable, "-m", "workbench", *arguments],
        capture_output=True,
        text=True,
        check=False,
        cwd=side,
        env={**os.environ, **own},
    )
    if done.returncode > 1:
        raise RuntimeError(done.stderr)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime - before.ru_utime + after.ru_stime - before.ru_stime


def _row(what: str, timed: Callable[[], float], repeats: int, goal: float | None = None) -> Row:
    return _said(what, [timed() for _ in range(repeats)], goal)


def _said(what: str, times: list[float], goal: float | None) -> Row:
    median = statistics.median(times)
    return Row(f"{what}, processor time", f"{median:.2f} s", "", median, "{:.2f} s", goal=goal, at_most=True)


GOAL_S = 110
OWN = ("PYTHONPATH", "VIRTUAL_ENV", "NUMBA_CACHE_DIR")  # of this checkout, not of the clone


def installing() -> Iterator[Row]:
    """Processor seconds of clone, set-up and `make demo`, run once."""
    with tempfile.TemporaryDirectory() as name:
        clone = Path(name) / "workbench"
        environment = {key: value for key, value in os.environ.items() if key not in OWN}
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
