"""Compiled templates are kept for the next process; what is damaged of them is made again."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from workbench.templates import environment
from workbench.user_folder import folder


@pytest.fixture
def kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    folder.cache_clear()
    yield tmp_path
    folder.cache_clear()


def filled() -> str:
    return environment("workbench.report").get_template("sensitivity.html.j2").render(tables=[], left=[])


def test_what_is_kept_fills_in_alike_and_damage_is_mended(kept: Path) -> None:
    first = filled()
    whole = {file: file.read_bytes() for file in kept.rglob("template-*.kept")}
    assert filled() == first
    for end in (0, 40, -20):
        for file, content in whole.items():
            file.write_bytes(content[:end])
        assert filled() == first
        assert {file.stat().st_size for file in whole} == {len(content) for content in whole.values()}
