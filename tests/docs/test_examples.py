"""Every stage has an example in its docstring; these, those in docs/open3d.md, do what they say."""

from __future__ import annotations

import doctest
import sys
import tempfile
from pathlib import Path

import pytest

from workbench.pipeline.catalogue import every_stage

ROOT = Path(__file__).parents[2]
STAGES = every_stage()[0]
OPTIONS = doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE


@pytest.fixture(autouse=True)
def in_the_project(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.chdir(ROOT)
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))


@pytest.mark.parametrize("name", STAGES)
def test_the_example_of_a_stage(name: str) -> None:
    stage = STAGES[name]
    tests = doctest.DocTestFinder(recurse=False).find(
        stage.function, name, sys.modules[stage.function.__module__], globs={}
    )
    assert tests
    for test in tests:
        assert test.examples
        assert doctest.DocTestRunner(optionflags=OPTIONS).run(test).failed == 0, name


@pytest.mark.parametrize("page", ["docs/open3d.md"])
def test_the_examples_of_a_page(page: str) -> None:
    test = doctest.DocTestParser().get_doctest((ROOT / page).read_text(), {}, page, page, 0)
    assert test.examples
    assert doctest.DocTestRunner(optionflags=OPTIONS).run(test).failed == 0
