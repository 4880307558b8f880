"""Every stage has an example in its docstring; these, those in docs/open3d.md, do what they say."""

from __future__ import annotations

import doctest
import functools
import sys
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from workbench.pipeline.catalogue import every_stage

ROOT = Path(__file__).parents[2]
STAGES = every_stage()[0]
OPTIONS = doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE


def once(stage: Callable[..., Any]) -> Callable[..., Any]:
    """The stage, run once for the same artefacts and parameters: most examples begin alike."""
    made: dict[Any, tuple[Any, Any]] = {}

    @functools.wraps(stage)
    def run(*sources: Any, **named: Any) -> Any:
        key = known((sources, sorted(named.items())))
        if key not in made:
            made[key] = stage(*sources, **named), (sources, named)  # kept, so that no other object has their ids
        return made[key][0]

    return run


def known(value: Any) -> Any:
    if isinstance(value, tuple | list):
        return tuple(map(known, value))
    return (type(value), value) if isinstance(value, str | int | float | Path | None) else id(value)


@pytest.fixture(scope="module", autouse=True)
def stages_run_once() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        for stage in STAGES.values():
            family = sys.modules[stage.function.__module__.rpartition(".")[0]]
            if getattr(family, stage.function.__name__, None) is stage.function:
                patch.setattr(family, stage.function.__name__, once(stage.function))
        yield


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
