"""What every study is: tasks, measured in several processes, and their table, written into a page by its command."""

from __future__ import annotations

import argparse
import contextlib
import importlib
import json
import multiprocessing
import os
import pickle
import signal
import subprocess
import sys
import time
import traceback
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

from bench.tables import put_into

ROOT = Path(__file__).resolve().parents[1]
THREADS = ("NUMBA_NUM_THREADS", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
EVERY = 20  # parts
T, R = TypeVar("T"), TypeVar("R")


class Option(NamedTuple):
    """What a study may be asked for: a number, a word, a switch; of a tuple some."""

    default: Any
    what: str = ""
    choices: Any = None
    said: bool = True  # in the command that stands above the table


@dataclass(frozen=True)
class Study:
    """`python -m bench.NAME`: what is measured, and what is told of all that was found."""

    name: str
    says: str
    options: Mapping[str, Option]
    tasks: Callable[[argparse.Namespace], Iterable[Any]]
    measure: Callable[[Any], Any]
    lines: Callable[[list[Any], argparse.Namespace], Iterable[str]]  # Markdown
    page: str = ""  # of docs/, in which `--docs` puts it
    marks: str = "tables"
    put: Callable[[Path, str], str] = field(default=lambda page, text: text)  # the same as that page has it
    told: Callable[[Any], Iterable[str]] | None = None  # lines on standard error of each result as it comes
    failed: Callable[[Any], object] = field(default=lambda result: False)  # whether a result is a failure
    workers: int = 2
    instead: Callable[[argparse.Namespace], bool] = field(default=lambda given: False)  # whether it did what was asked

    def __call__(self, arguments: Sequence[str] | None = None) -> int:
        """Measure, print, and write the page if it is asked for; the exit status is 1 where a result failed.

        Results are kept, so that a stopped run goes on, unless they are told as they come.
        """
        given, made = self._parsed(arguments), made_by()  # of the code that runs: the commit may change meanwhile
        if self.instead(given):
            return 0
        tasks = list(self.tasks(given))
        if self.told:
            found = []
            for one in each(self.measure, tasks, given.workers):
                found.append(one)
                print(*self.told(one), sep="\n", file=sys.stderr, flush=True)
        else:
            found = kept(self.name, self.measure, tasks, given.workers)
        text = "\n".join([f"`{self.command(given)}`{made}", "", *self.lines(found, given)])
        print(text)
        if self.page and given.docs:
            page = ROOT / "docs" / self.page
            put_into(page, self.put(page, text), self.marks)
        return int(any(map(self.failed, found)))

    def _parsed(self, arguments: Sequence[str] | None) -> argparse.Namespace:
        parser = argparse.ArgumentParser(prog=f"python -m bench.{self.name}", description=self.says)
        for name, (default, what, choices, _) in self.options.items():
            told: dict[str, Any] = {"default": default, "choices": choices, "type": type(default)}
            if isinstance(default, bool):
                told = {"action": "store_true"}
            elif isinstance(default, tuple):
                told |= {"type": str, "nargs": "*", "metavar": "NAME"}
                what = "; ".join(filter(None, (what, ", ".join(choices or ()))))
            elif default and not choices:
                what += f" ({default})"
            parser.add_argument(f"--{name.replace('_', '-')}", help=what, **told)
        parser.add_argument("--workers", type=int, default=self.workers, help=f"processes ({self.workers})")
        if self.page:
            parser.add_argument("--docs", action="store_true", help=f"write the table into docs/{self.page}")
        return parser.parse_args(arguments)

    def command(self, given: argparse.Namespace) -> str:
        """What was run, as it can be typed again: numbers, and what is not the default."""
        words = [f"python -m bench.{self.name}"]
        for name, (default, _, _, said) in self.options.items():
            value, option = getattr(given, name), f"--{name.replace('_', '-')}"
            if said and isinstance(default, tuple) and tuple(value) != default:
                words += [option, *value]
            elif said and not isinstance(default, bool | tuple) and (value != default or isinstance(value, int)):
                words += [option, str(value)]
            elif value is True:
                words.append(option)
        return " ".join(words)


def single_threaded() -> None:
    """Of this process, which measures one part at a time: before numpy is imported."""
    for name in THREADS:
        os.environ.setdefault(name, "1")


def each(measure: Callable[[T], R], tasks: Sequence[T], workers: int) -> Iterator[R]:
    """What `measure` makes of each task, as they come; a line on standard error after every twentieth.

    A worker has one thread: numba and Open3D would otherwise start as many as there are cores, each.
    """
    start = time.monotonic()
    for number, result in enumerate(_results(measure, tasks, workers), 1):
        yield result
        if number % EVERY == 0 or number == len(tasks):
            print(f"{number} of {len(tasks)} parts, {time.monotonic() - start:.0f} s", file=sys.stderr, flush=True)


def _results(measure: Callable[[T], R], tasks: Sequence[T], workers: int) -> Iterator[R]:
    if workers <= 1 or len(tasks) < 2:
        yield from map(measure, tasks)
        return
    os.environ.update(dict.fromkeys(THREADS, "1"))
    measure = _by_name(measure)
    with multiprocessing.get_context("spawn").Pool(workers, signal.signal, (signal.SIGINT, signal.SIG_IGN)) as pool:
        yield from pool.imap_unordered(measure, tasks)


def _by_name(measure: Any) -> Any:
    """The same by its module's own name, which a process spawned of `python -m` knows; in partials, too."""
    if isinstance(measure, partial):
        return partial(*map(_by_name, (measure.func, *measure.args)), **measure.keywords)
    if getattr(measure, "__module__", "") != "__main__":
        return measure
    here = importlib.import_module(sys.modules["__main__"].__spec__.name)  # type: ignore[union-attr]
    return getattr(here, measure.__name__)


def forked(work: Callable[[], Any]) -> Any:
    """What `work` makes in a fork of this process, which it may change.

    Raises:
        ChildProcessError: the fork ended without an answer.
    """
    reader, writer = os.pipe()
    child = os.fork()
    if not child:
        try:
            os.write(writer, pickle.dumps(work()))
        except BaseException:
            traceback.print_exc()
        finally:
            os._exit(0)
    os.close(writer)
    with os.fdopen(reader, "rb") as told:
        answer = told.read()
    _, status = os.waitpid(child, 0)
    if not answer:
        raise ChildProcessError(f"the process ended with {os.waitstatus_to_exitcode(status)}")
    return pickle.loads(answer)


def kept(name: str, measure: Callable[[Any], Any], tasks: Sequence[Any], workers: int = 1) -> list[Any]:
    """What `measure` makes of each task, as JSON holds it, in the tasks' order; a stopped run of a commit goes on.

    One line a task goes to out/NAME-COMMIT.jsonl as it comes; of changed sources nothing is taken from there.
    """
    version = _git("describe", "--always", "--dirty")
    return resumed(ROOT / "out" / f"{name}-{version}.jsonl", measure, tasks, workers, not version.endswith("dirty"))


def resumed(
    log: Path, measure: Callable[[Any], Any], tasks: Sequence[Any], workers: int = 1, goes_on: bool = True
) -> list[Any]:
    """As `kept`, with a log of one's own."""
    log.parent.mkdir(parents=True, exist_ok=True)
    done: dict[str, Any] = {}
    for line in log.read_text(encoding="utf-8").splitlines() if log.exists() and goes_on else ():
        with contextlib.suppress(ValueError):  # a last line that was cut short
            task, found = json.loads(line)
            done[json.dumps(task)] = found
    with log.open("a" if goes_on else "w", encoding="utf-8") as file:
        for task, found in each(partial(_with, measure), [t for t in tasks if json.dumps(t) not in done], workers):
            file.write(f"\n{json.dumps([task, found])}")
            file.flush()
            done[json.dumps(task)] = found
    return [done[json.dumps(task)] for task in tasks]


def _with(measure: Callable[[T], R], task: T) -> tuple[T, R]:
    return task, measure(task)


def made_by() -> str:
    """Commit and date of the code that runs, as they stand behind a table's command."""
    return _git("log", "-1", "--format=, commit %h of %cs")


def _git(*words: str) -> str:
    return subprocess.run(("git", *words), cwd=ROOT, capture_output=True, text=True, check=True).stdout.strip()
