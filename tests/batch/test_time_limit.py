"""Times: a part that takes too long is stopped, and how long a batch will take is told."""

import io
import itertools
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

import pytest

from workbench.batch import run_batch

Write = Callable[..., str]


def test_a_part_that_takes_too_long_is_stopped_and_told(pipeline: Path, record: Write, tmp_path: Path) -> None:
    """By itself: on a loaded machine another part might take as long."""
    batch = run_batch(pipeline, [record("stuck", "hang")], str(tmp_path / "out"), workers=1, time_limit_s=2.0)
    (one,) = batch.records
    assert (one.outcome, batch.exit_status) == ("hung", 2)
    assert "took longer than 2 s and was stopped" in one.cause
    assert {path.name for path in (tmp_path / "out" / "stuck").iterdir()} == {"part.json"}


def test_the_time_left_is_that_of_the_parts_that_are_left(
    pipeline: Path, record: Write, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """By a clock that goes on by 10 s whenever it is asked."""
    parts = [record(f"part-{k}") for k in range(3)]
    run_batch(pipeline, parts[:1], str(tmp_path / "out"), workers=0)
    told, clock = io.StringIO(), SimpleNamespace(monotonic=itertools.count(0.0, 10.0).__next__)
    told.isatty = lambda: True  # type: ignore[method-assign]
    monkeypatch.setattr("workbench.batch.run.time", clock)
    run_batch(pipeline, parts, str(tmp_path / "out"), workers=0, progress=told)
    assert told.getvalue().replace("\033[K", "").strip().split("\r") == [
        "[1/3] 1 passed, 1 of them from an earlier run",
        "[2/3] 2 passed, 1 of them from an earlier run, 20 s left",
        "[3/3] 3 passed, 1 of them from an earlier run, took 30 s",
    ]
