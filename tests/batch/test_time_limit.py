"""A part that takes too long is stopped."""

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
