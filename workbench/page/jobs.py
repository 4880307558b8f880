"""One run after another, each a child process of its own: what breaks there breaks nothing here."""

from __future__ import annotations

import json
import re
import subprocess
import sys
import threading
from collections.abc import Callable, Iterable
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

from workbench.children import environment
from workbench.errors import OutputError
from workbench.page.records import summary
from workbench.page.store import Run, Store
from workbench.pipeline.follow import RECORDING, state_of

LOOK, DRAFT, PREVIEW, IMPORT = "look", "draft", "preview", "import"  # runs that are no pipeline's
T = TypeVar("T")
RETRY_S = 1.0  # until the store is asked again
SO_FAR = "so_far.svg"  # the sections of a recording that grows
STEP = re.compile(r"\[\d+/\d+\] \S+|\d+ frames so far: .*")
GATE_PASSED = re.compile(r"gate[^:]*: passed ")
VERDICT = re.compile(r"part: (?P<verdict>pass|fail|undecided) \((?P<reason>.*)\)")


class Queue:
    """Runs what the store says is waiting, oldest first.

    Args:
        store: of runs.
        folder: the user's; results go to `results/ID` in it.
    """

    def __init__(self, store: Store, folder: Path) -> None:
        self.store, self.folder = store, folder
        store.resume()
        self._wake, self._end = threading.Event(), threading.Event()
        self._child: tuple[int, subprocess.Popen[str]] | None = None
        self._spare: _Spare | None = None
        self.trouble = ""  # why the store does not answer the queue just now
        self._again: list[Any] = []  # what a child that waits has done
        self._lock = threading.Lock()
        self._thread = threading.Thread(target=self._work, daemon=True)
        self._thread.start()

    def add(self, kind: str, inputs: dict[str, Any]) -> int:
        """The number of a new run."""
        number = self.store.add(kind, inputs)
        self._wake.set()
        return number

    def cancel(self, number: int) -> None:
        """End a run that waits or is at work; its results are then as they were."""
        run = self.store.run(number)
        if run is None or run.state not in ("queued", "running"):
            return
        self.store.update(number, state="cancelled", reason="cancelled")
        with self._lock:
            if self._child and self._child[0] == number:
                self._child[1].terminate()

    def close(self) -> None:
        """End what is at work; it is done again at the next start."""
        self._end.set()
        self._wake.set()
        with self._lock:
            if self._child:
                self._child[1].terminate()
        self._thread.join(10.0)
        if self._spare:
            self._spare.end()

    @property
    def waits(self) -> bool:
        """Whether a child is ready for the next run."""
        return self._spare is not None and self._spare.ready

    def results(self, number: int) -> Path:
        """The folder of a run's results."""
        return self.folder / "results" / str(number)

    def _work(self) -> None:
        self._warm(next((run for run in self._at_last(self.store.runs) or () if _is_done(run)), None))
        while not self._end.is_set():
            run = self._at_last(self.store.next)
            if run is None:
                self._wake.wait()
                self._wake.clear()
                continue
            self._tell(run, state="running", step=None)
            self._at_last(partial(self._done, run, *self._ran(run)))
            self._warm(self._at_last(partial(self.store.run, run.id)))

    def _at_last(self, ask: Callable[[], T]) -> T | None:
        """What the store answers; where its disk is full or fails, as soon as it does not; None at the end."""
        while True:
            try:
                answer = ask()
                self.trouble = ""
                return answer
            except OutputError as error:
                self.trouble = str(error)
                if self._end.wait(RETRY_S):
                    return None

    def _tell(self, run: Run, **values: Any) -> None:
        """How far a run is, if the store can be written."""
        with suppress(OutputError):
            self.store.update(run.id, **values)

    def _warm(self, run: Run | None) -> None:
        """Let a child wait that has done this run, or else what the last one had done."""
        if run and _is_done(run):
            self._again = [run.kind, run.inputs, self._cache()]
        if self._again and not self._end.is_set():
            if self._spare:
                self._spare.end()
            with suppress(OSError):  # then the next run begins cold
                self._spare = _Spare(self._child_of("-m", "workbench.warm"), self._again)

    def _cache(self) -> str:
        return str(self.folder / ".workbench" / "cache")

    def _child_of(self, *arguments: str) -> subprocess.Popen[str]:
        return subprocess.Popen(
            [sys.executable, *arguments],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            errors="replace",
            cwd=self.folder,
            env=environment(),
        )

    def _begun(self, arguments: list[str]) -> subprocess.Popen[str]:
        """A command at work: in the child that waits, where it is ready; else in a new one."""
        spare, self._spare = self._spare, None
        if spare and spare.take(arguments):
            return spare.child
        if spare:
            spare.end()
        child = self._child_of("-m", "workbench", *arguments)
        assert child.stdin is not None
        child.stdin.close()
        return child

    def _ran(self, run: Run) -> tuple[int, str, str]:
        """Exit status, what was printed, and the last line on standard error; of its last command."""
        out = self.results(run.inputs["draft"] if run.kind == PREVIEW else run.id)
        outcome = 0, "", ""
        try:
            out.mkdir(parents=True, exist_ok=True)
            for arguments in self._commands(run, out):
                outcome = self._child_ran(run, arguments)
                if outcome[0] not in (0, 1):
                    break
        except OSError as error:
            return 2, "", f"{out}: cannot be written: {error.strerror}"
        finally:
            for scratch in (self._mapping(run), out / SO_FAR):
                with suppress(OSError):
                    scratch.unlink()
        return outcome

    def _child_ran(self, run: Run, arguments: list[str]) -> tuple[int, str, str]:
        child = self._begun(arguments)
        with self._lock:
            self._child = run.id, child
        printed: list[str] = []
        assert child.stdout is not None
        assert child.stderr is not None

        def read(stream: Iterable[str]) -> None:
            verdict: dict[str, Any] = {}
            for line in stream:
                printed.append(line)
                if known := VERDICT.fullmatch(line.strip()):
                    verdict = known.groupdict()
                elif verdict and line.startswith("gate"):  # before the pictures are drawn
                    self._tell(run, **let_through(verdict, GATE_PASSED.match(line) is not None))

        reader = threading.Thread(target=read, args=(child.stdout,))
        reader.start()
        last = ""
        for line in child.stderr:
            if step := STEP.search(line):
                self._tell(run, step=step[0])
            else:
                last = line.strip() or last
        reader.join()
        status = child.wait()
        with self._lock:
            self._child = None
        return status, "".join(printed), last

    def _mapping(self, run: Run) -> Path:
        """Where a mapping lies while it is read: what it names lies beside it."""
        return self.folder / f".mapping-{run.id}.json"

    def _commands(self, run: Run, out: Path) -> list[list[str]]:
        """What to run, one after another."""
        page = ["--out", str(out / "look.html")]
        if run.kind == LOOK:
            return [[LOOK, run.inputs["file"], *page]]
        if run.kind == DRAFT:
            return [[IMPORT, "--draft", *run.inputs["files"], "--out", str(out / "mapping.json")]]
        if run.kind in (PREVIEW, IMPORT):
            self._mapping(run).write_text(json.dumps(run.inputs["mapping"]), encoding="utf-8")
            made = self.folder / run.inputs["made"]  # of a preview one file, ever again
            read = [IMPORT, *run.inputs["files"], "--mapping", str(self._mapping(run)), "--out", str(made)]
            return [read, [LOOK, str(made), *page]]
        inputs, follow = dict(run.inputs), []
        if inputs.get(RECORDING) and state_of(Path(inputs[RECORDING])) in ("growing", "locked"):
            follow = ["--follow", inputs.pop(RECORDING), "--drawing", str(out / SO_FAR)]
        given = [text for name, value in inputs.items() for text in ("--input", f"{name}={json.dumps(value)}")]
        return [["run", run.kind, "--out", str(out), "--cache", self._cache(), *follow, *given]]

    def _done(self, run: Run, status: int, printed: str, last: str) -> None:
        """Write down what came of it, unless it was cancelled, or is to be done again."""
        found = self.store.run(run.id)
        if found is None or found.state == "cancelled":
            return
        if status < 0 or self._end.is_set():
            failed = {"state": "failed", "reason": f"ended by signal {-status}"}
            word = {"state": "queued"} if self._end.is_set() else failed
            self.store.update(run.id, **word)
            return
        if status == 2:
            self.store.update(run.id, state="failed", status=2, reason=last.removeprefix("error: "))
            return
        if run.kind in (LOOK, DRAFT, PREVIEW, IMPORT):
            shown = run.inputs.get("made") or run.inputs.get("file") or run.inputs["files"][0]
            self.store.update(run.id, state="done", status=status, part=Path(shown).name, reason=printed)
            return
        try:
            result = summary(self.results(run.id))
        except (OSError, ValueError, KeyError) as error:
            unread = f"{self.results(run.id)}: cannot be read: {getattr(error, 'strerror', None) or error}"
            self.store.update(run.id, state="failed", status=2, reason=unread)
            return
        lines = [line for line in printed.splitlines() if line.startswith("gate: ")]
        result.setdefault("reason", lines[-1].removeprefix("gate: ") if lines else "")
        result.setdefault("verdict", "pass" if status == 0 else "fail")
        self.store.update(run.id, state="done", status=status, **let_through(result, status == 0))


def _is_done(run: Run) -> bool:
    """Whether it is a pipeline's that went to its end."""
    return run.status in (0, 1) and run.kind not in (LOOK, DRAFT, PREVIEW, IMPORT)


class _Spare:
    """A child of `workbench.warm`, and whether it waits."""

    def __init__(self, child: subprocess.Popen[str], again: list[Any]) -> None:
        self.child, self.ready = child, False
        assert child.stdin is not None
        self._stdin = child.stdin
        self._say(again)
        threading.Thread(target=self._wait, daemon=True).start()

    def _wait(self) -> None:
        assert self.child.stdout is not None
        self.ready = bool(self.child.stdout.readline())

    def _say(self, what: Any) -> None:
        self._stdin.write(json.dumps(what) + "\n")
        self._stdin.flush()

    def take(self, arguments: list[str]) -> bool:
        """Begin a command; False: it is not ready."""
        if not self.ready or self.child.poll() is not None:
            return False
        try:
            self._say(arguments)
            self._stdin.close()
        except OSError:
            return False
        return True

    def end(self) -> None:
        """It is not needed any more."""
        self.child.kill()
        with self.child:  # its pipes are closed
            pass


def let_through(result: dict[str, Any], passed: bool) -> dict[str, Any]:
    """A part whose sizes pass, and which the gate holds back (a check was loosened), is no PASS to anybody."""
    held = result.get("verdict") == "pass" and not passed
    return {**result, "verdict": "undecided"} if held else result
