"""Text files of numbers: decoding, lines, columns by a mapping; how an unknown table is written.

A file is read in stretches of lines, so that no more of it is held than the numbers that are wanted.
"""

from __future__ import annotations

import codecs
import csv
import io
import itertools
import json
import math
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple, NoReturn, TypeVar

import numpy as np

from workbench.errors import InputError, nearest
from workbench.extras import Extra
from workbench.geometry.poses import USUAL_ANGLE_UNIT
from workbench.importing.mapping_parts import LENGTH_MM, TIME_S, UNITS, TextPart, TimeUnit, named_twice
from workbench.storage import regular_file
from workbench.units import Bool, Float, Int, Shaped

MAX_BYTES = 8_000_000_000  # 50,000 frames of 3,200 points in text
HEAD_BYTES = 65_536
SLAB_BYTES = 2**22  # what a processor keeps at hand; larger ones take a sixth longer
LONGEST = 2**26  # characters of a line
BOMS = {codecs.BOM_UTF8: "utf-8-sig", codecs.BOM_UTF16_LE: "utf-16", codecs.BOM_UTF16_BE: "utf-16"}


def _western(error: UnicodeError) -> tuple[str, int]:
    """Bytes that are no UTF-8 are taken as Windows Western (units like µm)."""
    if not isinstance(error, UnicodeDecodeError) or error.encoding != "utf-8":
        raise error
    return error.object[error.start : error.end].decode("cp1252", errors="replace"), error.end


codecs.register_error("windows-western", _western)


def _decoded(stream: BinaryIO, head: bytes, cut: bool = False) -> io.TextIOWrapper:
    """The stream's text with plain line ends, by the mark that `head` begins with; `cut`: it may end in a character."""
    marked = next((name for mark, name in BOMS.items() if head.startswith(mark)), None)
    return io.TextIOWrapper(stream, marked or "utf-8", "replace" if marked and cut else "windows-western")


def read_text(path: Path) -> str:
    """The whole text of a file; errors as `stretches`."""
    return "".join(stretches(path, SLAB_BYTES, SLAB_BYTES))


def stretches(path: Path, size: int, first: int) -> Iterator[str]:
    """A file's text in stretches of whole lines, each of `size` characters and more, the first one of `first`.

    Each ends in a line with ink: blank lines belong to the row after them.

    Raises:
        InputError: no such file, larger than MAX_BYTES, empty, or not text.
    """
    if (found := regular_file(path).st_size) > MAX_BYTES:
        raise InputError(str(path), f"expected a text file of at most {MAX_BYTES / 1e9:g} GB, found {found / 1e9:.1f}")
    inked, line = False, 1
    try:
        with open(path, "rb") as file, _decoded(file, first_bytes(path)) as text:
            while part := text.read(size if inked else max(size, first)):
                while more := text.readline(LONGEST):
                    part += more
                    if len(more) == LONGEST:
                        raise InputError(str(path), "expected lines of text, found one without end")
                    if not more.isspace():
                        break
                if (zero := part.find("\0")) >= 0:
                    where = f"{path}: line {line + part.count(chr(10), 0, zero)}"
                    raise InputError(where, "expected text, found a zero byte")
                line += part.count("\n")
                if not part.isspace():
                    inked = True
                    yield part
    except UnicodeError as error:
        raise InputError(str(path), f"expected text in UTF-16 as its mark says: {error}") from None
    except OSError as error:
        raise InputError(str(path), f"cannot be read: {error.strerror}") from None
    if not inked:
        raise InputError(str(path), "is empty")


def first_bytes(path: Path) -> bytes:
    """Enough of a file to tell what it is."""
    with open(path, "rb") as file:
        return file.read(HEAD_BYTES)


def head_text(head: bytes) -> str:
    """Text of a file's first bytes, which may end within a character; what cannot be decoded is replaced."""
    with _decoded(io.BytesIO(head), head, cut=True) as text:
        return text.read()


def cells(line: str, delimiter: str) -> list[str]:
    """The cells of a line, stripped; a blank delimiter stands for any white space."""
    parts = line.split() if delimiter == " " else line.split(delimiter)
    return [part.strip().strip('"').strip() for part in parts]


NO_VALUE = ("", "nan", "NaN", "NAN", "INVALID")  # cells that hold none: INVALID is what laser trackers write


def number(text: str, decimal: str = ".") -> float | None:
    """A cell's number, NaN where it holds none (NO_VALUE); None for what is no number with that decimal mark."""
    if text in NO_VALUE:
        return math.nan
    if "_" in text or (decimal == "," and "." in text):
        return None
    try:
        return float(text.replace(",", ".") if decimal == "," else text)
    except ValueError:
        return None


def numbers(row: Sequence[str], where: str, decimal: str = ".") -> Float:
    """The cells of a row as finite numbers; a cell without one (NO_VALUE) is NaN.

    Raises:
        InputError: at `where`, with the cell's place and what stands there.
    """
    values = [number(text, decimal) for text in row]
    for k, value in enumerate(values):
        if value is None:
            raise _no_number(row[k], decimal, where, k)
        if math.isinf(value):
            raise InputError(f"{where}, cell {k + 1}", f"expected a finite number, found {_shown(row[k])}")
    return np.array(values, float)


def _no_number(text: str, decimal: str, where: str, cell: int) -> InputError:
    what = f"expected a number with decimal mark '{decimal}', found {_shown(text)}"
    return InputError(f"{where}, cell {cell + 1}", what)


def numbered(text: str) -> Iterator[tuple[int, str]]:
    """The lines that are not blank, with their numbers from 1."""
    return ((k, line) for k, line in enumerate(text.split("\n"), 1) if line.strip())


def _shown(text: str) -> str:
    return repr(text if len(text) <= 30 else text[:27] + "...")


SAMPLE_BYTES = 2**22  # enough for some frames of a wide table
MOST_ROWS = 20_000
FEWEST_ROWS = 2
WAYS = (("\t", "."), ("\t", ","), (";", "."), (";", ","), (",", "."), (" ", "."), (" ", ","))


class Form(NamedTuple):
    """A table's form, and its first rows."""

    delimiter: str
    decimal: str
    skip_lines: int  # before the header, or before the numbers
    header: tuple[str, ...]  # () where there is none
    units: tuple[str, ...]  # of a row below it, '' where it has none; () where there is no such row
    rows: Shaped[Float, "r c"]  # NaN where a cell is empty
    after_blank: Shaped[Bool, " r"]  # a blank line stands before the row
    whole: bool  # the sample is the whole file

    def as_part(self) -> dict[str, object]:
        """What a mapping says of it; what it takes for granted is left out."""
        form = {
            "delimiter": self.delimiter,
            "decimal": self.decimal,
            "skip_lines": self.skip_lines,
            "header": bool(self.header),
        }
        usual = {"delimiter": ",", "decimal": ".", "skip_lines": 0, "header": True}
        return {key: value for key, value in form.items() if value != usual[key]}


def form_of(path: Path) -> Form | None:
    """How a file is written, if it is a table of numbers; None of what is no text."""
    with open(path, "rb") as file:
        content = file.read(SAMPLE_BYTES)
    binary = b"\0" in content[:4096] and not content.startswith(tuple(BOMS))
    return None if binary else sniffed(content, len(content) < SAMPLE_BYTES)


def sniffed(content: bytes, whole: bool) -> Form | None:
    """The form under which most of a table's first bytes are numbers; None where none gives rows of numbers."""
    lines = head_text(content).split("\n")[: None if whole else -1][: MOST_ROWS + 1000]
    found = [form for way in WAYS if (form := _under(lines, *way, whole)) is not None]
    return max(found, key=lambda form: (form.rows.size, -WAYS.index((form.delimiter, form.decimal))), default=None)


def _under(lines: list[str], delimiter: str, decimal: str, whole: bool) -> Form | None:
    """The longest run of rows of equally many numbers (blank lines between them allowed), read in one way."""
    rows = [(number, _numbers(line, delimiter, decimal)) for number, line in enumerate(lines) if line.strip()]
    count = first = at = 0
    for width, group in itertools.groupby(rows, key=lambda row: len(row[1])):
        run = len(list(group))
        if width and run > count:
            count, first = run, at
        at += run
    last = first + count
    above = [row for row in rows[:first] if 2 * len(row[1]) > len(rows[first][1])]  # of numbers too, but uneven
    if count < FEWEST_ROWS or count < 0.5 * (len(rows) - first) or len(above) > 1:
        return None
    table = np.array([row[1] for row in rows[first:last]], float)
    if not np.isfinite(table).any() or table.shape[1] < 2:
        return None
    header, units, top = _header(rows, lines, first, table, delimiter)
    if top == first + 1:  # the first row of numbers is a header that counts the columns
        first, table = top, table[1:]
    places = [row[0] for row in rows[first:last]]
    blank = np.diff(places, prepend=places[0] - 1) > 1
    return Form(delimiter, decimal, rows[top - 1][0] if header else places[0], header, units, table, blank, whole)


def why_no_table(head: bytes) -> str:
    """What keeps a text that is mostly numbers from being a table, by its last whole line; '' where it is none."""
    lines = dict(list(numbered(head_text(head)))[:-1])
    at, line = max(lines.items(), default=(0, ""))
    way = max(WAYS, key=lambda one: sum(number(cell, one[1]) is not None for cell in cells(line, one[0])))
    words = [cell for cell in cells(line, way[0]) if number(cell, way[1]) is None]
    count = len(_numbers(line, *way))
    if words:
        return f"line {at}: {_shown(words[0])} is no number" if len(cells(line, way[0])) > 2 * len(words) else ""
    other = next((k for k, text in lines.items() if len(_numbers(text, *way)) not in (0, count)), at)
    uneven = "a row of ranges has a cell for each column, empty where nothing returned"
    return "" if other == at else f"line {other} has another number of cells than line {at} with {count}: {uneven}"


def _header(
    rows: list[tuple[int, list[float]]], lines: list[str], first: int, table: Float, delimiter: str
) -> tuple[tuple[str, ...], tuple[str, ...], int]:
    """The column names, the units in a row below them, and the index of the row after the names."""
    counts = np.arange(table.shape[1])
    if (
        len(table) > FEWEST_ROWS
        and any((table[0] == counts + k).all() for k in (0, 1))
        and (table[1] != table[0]).any()
    ):
        return tuple(cells(lines[rows[first][0]], delimiter)), (), first + 1
    if first and rows[first - 1][0] == rows[first][0] - 1:
        names = cells(lines[rows[first - 1][0]], delimiter)
        units = units_of(names)
        if units and first > 1:
            above, _, top = _header(rows, lines, first - 1, table, delimiter)
            return above, units, top
        if len(names) == table.shape[1] and sum(bool(name) for name in names) >= len(names) - 1:
            return tuple(names), (), first
    return (), (), first


def units_of(row: Sequence[str]) -> tuple[str, ...]:
    """The units in a row of units, '' where a cell holds none; () of any other row."""
    found = [cell.strip("[]()").strip().lower() for cell in row]
    of_units = all(cell in UNITS or cell in ("", "-") for cell in found) and any(cell in UNITS for cell in found)
    return tuple(UNITS.get(cell, "") for cell in found) if of_units else ()


def _numbers(line: str, delimiter: str, decimal: str) -> list[float]:
    """The cells as numbers, NaN for empty ones; none where one is no number, or all are empty."""
    values = [number(text, decimal) for text in cells(line, delimiter)]
    known = [value for value in values if value is not None]
    return known if len(known) == len(values) and not all(map(math.isnan, known)) else []


def steady(values: Float) -> bool:
    """Whether a column only changes from block to block: a frame's number or time."""
    if not np.isfinite(values).all() or len(values) < 4:
        return False
    runs = [len(list(group)) for _, group in itertools.groupby(values.tolist())]
    return len(runs) < len(values) / 3 and len(set(values.tolist())) >= len(runs) * 0.9


DELIMITERS = {",": "','", ";": "';'", "\t": "tabs", " ": "blanks"}
P = TypeVar("P", bound=TextPart)


class Table(NamedTuple):
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

    def place(self, row: int) -> str:
        """What to call a row, from 0, in messages."""
        return f"{self.where}: line {self.line[row]}"

    def present(self, role: str) -> Float:
        """A column without empty cells; InputError naming the line of the first one."""
        gap = np.isnan(self.columns[role])
        if gap.any():
            raise InputError(self.place(int(gap.argmax())), f"column {self.names[role]}: no number")
        return self.columns[role]

    def all_of(self, role: str, count: int) -> Float:
        """Columns (R, n) of a role that has several, as present."""
        return np.stack([self.present(f"{role} {k}") for k in range(count)], axis=1)

    def whole(self, role: str) -> Int | None:
        """A column of whole numbers, None where there is none; InputError naming the line of the first that is none."""
        if role not in self.columns:
            return None
        return self.within(role, self.present(role), -(2**31), 2**31 - 1).astype(np.int64)

    def within(self, role: str, values: Float, least: int, most: int) -> Float:
        """Values (R,) of a column, all of them whole and in range; InputError naming the line of the first other."""
        wrong = np.flatnonzero((values != np.round(values)) | (values < least) | (values > most))
        if len(wrong):
            what = f"expected a whole number from {least} to {most}, found {values[wrong[0]]:g}"
            raise InputError(self.place(int(wrong[0])), f"column {self.names[role]}: {what}")
        return values

    def times(self, unit: TimeUnit | None) -> Float | None:
        """The column of times, in s; None where there is none."""
        return self.present("time") * TIME_S[unit or "s"] if "time" in self.columns else None


def header_names(head: bytes, part: TextPart, delimiter: str = "") -> list[str]:
    """The column names in the first lines of a file, by the part's delimiter or another; none without a header."""
    lines = head_text(head).split("\n")
    there = part.header and len(lines) > part.skip_lines
    return cells(lines[part.skip_lines], delimiter or part.delimiter) if there else []


def recognised(part: TextPart | None, path: Path, head: bytes) -> bool:
    """Whether the mapping's part names the file or, without a pattern, all of its columns stand in the header."""
    if part is None or part.files is not None:
        return part is not None and part.claims(path)
    return bool(part.wanted) and set(part.wanted.values()) <= set(header_names(head, part))


def part_of(part: P | None, known: Mapping[tuple[str, ...], P], path: Path, head: bytes) -> P | None:
    """What tells how a table is written: the mapping's part, or its header where that leaves no doubt."""
    if recognised(part, path, head):
        return part
    names = tuple(header_names(head, TextPart(length_unit="mm")))
    return known.get(names) if part is None or part.files is not None else None


def otherwise_separated(head: bytes, part: TextPart) -> str:
    """What to say where another delimiter than the part's gives all of its columns; '' where none does."""
    form = sniffed(head, len(head) < HEAD_BYTES)
    columns = part.wanted.values()
    names = {one for one in columns if isinstance(one, str)}
    last = max((one for one in columns if isinstance(one, int)), default=-1)
    titles = {mark: header_names(head, part, mark) for mark in DELIMITERS}
    fits = [mark for mark, found in titles.items() if names and names <= set(found) and last < len(found)]
    if form is not None and last < form.rows.shape[1] and names <= set(form.header):
        fits = [form.delimiter]
    if not fits or part.delimiter in fits:
        return ""
    key = f'"delimiter": {json.dumps(fits[0])} in the mapping'
    return f"the columns are separated by {DELIMITERS[fits[0]]}, not by {DELIMITERS[part.delimiter]}: expected {key}"


def read_table(path: Path, part: TextPart) -> Table:
    """The columns of a whole table; errors as `slabs`."""
    found = list(slabs(path, part))
    columns = {role: np.concatenate([slab.columns[role] for slab in found]) for role in found[0].columns}
    line, blank = (np.concatenate([slab.rows()[k] for slab in found]) for k in (0, 1))
    return Table(str(path), columns, found[0].names, lambda: (line, blank))


def slabs(path: Path, part: TextPart) -> Iterator[Table]:
    """The columns of a table that the part names, all where it names none, stretch by stretch of its rows.

    Raises:
        InputError: a column is not there, stands twice or is named twice; a cell is no number; a row is too short or
            too long; an infinity; no rows. With the line.
    """
    where, lines, count = str(path), part.skip_lines + bool(part.header), 0
    places: dict[str, int] = {}
    names: dict[str, str] = {}
    for text in stretches(path, SLAB_BYTES, HEAD_BYTES):
        body = _plain_blanks(text, part)
        if not count:
            above = body.split("\n", lines + 1)
            units = units_of(cells(above[lines], part.delimiter)) if part.header and len(above) > lines else ()
            lines += bool(units)
            above = body.split("\n", lines)
            body = above[lines] if len(above) > lines else ""
            first_row = body.lstrip("\n").split("\n", 1)[0]
            if not first_row:
                raise InputError(where, f"expected rows of numbers after line {lines}, found none")
            header = cells(above[part.skip_lines], part.delimiter) if part.header else []
            count = len(header) or len(cells(first_row, part.delimiter))
            hint = partial(otherwise_separated, text[:HEAD_BYTES].encode(), part)
            places = _places(part, header, count, where, hint)
            names = {role: repr(header[at]) if header else str(at) for role, at in places.items()}
            _check_units({names[role]: units[at] for role, at in places.items() if at < len(units)}, part, where)
        table = Table(where, _parsed(body, part, places, count, where, lines), names, partial(_rows, body, lines))
        for role, values in table.columns.items():
            if np.isinf(values).any():
                place = table.place(int(np.isinf(values).argmax()))
                raise InputError(place, f"column {names[role]}: expected a finite number")
        yield table
        lines += body.count("\n")


def _check_units(stated: Mapping[str, str], part: TextPart, where: str) -> None:
    """Refuse columns whose unit in a row below the header is another than the mapping's."""
    angle = getattr(part, "angle_unit", None) or USUAL_ANGLE_UNIT.get(getattr(part, "convention", ""))
    for name, unit in stated.items():
        ours = next(
            (one for kind, one in ((LENGTH_MM, part.length_unit), (TIME_S, part.time_unit)) if unit in kind), angle
        )
        if unit and ours and unit != ours:
            raise InputError(
                where, f"column {name}: expected {ours} as the mapping says, found {unit} below the header"
            )


def _plain_blanks(text: str, part: TextPart) -> str:
    """Lines of white space are empty lines; where white space separates, it is one blank."""
    if part.delimiter == " ":
        return re.sub(r"[ \t]+", " ", re.sub(r"(?m)^[ \t]+|[ \t]+$", "", text))
    return re.sub(r"(?m)^ +$", "", text) if " " in text and "\n " in text else text


def _rows(body: str, skipped: int) -> tuple[Int, Bool]:
    """Line numbers of the rows that are not blank, and before which of them a blank line stands."""
    index = np.flatnonzero([bool(line) for line in body.split("\n")])
    return index + skipped + 1, np.diff(index, prepend=-1) > 1


def _places(part: TextPart, header: list[str], count: int, where: str, otherwise: Callable[[], str]) -> dict[str, int]:
    """Where the columns stand, from 0; all that are not there, or stand twice, in one error."""
    places, wrong = {}, []
    for role, column in part.wanted.items():
        found = [i for i, name in enumerate(header) if name == column] if isinstance(column, str) else [column]
        if len(found) == 1 and found[0] < count:
            places[role] = found[0]
        elif isinstance(column, int):
            wrong.append(f"expected a column {column} (counted from 0), found {count} columns")
        elif found:
            wrong.append(f"column {column!r}: occurs twice in the header")
        else:
            wrong.append(f"column {column!r}: no such column{nearest(column, [name for name in header if name])}")
    if wrong:
        raise InputError(where, otherwise() or "; ".join(dict.fromkeys(wrong)))
    if twice := named_twice(places):
        raise InputError(where, twice)
    return places or {str(k): k for k in range(count)}


# Lines of text to columns of numbers: quickly when all is well, slowly to name what is wrong.


def _parsed(
    body: str, part: TextPart, places: Mapping[str, int], count: int, where: str, skipped: int
) -> dict[str, Float]:
    """Columns of numbers (role -> values) out of whole lines, the first after line `skipped`, by pyarrow's reader."""
    pa, arrow_csv = Extra("pyarrow"), Extra("pyarrow.csv")
    names = [str(i) for i in range(count)]
    used = sorted(set(places.values()))
    try:
        table = arrow_csv.read_csv(
            pa.BufferReader(body.encode()),
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


def _refuse(body: str, part: TextPart, used: list[int], count: int, where: str, skipped: int, error: Any) -> NoReturn:
    """The first row that is wrong, looked for slowly."""
    for k, line in enumerate(body.split("\n"), skipped + 1):
        if not line.strip():
            continue
        row = next(csv.reader([line], delimiter=part.delimiter), [])
        if len(row) != count:
            raise InputError(f"{where}: line {k}", f"expected {count} cells, found {len(row)}")
        for i in used:
            if number(row[i].strip(), part.decimal) is None:
                raise _no_number(row[i].strip(), part.decimal, f"{where}: line {k}", i)
    raise InputError(where, f"expected a table of numbers: {str(error)[:120]}")
