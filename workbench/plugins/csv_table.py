"""Small tables that people write: CSV with a header; empty lines and those that begin with # do not count."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np

from workbench.api import Bool, Float, InputError, Int, csv_table, finite_number

MAX_BYTES = 2**26
MOST = 1e6  # degrees, N, Nm, mm: beyond it lies nobody's measurement


def csv_bytes(head: Sequence[str], rows: Iterable[Sequence[object]]) -> bytes:
    """A table as a CSV file."""
    out = io.StringIO()
    csv.writer(out, lineterminator="\n").writerows([head, *rows])
    return out.getvalue().encode()


class Table:
    """Rows of a CSV file by column name; every error names the line."""

    def __init__(self, path: Path, needed: Sequence[str], least: int) -> None:
        """InputError where a column of `needed` or some of the `least` rows are missing."""
        self.path = path
        self.header, self.lines, self._rows = csv_table(path, MAX_BYTES, needed=needed)
        if len(self._rows) < least:
            raise InputError(str(path), f"expected at least {least} rows, found {len(self._rows)}")

    def place(self, rows: Bool) -> str:
        """Where the first of the rows marked (n,) stands, for messages."""
        return f"{self.path}: line {self.lines[int(rows.argmax())]}"

    def words(self, name: str, absent: str) -> list[str]:
        """A column of labels; `absent` in every row where the file has no such column."""
        if name not in self.header:
            return [absent] * len(self._rows)
        k = self.header.index(name)
        return [row[k] or absent for row in self._rows]

    def labels(self, name: str, absent: str) -> tuple[tuple[str, ...], Int]:
        """The different labels of a column in the order in which they come, and the number (n,) of each row's."""
        words = self.words(name, absent)
        names = tuple(dict.fromkeys(words))
        return names, np.array([names.index(word) for word in words], np.int64)

    def numbers(self, names: Sequence[str], blank: bool = False) -> Float:
        """Columns (n, k) of finite numbers; NaN where a cell is empty or `nan`, if `blank` allows it."""
        found = np.full((len(self._rows), len(names)), np.nan)
        for j, name in enumerate(names):
            if name not in self.header and blank:
                continue
            k = self.header.index(name)
            for i, (line, row) in enumerate(zip(self.lines, self._rows, strict=True)):
                if blank and row[k].lower() in ("", "nan"):
                    continue
                where = f"{self.path}: line {line}: {name}"
                found[i, j] = finite_number(row[k], where)
                if abs(found[i, j]) > MOST:
                    raise InputError(where, f"expected a number within ±{MOST:g}, found {row[k]!r}")
        return found
