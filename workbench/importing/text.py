"""Text files of numbers: decoding, lines, columns by a mapping; how an unknown table is written.

A file is read in stretches of lines, so that no more of it is held than the numbers that are wanted.
"""

from __future__ import annotations

import codecs
import csv
import io
import itertools
import json
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, NoReturn

import numpy as np

from workbench.errors import InputError, nearest
from workbench.extras import Extra
from workbench.importing.mapping_parts import Column, TextPart
from workbench.storage import regular_file
from workbench.units import Bool, Float, Int, Shaped

MAX_BYTES = 8_000_000_000  # 50,000 frames of 3,200 points in text
HEAD_BYTES = 65_536
INK = re.compile(rb"\S")
BOMS = {codecs.BOM_UTF8: "utf-8-sig", codecs.BOM_UTF16_LE: "utf-16", codecs.BOM_UTF16_BE: "utf-16"}


def read_lines_as_bytes(path: Path) -> bytes:
    """The file's text as UTF-8 with plain line ends.

    Raises:
        InputError: no such file, larger than MAX_BYTES, empty, or not text.
    """
    _check_size(path)
    try:
        content = path.read_bytes()
    except OSError as error:
        raise InputError(str(path), f"cannot be read: {error.strerror}") from None
    content = as_utf8(content, str(path))
    if INK.search(content) is None:
        raise InputError(str(path), "is empty")
    if (zero := content.find(b"\0")) >= 0:
        raise InputError(f"{path}: byte {zero}", "expected text, found a zero byte")
    return content


def stretches(path: Path, at_least: int, first: int) -> Iterator[bytes]:
    """The file's text as `read_lines_as_bytes` gives it, in stretches of whole lines, each ending in one that has ink.

    Blank lines belong to the row after them. The first stretch has at least `first` bytes of the file, if there are so
    many; errors as `read_lines_as_bytes`.
    """
    _check_size(path)
    with open(path, "rb") as file:
        head = file.read(max(at_least, first))
        if any(head.startswith(mark) for mark in BOMS) or (b"\r" in head and b"\n" not in head):
            yield read_lines_as_bytes(path).rstrip(b"\n")  # UTF-16, or a carriage return a line: seldom, and not large
            return
        rest, done, inked = head, 0, False
        while rest:
            more = file.read(at_least)
            cut = _last_row_end(rest) if more else len(rest)
            text, rest = rest[:cut], rest[cut:] + more
            if not cut:
                if len(rest) > max(at_least, first) * 64:
                    raise InputError(str(path), "expected lines of text, found one without end")
                continue
            if (zero := text.find(b"\0")) >= 0:
                raise InputError(f"{path}: byte {done + zero}", "expected text, found a zero byte")
            done += len(text)
            text = text.replace(b"\r\n", b"\n").replace(b"\r", b"\n") if b"\r" in text else text
            if INK.search(text) is not None:
                inked = True
                yield text if more else text.rstrip(b"\n")
    if not inked:
        raise InputError(str(path), "is empty")


def _last_row_end(text: bytes) -> int:
    """Just after the line end of the last line with ink that the text holds whole; 0 where there is none."""
    cut = text.rfind(b"\n") + 1
    while cut:
        start = text.rfind(b"\n", 0, cut - 1) + 1
        if text[start:cut].strip():
            return cut
        cut = start
    return 0


def _check_size(path: Path) -> None:
    size = regular_file(path).st_size
    if size > MAX_BYTES:
        raise InputError(str(path), f"expected a text file of at most {MAX_BYTES / 1e9:g} GB, found {size / 1e9:.1f}")


def first_bytes(path: Path) -> bytes:
    """Enough of a file to tell what it is."""
    with open(path, "rb") as file:
        return file.read(HEAD_BYTES)


def as_utf8(content: bytes, where: str) -> bytes:
    """UTF-8 without a mark, plain line ends. Bytes that are no UTF-8 are taken as Windows Western (units like µm)."""
    for mark, encoding in BOMS.items():
        if content.startswith(mark):
            try:
                content = content.decode(encoding).encode()
            except UnicodeError as error:
                place = f"{where}: byte {getattr(error, 'start', 0)}"
                raise InputError(place, f"expected text in {encoding.upper()} as its mark says") from None
    if b"\r" in content:
        content = content.replace(b"\r\n", b"\n").replace(b"\r", b"\n")
    return content


def head_text(head: bytes) -> str:
    """Text of a file's first bytes, which may end within a character; what cannot be decoded is replaced."""
    for mark, encoding in BOMS.items():
        if head.startswith(mark):
            return head.decode(encoding, errors="replace").replace("\r\n", "\n").replace("\r", "\n")
    return decoded(head.replace(b"\r\n", b"\n").replace(b"\r", b"\n"))


def decoded(content: bytes) -> str:
    """Text of UTF-8 bytes, or of Windows Western where they are none."""
    try:
        return content.decode()
    except UnicodeDecodeError:
        return content.decode("cp1252", errors="replace")


def cells(line: str, delimiter: str) -> list[str]:
    """The cells of a line, stripped; a blank delimiter stands for any white space."""
    parts = line.split() if delimiter == " " else line.split(delimiter)
    return [part.strip().strip('"').strip() for part in parts]


NO_VALUE = ("", "nan", "NaN", "NAN", "INVALID")  # cells that hold none: INVALID is what laser trackers write


def numbers(row: Sequence[str], where: str, decimal: str = ".") -> Float:
    """The cells of a row as numbers; a cell without one (NO_VALUE) is NaN.

    Raises:
        InputError: at `where`, with the cell's place and what stands there.
    """
    texts = ["nan" if text in NO_VALUE else text for text in row]
    if decimal == ",":
        if any("." in text for text in texts):
            place = next(i for i, text in enumerate(texts) if "." in text)
            raise InputError(f"{where}, cell {place + 1}", f"expected a decimal comma, found {_shown(texts[place])}")
        texts = [text.replace(",", ".") for text in texts]
    try:
        if any("_" in text for text in texts):
            raise ValueError
        values = np.array(texts).astype(float)
    except ValueError:
        place = next(i for i, text in enumerate(texts) if not is_number(text))
        raise InputError(f"{where}, cell {place + 1}", f"expected a number, found {_shown(row[place])}") from None
    if np.isinf(values).any():
        place = int(np.flatnonzero(np.isinf(values))[0])
        raise InputError(f"{where}, cell {place + 1}", f"expected a finite number, found {_shown(row[place])}")
    return values


def is_number(text: str) -> bool:
    """Whether `text` is a number with a decimal point, or NaN."""
    try:
        float(text)
    except ValueError:
        return False
    return "_" not in text


def numbered(content: bytes) -> Iterator[tuple[int, str]]:
    """The lines that are not blank, with their numbers from 1."""
    for number, line in enumerate(decoded(content).split("\n"), 1):
        if line.strip():
            yield number, line


def _shown(text: str) -> str:
    return repr(text if len(text) <= 30 else text[:27] + "...")


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
            first_row = next((line for _, line in numbered(body[start : start + HEAD_BYTES])), None)
            if first_row is None:
                raise InputError(where, f"expected rows of numbers after line {skipped}, found none")
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
    pa, arrow_csv = Extra("pyarrow"), Extra("pyarrow.csv")
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
                what = f"expected a number with decimal mark '{part.decimal}', found {_shown(text)}"
                raise InputError(f"{where}: line {number}, cell {i + 1}", what)
    raise InputError(where, f"expected a table of numbers: {str(error)[:120]}")


def _reads(text: str, decimal: str) -> bool:
    return (
        is_number(text.replace(",", ".")) if decimal == "," and "." not in text else decimal == "." and is_number(text)
    )
