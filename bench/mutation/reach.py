"""Which functions each test calls, so that a mutant is put to the tests that can tell it, and the quick ones first.

A pytest plug-in in two parts: with `REACH_WRITE` it writes down what the tests call and how long they take; with
`REACH_RUN` it runs the tests that are named there, in that order. What a fixture or another helper of the tests calls
counts for all tests that may share its result.
"""

from __future__ import annotations

import ast
import faulthandler
import functools
import hashlib
import json
import os
import subprocess
import sys
from collections import defaultdict
from collections.abc import Iterator, Sequence
from pathlib import Path
from types import CodeType, FrameType
from typing import Any

import pytest

ROOT = Path(__file__).resolve().parents[2]
KEPT = ROOT / "out" / "mutation-reach.json"
ENDLESS_S = 180.0  # the kernels of a room compile in a minute or two
SHARING = ("import cache", "functools.cache", "lru_cache", 'scope="')  # in a file whose tests share results


class Recorder:
    """What runs of the package, by test; by folder or file where a result may be shared."""

    def __init__(self) -> None:
        self.own: dict[str, set[str]] = defaultdict(set)
        self.shared: dict[str, set[str]] = defaultdict(set)
        self.seconds: dict[str, float] = {}
        self.now: set[str] = set()
        self.helpers: list[str] = []  # folders of the helpers that are running, the innermost last

    def __call__(self, frame: FrameType, event: str, _: Any) -> None:
        kind, name = _known(frame.f_code)
        if kind == "helper":
            if event == "call":
                self.helpers.append(name)
            elif event == "return" and self.helpers:
                self.helpers.pop()
        elif kind == "kernel" and event == "call":
            self._reached(kernels_of(frame.f_locals["self"]))
        elif kind == "package" and event == "call":
            self._reached((name,))

    def _reached(self, names: tuple[str, ...]) -> None:
        self.now.update(names)
        if self.helpers:
            self.shared[self.helpers[-1]].update(names)

    @pytest.hookimpl(hookwrapper=True)
    def pytest_runtest_protocol(self, item: pytest.Item) -> Iterator[None]:
        self.now, self.helpers = self.own[item.nodeid], []
        sys.setprofile(self)
        yield
        sys.setprofile(None)

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        self.seconds[report.nodeid] = self.seconds.get(report.nodeid, 0.0) + report.duration

    def pytest_sessionfinish(self) -> None:
        by_file: dict[str, set[str]] = defaultdict(set)
        for test, names in self.own.items():
            by_file[test.partition("::")[0]] |= names
        sharing = {one for one in by_file if any(sign in (ROOT / one).read_text() for sign in SHARING)}
        reach = {}
        for test, names in self.own.items():
            file = test.partition("::")[0]
            of_helpers = [more for folder, more in self.shared.items() if file.startswith(folder)]
            reach[test] = sorted((by_file[file] if file in sharing else names).union(*of_helpers))
        known = {"reach": reach, "seconds": self.seconds, "files": {one: digest(one) for one in by_file}}
        Path(os.environ["REACH_WRITE"]).write_text(json.dumps(known), encoding="utf-8")


@functools.cache
def _known(code: CodeType) -> tuple[str, str]:
    """What code belongs to, and its name, or the folder of a helper."""
    path = Path(code.co_filename)
    if not path.is_relative_to(ROOT) or path.is_relative_to(ROOT / ".venv"):
        return "", ""
    inside = path.relative_to(ROOT)
    if inside.parts[0] == "workbench":
        kernel = inside.name == "kernels.py" and code.co_qualname == "Kernel.__call__"
        return ("kernel", "") if kernel else ("package", f"{inside}:{_plain(code.co_qualname)}")
    if inside.parts[0] == "tests" and not inside.name.startswith("test_") and inside.name != "shapes.py":
        return "helper", f"{inside.parent}/"
    return "", ""


def _plain(qualified: str) -> str:
    """The outermost function or method that code is in."""
    return qualified.partition(".<locals>")[0]


@functools.cache
def kernels_of(kernel: Any) -> tuple[str, ...]:
    """A kernel and those that it calls."""
    found: dict[str, None] = {}
    left = [kernel]
    while left:
        function = left.pop().function
        name = f"{Path(function.__code__.co_filename).relative_to(ROOT)}:{_plain(function.__qualname__)}"
        if name not in found:
            found[name] = None
            names = _names(function.__code__)
            left += [one for key in names if hasattr(one := function.__globals__.get(key), "function")]
    return tuple(found)


def _names(code: CodeType) -> set[str]:
    return {*code.co_names}.union(*(_names(one) for one in code.co_consts if isinstance(one, CodeType)))


def digest(file: str) -> str:
    return hashlib.sha256((ROOT / file).read_bytes()).hexdigest()


class Only:
    """The tests of a list, in its order; before them what it does not know."""

    def __init__(self, listed: dict[str, Any]) -> None:
        self.place = {test: k for k, test in enumerate(listed["tests"])}
        self.left_out = set(listed["left_out"])
        self.seconds: dict[str, float] = listed["seconds"]

    def pytest_collection_modifyitems(self, items: list[pytest.Item]) -> None:
        items[:] = sorted(
            (one for one in items if one.nodeid not in self.left_out), key=lambda one: self.place.get(one.nodeid, -1)
        )

    @pytest.hookimpl(hookwrapper=True)
    def pytest_runtest_protocol(self, item: pytest.Item) -> Iterator[None]:
        """A test that does not end has failed; compiling takes its time."""
        faulthandler.dump_traceback_later(ENDLESS_S + 20 * self.seconds.get(item.nodeid, 10.0), exit=True)
        yield
        faulthandler.cancel_dump_traceback_later()


def pytest_configure(config: pytest.Config) -> None:
    if "REACH_WRITE" in os.environ:
        config.pluginmanager.register(Recorder())
    if "REACH_RUN" in os.environ:
        config.pluginmanager.register(Only(json.loads(Path(os.environ["REACH_RUN"]).read_text(encoding="utf-8"))))


def record(tests: Sequence[str]) -> None:
    """Run all tests once, and keep what they call."""
    KEPT.parent.mkdir(parents=True, exist_ok=True)
    command = [sys.executable, "-m", "pytest", "-q", "-m", "not metrology", "-p", "bench.mutation.reach", *tests]
    subprocess.run(command, cwd=ROOT, env={**os.environ, "REACH_WRITE": str(KEPT)}, check=True)


def selection(path: Path, number: int, tests: Sequence[str]) -> tuple[list[str], dict[str, Any]]:
    """The files of tests that a change in a line can concern, and which of their tests are to be run.

    All, if it is not known what they call: outside of functions, in files that are new or have changed.
    """
    known = json.loads(KEPT.read_text(encoding="utf-8"))
    name = function_at((ROOT / path).read_text(encoding="utf-8"), number)
    files = {str(one.relative_to(ROOT)) for test in tests for one in _files(ROOT / test)}
    same = {one for one, was in known["files"].items() if one in files and digest(one) == was}
    reach = {test: names for test, names in known["reach"].items() if test.partition("::")[0] in same}
    chosen = [test for test, names in reach.items() if name is None or f"{path}:{name}" in names]

    def own_then_quick(test: str) -> tuple[bool, float]:
        return Path(test.partition("::")[0]).stem != f"test_{path.stem}", known["seconds"][test]

    run = sorted({test.partition("::")[0] for test in chosen} | (files - same))
    only = {"tests": sorted(chosen, key=own_then_quick), "left_out": sorted({*reach} - {*chosen})}
    return run, only | {"seconds": {test: known["seconds"][test] for test in chosen}}


def _files(place: Path) -> Iterator[Path]:
    yield from place.rglob("test_*.py") if place.is_dir() else [place]


def function_at(source: str, number: int) -> str | None:
    """The outermost function or method that a line is in, as tracing names it."""
    left: list[tuple[str, ast.stmt]] = [("", one) for one in ast.parse(source).body]
    for outer, node in left:
        if isinstance(node, ast.ClassDef | ast.FunctionDef) and node.lineno <= number <= (node.end_lineno or 0):
            if isinstance(node, ast.FunctionDef):
                return outer + node.name
            left += [(f"{outer}{node.name}.", one) for one in node.body]
    return None
