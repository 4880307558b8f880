"""Recordings written to a place that fills up: whole, or one line, status 2 and nothing changed; never a signal."""

from __future__ import annotations

from pathlib import Path

from bench.kills.disk import writes


def test_writes_end_whole_or_are_refused(tmp_path: Path) -> None:
    found = writes(24, seed=7, folder=tmp_path)
    assert [what for what in found if "WRONG" in what] == []
    assert any(what.endswith("refused") for what in found)
    assert any(what.endswith("written") for what in found)
