"""Tables in text files: the columns that a mapping names, as numbers, each row with its line.

A file is read in stretches of lines, so that no more of it is held than the numbers that are wanted.
"""

from __future__ import annotations

import csv
import io
import json
import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, NoReturn

import numpy as np

from workbench.errors import InputError, nearest
from workbench.importing.mapping_parts import Column, TextPart
from workbench.importing.text import (
    HEAD_BYTES,
    INK,
    NO_VALUE,
    cells,
    decoded,
    head_text,
    is_number,
    numbered,
    stretches,
)
from workbench.units import Bool, Float, Int

SLAB_BYTES = 2**24
DELIMITERS = {",": "','", ";": "';'", "\t": "tabs", " ": "blanks"}
NEW_LINE = 10


@dataclass(frozen=True, slots=True, eq=False)
class Table:
    """Columns of numbers by role; NaN where a cell is empty."""

    where: str
    columns: dict[str, Float]  # role -> (R,)
    names: dict[str, str]  # role -> the column as the file calls it
    rows: Callable[
        [], tuple[Int, Bool]
    ]  # lines in the file, from 1, and whether a blank line stands before: seldom asked

    @property
    def line(self) -> Int:
        """(R,) line of each row in the file, from 1."""
        return self.rows()[0]

    @property
    def after_blank(self) -> Bool:
        """(R,) whether a blank line stands before the row."""
        return self.rows()[1]

    def present(self, role: str) -> Float:
        """A column without empty cells; InputError naming the line of the first one."""
        gap = np.isnan(self.columns[role])
        if gap.any():
            line = self.line[int(gap.argmax())]
            raise InputError(f"{self.where}: line {line}", f"column {self.names[role]}: no number")
        return self.columns[role]

    def whole(self, role: str) -> Int:
        """A column of whole numbers; InputError naming the line of the first that is none."""
        number = self.present(role)
        wrong = np.flatnonzero((number != np.round(number)) | (np.abs(number) > 2**31 - 1))
        if len(wrong):
            what = f"column {self.names[role]}: expected a whole number, found {number[wrong[0]]:g}"
            raise InputError(f"{self.where}: line {self.line[wrong[0]]}", what)
        return number.astype(np.int64)


def header_names(head: bytes, part: TextPart) -> list[str]:
    """The column names in the first lines of a file; none where it has no header."""
    lines = head_text(head).split("\n")
    return cells(lines[part.skip_lines], part.delimiter) if part.header and len(lines) > part.skip_lines else []


def otherwise_separated(head: bytes, part: TextPart, wanted: Iterable[Column]) -> str:
    """What to say where another delimiter than the part's gives all wanted columns; '' where none does."""
    lines, columns = head_text(head).split("\n"), list(wanted)
    names = {one for one in columns if isinstance(one, str)}
    last = max((one for one in columns if isinstance(one, int)), default=-1)
    for mark, shown in DELIMITERS.items():
        titles = cells(lines[part.skip_lines], mark) if len(lines) > part.skip_lines else []
        fits = names <= set(titles) if part.header else all(is_number(one.replace(",", ".")) for one in titles)
        if mark != part.delimiter and fits and max(last, len(names) - 1) < len(titles) > 1:
            key = f'"delimiter": {json.dumps(mark)} in the mapping'
            return f"the columns are separated by {shown}, not by {DELIMITERS[part.delimiter]}: expected {key}"
    return ""


def read_table(path: Path, part: TextPart, wanted: Mapping[str, Column]) -> Table:
    """The `wanted` columns (role -> name or place) of a whole table; errors as `slabs`."""
    found = list(slabs(path, part, wanted))
    columns = {role: np.concatenate([slab.columns[role] for slab in found]) for role in wanted}
    line, blank = (np.concatenate([slab.rows()[k] for slab in found]) for k in (0, 1))
    return Table(str(path), columns, found[0].names, lambda: (line, blank))


def slabs(path: Path, part: TextPart, wanted: Mapping[str, Column]) -> Iterator[Table]:
    """The `wanted` columns of a table, stretch by stretch of its rows.

    Raises:
        InputError: a column is not there, stands twice or is named twice; a cell is no number; a row is too short or
            too long; an infinity; no rows. With the line.
    """
    where, skipped, begun = str(path), part.skip_lines + bool(part.header), False
    header: list[str] = []
    places: dict[str, int] = {}
    names: dict[str, str] = {}
    count, lines = 0, 0
    for text in stretches(path, SLAB_BYTES, HEAD_BYTES):
        body = _plain_blanks(text, part)
        if not begun:
            header = header_names(body[:HEAD_BYTES], part)
            start = _offset(body, skipped)
            if INK.search(body, start) is None:
                raise InputError(where, f"expected rows of numbers after line {skipped}, found none")
            first_row = next(line for _, line in numbered(body[start : start + HEAD_BYTES]))
            count = len(header) or len(cells(first_row, part.delimiter))
            places = _places(wanted, header, count, where, partial(otherwise_separated, body[:HEAD_BYTES], part))
            names = {role: repr(header[at]) if header else str(at) for role, at in places.items()}
            body, lines, begun = body[start:], skipped, True
        columns = parsed(body, part, places, count, where, lines)
        table = Table(where, columns, names, partial(_rows, body, lines))
        for role, values in columns.items():
            if np.isinf(values).any():
                row = table.line[int(np.isinf(values).argmax())]
                raise InputError(f"{where}: line {row}", f"column {names[role]}: expected a finite number")
        yield table
        lines += int(np.count_nonzero(np.frombuffer(body, np.uint8) == NEW_LINE))


def _plain_blanks(content: bytes, part: TextPart) -> bytes:
    """Lines of white space are empty lines; where white space separates, it is one blank."""
    if part.delimiter == " ":
        return re.sub(rb"[ \t]+", b" ", re.sub(rb"(?m)^[ \t]+|[ \t]+$", b"", content))
    return re.sub(rb"(?m)^ +$", b"", content) if b" " in content and b"\n " in content else content


def _offset(content: bytes, lines: int) -> int:
    """Where the text after some lines begins."""
    offset = 0
    for _ in range(lines):
        offset = content.find(b"\n", offset) + 1
        if offset == 0:
            return len(content)
    return offset


def _rows(body: bytes, skipped: int) -> tuple[Int, Bool]:
    """Line numbers of the rows that are not blank, and before which of them a blank line stands."""
    ends = np.append(np.flatnonzero(np.frombuffer(body, np.uint8) == NEW_LINE), len(body))
    lengths = np.diff(ends, prepend=-1) - 1
    index = np.flatnonzero(lengths > 0)
    return index + skipped + 1, np.diff(index, prepend=-1) > 1


def _places(
    wanted: Mapping[str, Column],
    header: list[str],
    count: int,
    where: str,
    otherwise: Callable[[Iterable[Column]], str],
) -> dict[str, int]:
    """Where the columns stand, from 0; all that are not there, or stand twice, in one error."""
    places, wrong = {}, []
    for role, column in wanted.items():
        found = [i for i, name in enumerate(header) if name == column] if isinstance(column, str) else [column]
        if len(found) == 1 and found[0] < count:
            places[role] = found[0]
        elif isinstance(column, int):
            wrong.append(f"expected a column {column} (counted from 0), found {count} columns")
        elif found:
            wrong.append(f"column {column!r}: stands twice in the header")
        else:
            wrong.append(f"column {column!r}: no such column{nearest(column, [name for name in header if name])}")
    if wrong:
        raise InputError(where, otherwise(wanted.values()) or "; ".join(dict.fromkeys(wrong)))
    return places


# Lines of text to columns of numbers: quickly when all is well, slowly to name what is wrong.


def parsed(
    body: bytes, part: TextPart, places: Mapping[str, int], count: int, where: str, skipped: int
) -> dict[str, Float]:
    """Columns of numbers (role -> values) out of lines of text, by pyarrow's reader.

    Args:
        body: whole lines of a table, the first of them after line `skipped` of the file.
        part: delimiter and decimal mark.
        places: role -> column, from 0.
        count: cells a row.
        where: the file, for messages.
        skipped: lines of the file before `body`.

    Raises:
        InputError: a row of another length, a cell that is no number, with the line.
    """
    import pyarrow as pa
    from pyarrow import csv as arrow_csv

    names = [str(i) for i in range(count)]
    used = sorted(set(places.values()))
    try:
        table = arrow_csv.read_csv(
            pa.BufferReader(body),
            read_options=arrow_csv.ReadOptions(column_names=names, block_size=2**24, use_threads=False),
            parse_options=arrow_csv.ParseOptions(delimiter=part.delimiter),
            convert_options=arrow_csv.ConvertOptions(
                column_types={str(i): pa.float64() for i in used},
                include_columns=[str(i) for i in used],
                null_values=list(NO_VALUE),
                decimal_point=part.decimal,
            ),
        )
    except (pa.ArrowException, ValueError) as error:
        _refuse(body, part, used, count, where, skipped, error)
    return {role: table.column(str(at)).to_numpy() for role, at in places.items()}


def _refuse(body: bytes, part: TextPart, used: list[int], count: int, where: str, skipped: int, error: Any) -> NoReturn:
    """The first row that is wrong, looked for slowly."""
    for number, line in enumerate(decoded(body).split("\n"), skipped + 1):
        if not line.strip():
            continue
        row = next(csv.reader(io.StringIO(line), delimiter=part.delimiter), [])
        if len(row) != count:
            raise InputError(f"{where}: line {number}", f"expected {count} cells, found {len(row)}")
        for i in used:
            text = row[i].strip()
            if text not in NO_VALUE and not _reads(text, part.decimal):
                shown = repr(text if len(text) <= 30 else text[:27] + "...")
                raise InputError(
                    f"{where}: line {number}, cell {i + 1}",
                    f"expected a number with decimal mark '{part.decimal}', found {shown}",
                )
    raise InputError(where, f"expected a table of numbers: {str(error)[:120]}")


def _reads(text: str, decimal: str) -> bool:
    return (
        is_number(text.replace(",", ".")) if decimal == "," and "." not in text else decimal == "." and is_number(text)
    )
