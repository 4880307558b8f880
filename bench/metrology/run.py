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
PRESENTATION = ("__main__.py", "run.py", "summary.py", "table.py")
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
    source, todo = digest(), []
    for condition, of_one in _by_condition(tasks).items():
        path = folder / f"{condition}.jsonl"
        kept = _kept(path, source)
        wanted = {seed: peers for _, seed, peers in of_one}
        done = [r for r in kept if r.seed in wanted and (r.refused or r.crashed or set(wanted[r.seed]) <= set(r.peers))]
        yield from done
        todo += [task for task in of_one if task[1] not in {r.seed for r in done}]
        _write(path, source, kept)
    for result in _in_processes(todo, workers):
        with (folder / f"{result.condition}.jsonl").open("a", encoding="utf-8") as file:
            file.write(json.dumps(asdict(result), allow_nan=False) + "\n")
        yield result


def _by_condition(tasks: Iterable[Task]) -> dict[str, list[Task]]:
    found: dict[str, list[Task]] = {}
    for task in tasks:
        found.setdefault(task[0], []).append(task)
    return found


def _kept(path: Path, source: str) -> list[PartResult]:
    """What a former run of the same source has left; a last line cut short does not count."""
    if not path.exists():
        return []
    first, *lines = path.read_text(encoding="utf-8").splitlines() or ["{}"]
    if json.loads(first).get("digest") != source:
        return []
    results: dict[int, PartResult] = {}
    for line in lines:
        try:
            result = PartResult(**json.loads(line))
        except ValueError:
            continue
        results[result.seed] = result
    return list(results.values())


def _write(path: Path, source: str, results: list[PartResult]) -> None:
    lines = [json.dumps({"digest": source}), *(json.dumps(asdict(r), allow_nan=False) for r in results)]
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
