"""Tables in text files: the columns that a mapping names, as numbers, each row with its line."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NoReturn

import numpy as np

from workbench.errors import InputError, nearest
from workbench.importing.mapping_tables import Column, TextPart
from workbench.importing.text import cells, decoded, head_text, is_number, read_lines_as_bytes
from workbench.units import Bool, Float, Int

EMPTY = ["", "nan", "NaN", "NAN"]


@dataclass(frozen=True, slots=True, eq=False)
class Table:
    """Columns of numbers by role; NaN where a cell is empty."""

    where: str
    columns: dict[str, Float]  # role -> (R,)
    names: dict[str, str]  # role -> the column as the file calls it
    line: Int  # (R,) line in the file, from 1
    after_blank: Bool  # (R,) a blank line stands before the row

    def present(self, role: str) -> Float:
        """A column without empty cells; InputError naming the line of the first one."""
        gap = np.flatnonzero(np.isnan(self.columns[role]))
        if len(gap):
            raise InputError(f"{self.where}: line {self.line[gap[0]]}", f"column {self.names[role]}: no number")
        return self.columns[role]


def header_names(head: bytes, part: TextPart) -> list[str]:
    """The column names in the first lines of a file; none where it has no header."""
    lines = head_text(head).split("\n")
    return cells(lines[part.skip_lines], part.delimiter) if part.header and len(lines) > part.skip_lines else []


def read_table(path: Path, part: TextPart, wanted: Mapping[str, Column]) -> Table:
    """Read the `wanted` columns (role -> name or place) of a table.

    Raises:
        InputError: a column is not there, stands twice or is named twice; a cell is no number; a row is too short or
            too long; an infinity; no rows. With the line.
    """
    where, content = str(path), read_lines_as_bytes(path)
    if part.delimiter == " ":
        content = re.sub(rb"[ \t]+", b" ", re.sub(rb"(?m)^[ \t]+|[ \t]+$", b"", content))
    if b"\n " in content:
        content = re.sub(rb"(?m)^ +$", b"", content)
    lines = content.split(b"\n", part.skip_lines + 1)
    header = (
        cells(decoded(lines[part.skip_lines]), part.delimiter) if part.header and len(lines) > part.skip_lines else []
    )
    skipped = part.skip_lines + bool(part.header)
    rest = content.split(b"\n", skipped)
    body = rest[skipped].rstrip(b"\n") if len(rest) > skipped else b""
    if not body.strip():
        raise InputError(where, f"expected rows of numbers after line {skipped}, found none")
    line, after_blank = _rows(body, skipped)
    count = len(header) or len(cells(decoded(body.lstrip(b"\n").split(b"\n", 1)[0]), part.delimiter))
    places = {role: _place(column, header, count, where) for role, column in wanted.items()}
    columns = _parsed(body, part, places, count, where, skipped)
    names = {role: repr(header[at]) if header else str(at) for role, at in places.items()}
    table = Table(where, columns, names, line, after_blank)
    for role, values in columns.items():
        wild = np.flatnonzero(np.isinf(values))
        if len(wild):
            raise InputError(f"{where}: line {line[wild[0]]}", f"column {names[role]}: expected a finite number")
    return table


def _rows(body: bytes, skipped: int) -> tuple[Int, Bool]:
    """Line numbers of the rows that are not blank, and before which of them a blank line stands."""
    ends = np.append(np.flatnonzero(np.frombuffer(body, np.uint8) == 10), len(body))
    lengths = np.diff(ends, prepend=-1) - 1
    index = np.flatnonzero(lengths > 0)
    return index + skipped + 1, np.diff(index, prepend=-1) > 1


def _place(column: Column, header: list[str], count: int, where: str) -> int:
    """Where a column stands, from 0."""
    if isinstance(column, int):
        if column >= count:
            raise InputError(where, f"expected a column {column} (counted from 0), found {count} columns")
        return column
    found = [i for i, name in enumerate(header) if name == column]
    if len(found) != 1:
        what = "stands twice in the header" if found else f"no such column{nearest(column, [n for n in header if n])}"
        raise InputError(f"{where}: column {column!r}", what)
    return found[0]


def _parsed(
    body: bytes, part: TextPart, places: Mapping[str, int], count: int, where: str, skipped: int
) -> dict[str, Float]:
    """The columns by pyarrow's reader, which holds a table of 50 million rows."""
    import pyarrow as pa
    from pyarrow import csv as arrow_csv

    names = [str(i) for i in range(count)]
    used = sorted(set(places.values()))
    try:
        table = arrow_csv.read_csv(
            pa.BufferReader(body),
            read_options=arrow_csv.ReadOptions(column_names=names, block_size=2**24),
            parse_options=arrow_csv.ParseOptions(delimiter=part.delimiter),
            convert_options=arrow_csv.ConvertOptions(
                column_types={str(i): pa.float64() for i in used},
                include_columns=[str(i) for i in used],
                null_values=EMPTY,
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
            if text not in EMPTY and not _reads(text, part.decimal):
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
