"""Text files of numbers: decoding, lines, rows that name their line; how an unknown table is written."""

from __future__ import annotations

import codecs
import itertools
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from workbench.errors import InputError
from workbench.storage import regular_file
from workbench.units import Bool, Float, Shaped

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
