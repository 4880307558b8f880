"""How far a batch is, on standard error: one line, rewritten on a terminal, else told now and then."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Iterable, Iterator
from contextlib import suppress
from typing import TextIO

from workbench.batch.record import OUTCOMES, Record

EVERY_S = 10.0  # between lines where none can be rewritten


class Progress:
    """Counts records as they come."""

    def __init__(self, total: int, stream: TextIO | None) -> None:
        self.total, self.stream = total, stream
        self.live = stream is not None and stream.isatty()
        self.counts: Counter[str] = Counter()
        self.skipped = 0
        self.started_s = self.told_s = time.monotonic()

    def watched(self, records: Iterable[Record]) -> Iterator[Record]:
        """The same records, told as they pass."""
        try:
            for record in records:
                self.counts[record.outcome] += 1
                self.skipped += record.skipped
                self._tell(last=self.counts.total() == self.total)
                yield record
        finally:
            if self.live:
                self._write("\n")

    def line(self, elapsed_s: float) -> str:
        """Parts done, what became of them, and the time left at the rate of those that were run."""
        done = self.counts.total()
        words = [f"{self.counts[one]} {one}" for one in reversed(OUTCOMES) if self.counts[one]]
        if self.skipped:
            words.append(f"{self.skipped} of them from an earlier run")
        ran = done - self.skipped
        if done < self.total and ran:
            words.append(f"{duration((self.total - done) * elapsed_s / ran)} left")
        elif done == self.total:
            words.append(f"took {duration(elapsed_s)}")
        return f"[{done}/{self.total}] {', '.join(words)}"

    def _tell(self, last: bool) -> None:
        now_s = time.monotonic()
        if self.live:
            self._write(f"\r\033[K{self.line(now_s - self.started_s)}")
        elif last or now_s - self.told_s >= EVERY_S:
            self.told_s = now_s
            self._write(f"{self.line(now_s - self.started_s)}\n")

    def _write(self, text: str) -> None:
        if self.stream:
            with suppress(OSError):  # a batch does not fail because nobody can watch it
                self.stream.write(text)
                self.stream.flush()


def duration(seconds: float) -> str:
    """A time in words, in the units that fit it."""
    if seconds < 60:
        return f"{seconds:.0f} s" if seconds >= 1 else f"{seconds:.1f} s"
    minutes = round(seconds / 60)
    return f"{minutes} min" if minutes < 60 else f"{minutes // 60} h {minutes % 60:02d} min"
