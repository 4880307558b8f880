"""Many parts in several processes; results are kept as they come, one line a part, so that a run can be resumed."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterable, Iterator
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any

from bench.harness import ROOT, each

PRESENTATION = ("__main__.py", "run.py", "studies.py", "quantity.py", "summary.py", "table.py")
Task = tuple[str, int]  # condition, seed


@dataclass(frozen=True)
class Measurement:
    """What is measured of a part. A result is a dataclass with `condition`, `seed`, `refused` and `crashed`."""

    measure: Callable[[str, int], Any]  # condition, seed -> result
    result: Callable[..., Any]  # the result's class
    sources: tuple[str, ...]  # folders of source that a result depends on


def digest(measurement: Measurement) -> str:
    """Of all source that a result depends on: results of other source are not resumed."""
    files = [path for folder in measurement.sources for path in sorted(_sources(ROOT / folder))]
    return hashlib.sha256(b"".join(path.read_bytes() for path in files)).hexdigest()[:16]


def _sources(folder: Path) -> Iterator[Path]:
    """All Python files below; in the metrology's own folders, those of that folder alone that measure."""
    if (ROOT / "bench" / "metrology") in (folder, folder.parent):
        yield from (path for path in folder.glob("*.py") if path.name not in PRESENTATION)
    else:
        yield from folder.rglob("*.py")


def measure_all(tasks: Iterable[Task], folder: Path, workers: int, measurement: Measurement) -> Iterator[Any]:
    """Results of all tasks as they come: those kept in `folder` first, then new ones, which are kept there."""
    folder.mkdir(parents=True, exist_ok=True)
    tasks, source, done = list(tasks), digest(measurement), set()
    for condition in dict.fromkeys(condition for condition, _ in tasks):
        path = folder / f"{condition}.jsonl"
        kept = _kept(path, source, measurement)
        _write(path, source, kept.values())
        for task in tasks:
            result = kept.get(task[1]) if task[0] == condition else None
            if result:
                done.add(task)
                yield result
    todo = [task for task in tasks if task not in done]
    for result in each(partial(_measure, measurement.measure), todo, workers):
        with (folder / f"{result.condition}.jsonl").open("a", encoding="utf-8") as file:
            file.write(json.dumps(asdict(result), allow_nan=False) + "\n")
        yield result


def _kept(path: Path, source: str, measurement: Measurement) -> dict[int, Any]:
    """What a former run of the same source has left, by seed; a last line cut short does not count."""
    first, *lines = path.read_text(encoding="utf-8").splitlines() if path.exists() else [""]
    if first != _header(source):
        return {}
    results: dict[int, Any] = {}
    for line in lines:
        try:
            result = measurement.result(**json.loads(line))
        except ValueError:
            continue
        results[result.seed] = result
    return results


def _header(source: str) -> str:
    return json.dumps({"digest": source})


def _write(path: Path, source: str, results: Iterable[Any]) -> None:
    lines = [_header(source), *(json.dumps(asdict(r), allow_nan=False) for r in results)]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def _measure(measure: Callable[[str, int], Any], task: Task) -> Any:
    return measure(*task)
