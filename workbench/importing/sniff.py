"""How an unknown text table is written: delimiter, decimal mark, header, where its numbers begin."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np

from workbench.importing.text import NO_VALUE, cells, head_text
from workbench.units import Bool, Float, Shaped

SAMPLE_BYTES = 2**22  # enough for some frames of a wide table
MOST_ROWS = 20_000
FEWEST_ROWS = 2
WAYS = (("\t", "."), ("\t", ","), (";", "."), (";", ","), (",", "."), (" ", "."), (" ", ","))


@dataclass(frozen=True, slots=True, eq=False)
class Form:
    """A table's form, and its first rows."""

    delimiter: str
    decimal: str
    skip_lines: int  # before the header, or before the numbers
    header: tuple[str, ...]  # () where there is none
    rows: Shaped[Float, "r c"]  # NaN where a cell is empty
    after_blank: Shaped[Bool, " r"]  # a blank line stands before the row
    whole: bool  # the sample is the whole file

    def as_part(self) -> dict[str, object]:
        """What a mapping says of it; what it takes for granted is left out."""
        told = {
            "delimiter": self.delimiter,
            "decimal": self.decimal,
            "skip_lines": self.skip_lines,
            "header": bool(self.header),
        }
        usual = {"delimiter": ",", "decimal": ".", "skip_lines": 0, "header": True}
        return {key: value for key, value in told.items() if value != usual[key]}


def sniffed(content: bytes, whole: bool) -> Form | None:
    """The form under which most of a table's first bytes are numbers; None where none gives rows of numbers."""
    lines = head_text(content).split("\n")[: None if whole else -1][: MOST_ROWS + 1000]
    found = [form for way in WAYS if (form := _under(lines, *way, whole)) is not None]
    return max(found, key=lambda form: (form.rows.size, -_place(form)), default=None)


def _place(form: Form) -> int:
    return WAYS.index((form.delimiter, form.decimal))


def _under(lines: list[str], delimiter: str, decimal: str, whole: bool) -> Form | None:
    """The longest run of rows of equally many numbers (blank lines between them allowed), read in one way."""
    rows: list[tuple[int, list[float] | None]] = []
    for number, line in enumerate(lines):
        if line.strip():
            rows.append((number, _numbers(line, delimiter, decimal)))
    best, start = (0, 0), 0
    for at in range(1, len(rows) + 1):
        a = rows[start][1]
        b = rows[at][1] if at < len(rows) else None
        if a is None or b is None or len(a) != len(b):
            if a is not None and at - start > best[1] - best[0]:
                best = (start, at)
            start = at
    first, last = best
    if last - first < FEWEST_ROWS or (last - first) < 0.5 * (len(rows) - first):
        return None
    numbers = [row[1] for row in rows[first:last]]
    table = np.array(numbers, float)
    if not np.isfinite(table).any() or table.shape[1] < 2:
        return None
    header, top = _header(rows, lines, first, table, delimiter)
    if top == first + 1:  # the first row of numbers is a header that counts the columns
        first, table = top, table[1:]
    places = [row[0] for row in rows[first:last]]
    blank = np.diff(places, prepend=places[0] - 1) > 1
    return Form(delimiter, decimal, rows[top - 1][0] if header else places[0], header, table, blank, whole)


def _header(
    rows: list[tuple[int, list[float] | None]], lines: list[str], first: int, table: Float, delimiter: str
) -> tuple[tuple[str, ...], int]:
    """The column names, and the index of the row after them."""
    counts = np.arange(table.shape[1])
    if (
        len(table) > FEWEST_ROWS
        and any((table[0] == counts + k).all() for k in (0, 1))
        and (table[1] != table[0]).any()
    ):
        return tuple(cells(lines[rows[first][0]], delimiter)), first + 1
    if first and rows[first - 1][0] == rows[first][0] - 1:
        names = cells(lines[rows[first - 1][0]], delimiter)
        if len(names) == table.shape[1] and sum(bool(name) for name in names) >= len(names) - 1:
            return tuple(names), first
    return (), first


def _numbers(line: str, delimiter: str, decimal: str) -> list[float] | None:
    """The cells as numbers, NaN for empty ones; None where one is no number."""
    texts = cells(line, delimiter)
    if decimal == ",":
        if any("." in text for text in texts):
            return None
        texts = [text.replace(",", ".") for text in texts]
    try:
        values = [float("nan") if text in NO_VALUE else float(text) for text in texts]
    except ValueError:
        return None
    return None if any("_" in text for text in texts) or all(v != v for v in values) else values


def steady(values: Float) -> bool:
    """Whether a column only changes from block to block: a frame's number or time."""
    if not np.isfinite(values).all() or len(values) < 4:
        return False
    runs = [len(list(group)) for _, group in itertools.groupby(values.tolist())]
    return len(runs) < len(values) / 3 and len(set(values.tolist())) >= len(runs) * 0.9
