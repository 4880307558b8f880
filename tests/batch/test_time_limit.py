"""Times: a part that takes too long is stopped, and how long a batch will take is told."""

import io
from collections.abc import Callable
from pathlib import Path

from workbench.batch import run_batch

Write = Callable[..., str]


def test_a_part_that_takes_too_long_is_stopped_and_told(pipeline: Path, record: Write, tmp_path: Path) -> None:
    """By itself: on a loaded machine another part might take as long."""
    batch = run_batch(pipeline, [record("stuck", "hang")], str(tmp_path / "out"), workers=1, time_limit_s=2.0)
    (one,) = batch.records
    assert (one.outcome, batch.exit_status) == ("hung", 2)
    assert "took longer than 2 s and was stopped" in one.cause
    assert {path.name for path in (tmp_path / "out" / "stuck").iterdir()} == {"part.json"}


def test_the_time_left_is_that_of_the_parts_that_are_left(pipeline: Path, record: Write, tmp_path: Path) -> None:
    told, parts = io.StringIO(), [record(f"part-{k}", "slow") for k in range(3)]
    told.isatty = lambda: True  # type: ignore[method-assign]
    for some in (parts[:1], parts):  # one is there from before
        run_batch(pipeline, some, str(tmp_path / "out"), workers=0, progress=told)
    *_, last_but_one, last = told.getvalue().replace("\033[K", "").strip().split("\r")
    left, took = (float(line.split()[-2 if line is last else -3]) for line in (last_but_one, last))
    assert last_but_one.startswith("[2/3] 2 passed, 1 of them from an earlier run, ")
    assert 0.4 <= left < took < 2 * left + 0.4
