"""`--plugin FILE.py`: stages of one file, without installing it."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from tests.conftest import Outcome, forget_strangers

PLUGIN = '''
"""A stage of one's own."""
from __future__ import annotations
from typing import Annotated
from pydantic import Field
from workbench.api import Document, stage


@stage("mine.greet")
def greet(*, times: Annotated[int, Field(ge=1, description="number of greetings")] = 1) -> Document:
    """Write a greeting into a file of its own."""
    return Document("greeting.txt", b"hello " * times)
'''
PIPELINE = {"version": 1, "title": "t", "stages": [{"stage": "mine.greet", "times": 2}]}


@pytest.fixture
def workbench(command: Callable[..., Outcome]) -> Iterator[Callable[..., Outcome]]:
    """The command, whose strangers are forgotten."""
    yield command
    forget_strangers()
    sys.modules.pop("workbench_plugin_mine", None)


@pytest.fixture
def files(tmp_path: Path) -> tuple[Path, Path]:
    (tmp_path / "mine.py").write_text(PLUGIN)
    (tmp_path / "p.json").write_text(json.dumps(PIPELINE))
    return tmp_path / "mine.py", tmp_path / "p.json"


def test_a_file_of_stages_runs(workbench: Callable[..., Outcome], files: tuple[Path, Path], tmp_path: Path) -> None:
    plugin, pipeline = files
    got = workbench("run", pipeline, "--plugin", plugin, "--out", tmp_path / "out")
    assert got.status == 0, got.err
    assert (tmp_path / "out" / "greeting.txt").read_bytes() == b"hello hello "
    versions = json.loads((tmp_path / "out" / "run.json").read_text())["versions"]
    assert versions["workbench_plugin_mine"].startswith("sha256:")
    assert "mine.greet" in workbench("stages", "--plugin", plugin).out
    assert workbench("validate", pipeline, "--plugin", plugin).status == 0
    forget_strangers()
    without = workbench("validate", pipeline)
    assert without.status == 2
    assert "unknown stage 'mine.greet'" in without.err


@pytest.mark.parametrize(
    ("content", "says"),
    [
        ("x = 1\n", "defines no stage"),
        ("x = (\n", "line 1: cannot be run: SyntaxError"),
        ("\n\nraise ValueError('no')\n", "line 3: cannot be run: ValueError: no"),
        (None, "no such file"),
    ],
)
def test_what_is_no_plugin_is_one_line(content, says, workbench, files, tmp_path):
    path = tmp_path / "bad.py"
    if content is not None:
        path.write_text(content)
    got = workbench("run", files[1], "--plugin", path, "--out", tmp_path / "out")
    assert got.status == 2
    assert says in got.err
    assert got.err.count("\n") == 1
