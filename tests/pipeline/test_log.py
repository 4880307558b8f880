"""What a run leaves in a log."""

import io
from types import SimpleNamespace

import pytest

from workbench.pipeline.terminal import Lines


def test_a_log_tells_now_and_then_how_far_a_long_stage_is(monkeypatch: pytest.MonkeyPatch) -> None:
    clock, log = iter([0.0, 1.0, 20.0, 20.0, 21.0, 22.0]), io.StringIO()
    monkeypatch.setattr("workbench.pipeline.terminal.time", SimpleNamespace(monotonic=lambda: next(clock)))
    lines = Lines(log)
    lines.begin(0, 1, "long")
    for done in (0.1, 0.2, 0.3):
        lines.fraction(done)
    lines.end(22.0)
    assert log.getvalue() == "[1/1] long 20 % 22.00 s\n"
