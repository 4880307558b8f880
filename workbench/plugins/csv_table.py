"""Small tables that people write: CSV with a header; empty lines and those that begin with # do not count."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np

from workbench.api import Float, InputError, Int, numbered_lines, read_text

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
        numbered = numbered_lines(read_text(path, MAX_BYTES))
        if not numbered:
            raise InputError(str(path), f"expected a header with the columns {', '.join(needed)}")
        self.header = [name.strip() for name in next(csv.reader([numbered[0][1]]))]
        missing = [name for name in needed if name not in self.header]
        if missing or len(set(self.header)) < len(self.header):
            parted = ": are cells parted by commas, decimals by points?" if len(self.header) == 1 else ""
            what = f"expected the column '{missing[0]}'{parted}" if missing else "a column stands twice"
            raise InputError(f"{path}: header", what)
        self.lines = [line for line, _ in numbered[1:]]
        self._rows = [next(csv.reader([text])) for _, text in numbered[1:]]
        for line, row in zip(self.lines, self._rows, strict=True):
            if len(row) != len(self.header):
                raise InputError(f"{path}: line {line}", f"expected {len(self.header)} cells, found {len(row)}")
        if len(self._rows) < least:
            raise InputError(str(path), f"expected at least {least} rows, found {len(self._rows)}")

    def words(self, name: str, absent: str) -> list[str]:
        """A column of labels; `absent` in every row where the file has no such column."""
        if name not in self.header:
            return [absent] * len(self._rows)
        k = self.header.index(name)
        return [row[k].strip() or absent for row in self._rows]

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
                if blank and row[k].strip().lower() in ("", "nan"):
                    continue
                found[i, j] = self._number(row[k], f"{self.path}: line {line}: {name}")
        return found

    def _number(self, text: str, where: str) -> float:
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not abs(value) <= MOST:
            expected = "a number" if math.isnan(value) else f"a number within ±{MOST:g}"
            raise InputError(where, f"expected {expected}, found {text.strip()!r}")
        return value
