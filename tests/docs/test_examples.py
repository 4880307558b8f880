"""The examples in the docstrings of the stages, and in docs/open3d.md, do what they say."""

from __future__ import annotations

import doctest
import sys
from pathlib import Path

import pytest

from workbench.pipeline.registry import every_stage

ROOT = Path(__file__).parents[2]
SHOWN = {name: one for name, one in every_stage()[0].items() if ">>>" in one.doc}
OPTIONS = doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE


@pytest.fixture(autouse=True)
def in_the_project(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(ROOT)


@pytest.mark.parametrize("name", SHOWN)
def test_the_example_of_a_stage(name: str) -> None:
    stage = SHOWN[name]
    tests = doctest.DocTestFinder(recurse=False).find(
        stage.function, name, sys.modules[stage.function.__module__], globs={}
    )
    assert tests
    for test in tests:
        assert test.examples
        assert doctest.DocTestRunner(optionflags=OPTIONS).run(test).failed == 0, name


def test_there_are_examples() -> None:
    assert len(SHOWN) >= 50


@pytest.mark.parametrize("page", ["docs/open3d.md"])
def test_the_examples_of_a_page(page: str) -> None:
    test = doctest.DocTestParser().get_doctest((ROOT / page).read_text(), {}, page, page, 0)
    assert test.examples
    assert doctest.DocTestRunner(optionflags=OPTIONS).run(test).failed == 0
