"""Room on disk is asked for before anything is written."""

from __future__ import annotations

from pathlib import Path

import pytest

from workbench.errors import OutputError
from workbench.storage import require_space


def test_a_small_file_fits(tmp_path: Path) -> None:
    require_space(tmp_path / "small.h5", 1000)


def test_more_than_the_disk_holds_is_refused_in_words(tmp_path: Path) -> None:
    with pytest.raises(OutputError, match=r"huge\.h5: expected \d+ MB of free disk, found \d+ MB"):
        require_space(tmp_path / "huge.h5", 10**18)


def test_a_folder_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(OutputError, match="cannot be written"):
        require_space(tmp_path / "nowhere" / "file.h5", 1)
