"""Tables in text files: the columns that a mapping names, as numbers, each row with its line."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from workbench.errors import InputError, nearest
from workbench.importing.columns import parsed
from workbench.importing.mapping_tables import Column, TextPart
from workbench.importing.text import HEAD_BYTES, INK, cells, head_text, numbered, read_lines_as_bytes
from workbench.units import Bool, Float, Int

SLAB_BYTES = 2**25


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
    where, content = str(path), _plain_blanks(read_lines_as_bytes(path), part)
    header = header_names(content[:HEAD_BYTES], part)
    skipped = part.skip_lines + bool(part.header)
    start = _offset(content, skipped)
    if INK.search(content, start) is None:
        raise InputError(where, f"expected rows of numbers after line {skipped}, found none")
    first_row = next(line for number, line in numbered(content[start : start + HEAD_BYTES]))
    count = len(header) or len(cells(first_row, part.delimiter))
    places = _places(wanted, header, count, where)
    names = {role: repr(header[at]) if header else str(at) for role, at in places.items()}
    slabs, lines = [], skipped
    for begin, end in _slabs(content, start):
        body = content[begin:end]
        slabs.append((parsed(body, part, places, count, where, lines), *_rows(body, lines)))
        lines += body.count(b"\n")
    columns = {role: np.concatenate([slab[0].pop(role) for slab in slabs]) for role in places}
    line = np.concatenate([slab[1] for slab in slabs])
    table = Table(where, columns, names, line, np.concatenate([slab[2] for slab in slabs]))
    for role, values in columns.items():
        if np.isinf(values).any():
            row = line[np.flatnonzero(np.isinf(values))[0]]
            raise InputError(f"{where}: line {row}", f"column {names[role]}: expected a finite number")
    return table


def _plain_blanks(content: bytes, part: TextPart) -> bytes:
    """Lines of white space are empty lines; where white space separates, it is one blank."""
    if part.delimiter == " ":
        return re.sub(rb"[ \t]+", b" ", re.sub(rb"(?m)^[ \t]+|[ \t]+$", b"", content))
    return re.sub(rb"(?m)^ +$", b"", content) if b"\n " in content else content


def _offset(content: bytes, lines: int) -> int:
    """Where the text after some lines begins."""
    offset = 0
    for _ in range(lines):
        offset = content.find(b"\n", offset) + 1
        if offset == 0:
            return len(content)
    return offset


def _slabs(content: bytes, start: int) -> Iterator[tuple[int, int]]:
    """Stretches of lines, each ending in a row, so that a large file is not held several times over."""
    end = len(content)
    while content[end - 1 : end] == b"\n":
        end -= 1
    while start < end:
        cut = content.find(b"\n", start + SLAB_BYTES, end)
        while cut >= 0 and content[cut - 1 : cut] == b"\n":  # a blank line: it belongs to the row after it
            cut = content.find(b"\n", cut + 1, end)
        stop = cut + 1 if cut >= 0 else end
        yield start, stop
        start = stop


def _rows(body: bytes, skipped: int) -> tuple[Int, Bool]:
    """Line numbers of the rows that are not blank, and before which of them a blank line stands."""
    ends = np.append(np.flatnonzero(np.frombuffer(body, np.uint8) == 10), len(body))
    lengths = np.diff(ends, prepend=-1) - 1
    index = np.flatnonzero(lengths > 0)
    return index + skipped + 1, np.diff(index, prepend=-1) > 1


def _places(wanted: Mapping[str, Column], header: list[str], count: int, where: str) -> dict[str, int]:
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
        raise InputError(where, "; ".join(dict.fromkeys(wrong)))
    return places
