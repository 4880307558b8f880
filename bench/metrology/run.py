"""Many parts in several processes; results are kept as they come, one line a part, so that a run can be resumed."""

from __future__ import annotations

import hashlib
import json
import multiprocessing
import os
from collections.abc import Iterable, Iterator
from dataclasses import asdict
from pathlib import Path

from bench.metrology.part import measure_part
from bench.metrology.part_result import PartResult

ROOT = Path(__file__).resolve().parents[2]
WHAT_COUNTS = (
    *(f"workbench/{family}" for family in ("geometry", "scan", "cloud", "edge", "inspect", "synthetic")),
    "bench/peers",
    "bench/metrology",
)
PRESENTATION = ("__main__.py", "run.py", "quantity.py", "summary.py", "table.py")
THREADS = ("NUMBA_NUM_THREADS", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
Task = tuple[str, int, tuple[str, ...]]  # condition, seed, peers


def digest() -> str:
    """Of all source that a result depends on: results of other source are not resumed."""
    files = [path for folder in WHAT_COUNTS for path in sorted((ROOT / folder).rglob("*.py"))]
    files = [path for path in files if path.parent.name != "metrology" or path.name not in PRESENTATION]
    return hashlib.sha256(b"".join(path.read_bytes() for path in files)).hexdigest()[:16]


def measure_all(tasks: Iterable[Task], folder: Path, workers: int) -> Iterator[PartResult]:
    """Results of all tasks as they come: those kept in `folder` first, then new ones, which are kept there."""
    folder.mkdir(parents=True, exist_ok=True)
    tasks, source, done = list(tasks), digest(), set()
    for condition in dict.fromkeys(condition for condition, _, _ in tasks):
        path = folder / f"{condition}.jsonl"
        kept = _kept(path, source)
        _write(path, source, kept.values())
        for task in tasks:
            result = kept.get(task[1]) if task[0] == condition else None
            if result and (result.refused or result.crashed or set(task[2]) <= set(result.peers)):
                done.add(task)
                yield result
    todo = [task for task in tasks if task not in done]
    for result in _in_processes(todo, workers):
        with (folder / f"{result.condition}.jsonl").open("a", encoding="utf-8") as file:
            file.write(json.dumps(asdict(result), allow_nan=False) + "\n")
        yield result


def _kept(path: Path, source: str) -> dict[int, PartResult]:
    """What a former run of the same source has left, by seed; a last line cut short does not count."""
    first, *lines = path.read_text(encoding="utf-8").splitlines() if path.exists() else [""]
    if first != _header(source):
        return {}
    results: dict[int, PartResult] = {}
    for line in lines:
        try:
            result = PartResult(**json.loads(line))
        except ValueError:
            continue
        results[result.seed] = result
    return results


def _header(source: str) -> str:
    return json.dumps({"digest": source})


def _write(path: Path, source: str, results: Iterable[PartResult]) -> None:
    lines = [_header(source), *(json.dumps(asdict(r), allow_nan=False) for r in results)]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def _in_processes(tasks: list[Task], workers: int) -> Iterator[PartResult]:
    """Each worker is one thread: numba and Open3D would otherwise start as many threads as there are cores, each."""
    if workers <= 1 or len(tasks) < 2:
        yield from map(_measure, tasks)
        return
    os.environ.update(dict.fromkeys(THREADS, "1"))
    with multiprocessing.get_context("spawn").Pool(workers) as pool:
        yield from pool.imap_unordered(_measure, tasks)


def _measure(task: Task) -> PartResult:
    return measure_part(*task)
