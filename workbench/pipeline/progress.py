"""What a person sees while a pipeline runs: the stages as they go by, and why the first run takes longer."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any, TextIO

from workbench.errors import one_line
from workbench.kernels import compiling
from workbench.user_folder import folder


class Reporter:
    """Told what a run is doing; this one keeps it to itself."""

    def begin(self, index: int, count: int, name: str) -> None:
        """Stage `name`, number `index` from 0, begins."""

    def fraction(self, done: float) -> None:
        """The stage has done this share of its work, 0 to 1."""

    def end(self, seconds: float) -> None:
        """The stage has ended."""

    def known(self, results: Any) -> None:
        """All is measured and decided (`pipeline.run.Results`); what follows are pages."""

    def compiling(self) -> None:
        """Kernels are being compiled, once after installing."""


class Lines(Reporter):
    """One line a stage on a stream; on a terminal it is rewritten in place while the stage runs."""

    def __init__(self, stream: TextIO) -> None:
        self.stream = stream
        self.live = stream.isatty()
        self.label = ""  # of the stage that is running

    def begin(self, index: int, count: int, name: str) -> None:
        """Show which stage is running."""
        self.label = f"[{index + 1}/{count}] {name}"
        self._show(self.label)

    def fraction(self, done: float) -> None:
        """Show how far it is, where a line can be rewritten."""
        if self.live:
            self._show(f"\r{self.label} {100 * min(max(done, 0.0), 1.0):3.0f} %")

    def end(self, seconds: float) -> None:
        """Show how long it took."""
        self._show(f"\r{self.label} {seconds:.2f} s\n" if self.live else f" {seconds:.2f} s\n")
        self.label = ""

    def compiling(self) -> None:
        """Say why it takes so long this time."""
        kept = one_line(folder().note()) or "only once after installing"
        self._show(f"\ncompiling kernels for this machine: {kept}\n{self.label}")

    def close(self) -> None:
        """End the line of a stage that failed or was stopped."""
        if self.label:
            self._show("\n")

    def _show(self, text: str) -> None:
        with suppress(OSError):  # a run does not fail because nobody can watch it
            self.stream.write(text)
            self.stream.flush()


@contextmanager
def compilation_watch(reporter: Reporter) -> Iterator[None]:
    """Tell the reporter, once, when a kernel has to be compiled."""
    untold = [reporter.compiling]
    with compiling(lambda: untold.pop()() if untold else None):
        yield
