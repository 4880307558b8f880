"""Rows of the table about waiting: start-up, the first run after installing, reports, a part in a batch.

All are processor seconds of the command and its children, so that other work on the machine counts little. Set-up
compiles the kernels, a wheel of `make wheel` brings them; the first runs begin with an empty folder for them.
`installing` goes from `git clone` to the demo's report: packages come from the package index (or pip's cache), so the
row is left out where none can be reached; the kernels are compiled by set-up; nothing of an earlier run is used.
`--beside CHECKOUT` of `python -m bench.speed.start_rows` times another state of the project in turn.
"""

from __future__ import annotations

import argparse
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

from bench.speed.table import line
from bench.speed.timing import REPEATS, Row

ROOT = Path(__file__).resolve().parents[2]
RECORDING = ROOT / "data" / "synthetic" / "milled_edge.h5"
BATCH_PARTS = (2, 8)  # what a part costs is told by the difference


def starting(beside: Path | None = None, repeats: int = REPEATS) -> Iterator[Row]:
    """Processor seconds of what a user waits for; the median of `repeats`, cold ones included."""
    sides = [ROOT, *([beside] if beside else [])]
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        inspect, loop, short = "pipelines/inspect_bevel.json", "pipelines/closed_loop.json", "short.json"
        given = ("--input", f"recording={RECORDING}")
        for side in sides:
            (folder / side.name).mkdir()
            (folder / side.name / short).write_text(json.dumps(_without_pages(side / inspect)))

        def run(pipeline: str, *more: str) -> Callable[[Path], float]:
            def timed(side: Path) -> float:
                path = folder / side.name / short if pipeline == short else side / pipeline
                return _spent(side, folder, "run", str(path), *more, "--out", str(folder / side.name / "out"))

            return timed

        def cold(timed: Callable[[Path], float]) -> Callable[[Path], float]:
            def emptied(side: Path) -> float:
                shutil.rmtree(folder / f"kernels-{side.name}", ignore_errors=True)
                return timed(side)

            return emptied

        for side in sides:
            run(inspect, *given)(side)  # bytecode
        yield _row(
            "first inspection without set-up, all kernels to compile", sides, cold(run(inspect, *given)), repeats
        )
        yield _row("first closed loop without set-up, all kernels to compile", sides, cold(run(loop)), repeats)
        yield from _from_wheel(folder, repeats)
        for side in sides:  # all kernels are there from now on
            run(inspect, *given)(side)
        without = {side: [run(short, *given)(side) for _ in range(repeats)] for side in sides}
        yield _said("small part, new process, without report", sides, without, 1.0)
        whole = {side: [run(inspect, *given)(side) for _ in range(repeats)] for side in sides}
        yield _said("first inspection after set-up, report included", sides, whole, 6)
        pages = {side: [statistics.median(whole[side]) - statistics.median(without[side])] for side in sides}
        yield _said("an inspection report", sides, pages, 1.0)
        yield _row("closed loop after set-up", sides, run(loop), repeats, 7)
        yield _row("a part in a batch, report included", sides, lambda side: _batch_part(side, folder), repeats, 1.2)
        for command in (("stages",), ("validate", inspect), ("schema",)):
            yield _row(
                f"`workbench {command[0]}`", sides, lambda side, c=command: _spent(side, folder, *c), repeats, 0.5
            )


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

        def timed(side: Path, path: Path = shipped / "pipelines" / pipeline, more: list[str] = more) -> float:
            shutil.rmtree(kept, ignore_errors=True)
            return _spent(side, folder, "run", str(path), *more, "--out", str(folder / "out"))

        timed(installed)  # bytecode
        yield _row(f"{what} from a wheel of `make wheel`, no kernel kept", [installed], timed, repeats, goal)


def _batch_part(side: Path, folder: Path) -> float:
    few, many = (_batch(side, folder, count) for count in BATCH_PARTS)
    return (many - few) / (BATCH_PARTS[1] - BATCH_PARTS[0])


def _batch(side: Path, folder: Path, count: int) -> float:
    shutil.rmtree(folder / "batch", ignore_errors=True)
    parts = [folder / f"part-{k}.h5" for k in range(count)]
    for part in parts:
        if not part.exists():
            shutil.copy(RECORDING, part)
    pipeline, out = "pipelines/inspect_bevel.json", str(folder / "batch")
    return _spent(side, folder, "batch", pipeline, *map(str, parts), "--workers", "1", "--out", out)


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


def _row(what: str, sides: list[Path], timed: Callable[[Path], float], repeats: int, goal: float | None = None) -> Row:
    times: dict[Path, list[float]] = {side: [] for side in sides}
    for _ in range(repeats):
        for side in sides:
            times[side].append(timed(side))
    return _said(what, sides, times, goal)


def _said(what: str, sides: list[Path], times: dict[Path, list[float]], goal: float | None) -> Row:
    medians = [statistics.median(times[side]) for side in sides]
    other = f"{medians[1]:.2f} s" if len(medians) > 1 else ""
    return Row(f"{what}, processor time", f"{medians[0]:.2f} s", other, medians[0], "{:.2f} s", goal=goal, at_most=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--beside", type=Path, help="a checkout of another state, timed in turn")
    parser.add_argument("--repeats", type=int, default=REPEATS)
    arguments = parser.parse_args()
    for row in starting(arguments.beside and arguments.beside.resolve(), arguments.repeats):
        print(line(row), flush=True)


if __name__ == "__main__":
    main()


GOAL_S = 110
OWN = ("PYTHONPATH", "VIRTUAL_ENV", "NUMBA_CACHE_DIR")  # of this checkout, not of the clone


def installing() -> Iterator[Row]:
    """Processor seconds of clone, set-up and `make demo`, run once."""
    with tempfile.TemporaryDirectory() as name:
        clone = Path(name) / "workbench"
        environment = {
            key: value
            for key, value in os.environ.items()
            if key not in ("PYTHONPATH", "VIRTUAL_ENV", "NUMBA_CACHE_DIR")
        }
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
