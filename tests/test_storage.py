"""Room on disk is asked for before anything is written."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from workbench.storage import as_text, partial_path, require_space


def test_a_small_file_fits(tmp_path: Path) -> None:
    require_space(tmp_path / "small.h5", 1000)


def test_more_than_the_disk_holds_is_refused_in_words(tmp_path: Path) -> None:
    with pytest.raises(OSError, match=r"expected \d+ MB of free disk, found \d+ MB"):
        require_space(tmp_path / "huge.h5", 10**18)


def test_a_folder_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError):
        require_space(tmp_path / "nowhere" / "file.h5", 1)


def test_what_killed_processes_left_goes_and_what_living_ones_write_stays(tmp_path: Path) -> None:
    ended = subprocess.run([sys.executable, "-c", "import os; print(os.getpid())"], capture_output=True, text=True)
    names = [
        f".part.h5.partial-{ended.stdout.strip()}",
        f".part.h5.partial-{os.getpid()}",
        ".part.h5.partial-x",
        f".other.h5.partial-{ended.stdout.strip()}",
    ]
    for name in names:
        (tmp_path / name).touch()
    assert partial_path(tmp_path / "part.h5").name == names[1]
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted(names[1:])


def test_a_name_cannot_command_a_terminal_or_a_spreadsheet() -> None:
    assert as_text("part \x1b[31m\x07") == "part \\x1b[31m\\x07"
    assert as_text("=cmd") == "'=cmd"
    assert as_text("Blech Größe 7") == "Blech Größe 7"
    assert as_text(1.5) == 1.5
