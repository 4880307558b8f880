"""The list of stages is kept between processes, and never an old one."""

from pathlib import Path
from typing import Any

import pytest

from workbench import user_folder
from workbench.pipeline import catalogue as module
from workbench.pipeline.catalogue import Catalogue, catalogue


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Any:
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    user_folder.folder.cache_clear()
    yield user_folder.folder().path
    user_folder.folder.cache_clear()


def test_the_second_one_is_read_and_equal(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    made = catalogue()
    assert "scan.read" in [row[0] for row in made.rows]
    monkeypatch.setattr(module, "_made", lambda: pytest.fail("made again"))
    assert catalogue() == made


def test_changed_sources_and_damaged_files_are_not_used(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    made = [Catalogue([[str(i), "", "", ""]], {}, {}) for i in range(3)]
    monkeypatch.setattr(module, "_made", lambda: made.pop(0))
    monkeypatch.setattr(module, "package_digest", lambda name: "one")
    assert catalogue() == catalogue()
    (kept,) = folder.glob("stages-*.json")
    kept.write_text(kept.read_text()[:9])
    assert catalogue().rows[0][0] == "1"
    monkeypatch.setattr(module, "package_digest", lambda name: "other")
    assert catalogue().rows[0][0] == "2"
