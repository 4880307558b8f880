"""What a file system may have in store: a file that is none, a disk without room, text as people write it."""

from __future__ import annotations

import csv
import errno
import glob
import hashlib
import io
import math
import os
import re
import shutil
import stat
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from workbench.errors import InputError, OutputError, nearest

MEGABYTE = 1e6
MOST_BYTES = 2**28  # of a table of numbers
SPARE_BYTES = 1_000_000  # for headers and tables beside the grids


def require_space(path: Path, grid_bytes: int) -> None:
    """Refuse to write `grid_bytes` to the file `path` where its disk has not that much left, uncompressed.

    Raises:
        OSError: too little room; or the folder does not exist.
    """
    needed = grid_bytes + SPARE_BYTES
    free = shutil.disk_usage(path.parent).free
    if free < needed:
        found = f"expected {needed / MEGABYTE:.0f} MB of free disk, found {free / MEGABYTE:.0f} MB"
        raise OSError(errno.ENOSPC, found)


@contextmanager
def new_hdf5(path: Path, grid_bytes: int) -> Iterator[Any]:
    """A new HDF5 file at `path` to fill; room for `grid_bytes` is taken on the disk before HDF5 writes a byte.

    HDF5 (2.0) ends the process where a write fails while a file is closed, so it writes to a file that never fails it.

    Raises:
        OSError: too little room; or what the first failed write met, once HDF5 has let go of the file.
    """
    import h5py

    require_space(path, grid_bytes)
    with path.open("w+b", buffering=0) as file:
        _take_room(file.fileno(), grid_bytes + SPARE_BYTES)
        disk = Unfailing(file)
        with h5py.File(disk, "w") as made:
            yield made
        disk.finish()


def _take_room(descriptor: int, size: int) -> None:
    """Have the file system set `size` bytes aside, where it can."""
    if not hasattr(os, "posix_fallocate"):
        return
    try:
        os.posix_fallocate(descriptor, 0, size)
    except OSError as error:
        if error.errno not in (errno.EOPNOTSUPP, errno.EINVAL, errno.ENOSYS):
            raise


class Unfailing:
    """A file to write for a library that cannot bear a failing one: after the first failure it drops what it is given.

    Args:
        file: unbuffered, open for writing and reading. Its size may be larger than what is written.
    """

    def __init__(self, file: Any) -> None:
        self._file = file
        self._place = self._end = 0
        self._failed: OSError | None = None

    def seek(self, offset: int, whence: int = os.SEEK_SET) -> int:
        """Go to a place; the end is that of what was written."""
        self._place = offset + {os.SEEK_SET: 0, os.SEEK_CUR: self._place, os.SEEK_END: self._end}[whence]
        return self._place

    def tell(self) -> int:
        """The place."""
        return self._place

    def write(self, data: Any) -> int:
        """Write all of `data`, or remember why not."""
        left = memoryview(data).cast("B")
        size = len(left)
        try:
            self._file.seek(self._place)
            while self._failed is None and left:
                left = left[self._file.write(left) :]
        except OSError as error:
            self._failed = error
        self._place += size
        self._end = max(self._end, self._place)
        return size

    def readinto(self, buffer: Any) -> int:
        """What stands there; zeros where nothing could be written."""
        whole = memoryview(buffer).cast("B")
        whole[:] = bytes(len(whole))
        with suppress(OSError):
            self._file.seek(self._place)
            self._file.readinto(whole)
        self._place += len(whole)
        return len(whole)

    read = None  # h5py asks for its name alone, and reads by readinto

    def truncate(self, size: int) -> int:
        """Let the file end at `size` once it is finished."""
        self._end = size
        return size

    def flush(self) -> None:
        """Nothing is held back."""

    def finish(self) -> None:
        """Cut off the room that was not needed.

        Raises:
            OSError: what the first failed write met.
        """
        if self._failed is not None:
            raise self._failed
        self._file.truncate(self._end)


def regular_file(path: Path) -> os.stat_result:
    """The file's status; refuses what is not there, not a file (a pipe would hang) or not readable."""
    try:
        status = os.stat(path)
    except FileNotFoundError:
        readable = path.parent.is_dir() and os.access(path.parent, os.R_OK)
        siblings = [Path(one) for one in os.listdir(path.parent)] if readable else []
        alike = [one.name for one in siblings if path.stem == one.stem or path.suffix == one.suffix != ""]
        raise InputError(str(path), f"no such file{nearest(path.name, alike)}") from None
    except (OSError, ValueError) as error:
        raise InputError(str(path), f"cannot be opened: {getattr(error, 'strerror', None) or error}") from None
    if not stat.S_ISREG(status.st_mode):
        raise InputError(str(path), "expected a file, not a directory or a device")
    if not os.access(path, os.R_OK):
        raise InputError(str(path), "may not be read: permission denied")
    if not status.st_size:
        raise InputError(str(path), "is empty: was it exported, or copied, to its end?")
    return status


def digest_of(path: Path) -> str:
    """SHA-256 of a file's bytes, in hexadecimal digits."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def partial_path(path: Path) -> Path:
    """A name to write to before it is renamed to `path`; what killed processes left under such names is removed."""
    start = f".{path.name}.partial-"
    with suppress(OSError):
        for left in path.parent.glob(f"{glob.escape(start)}*"):
            if not _lives(left.name.removeprefix(start)):
                left.unlink(missing_ok=True)
    return path.with_name(f"{start}{os.getpid()}")


def _lives(process: str) -> bool:
    """Whether there is a process of this number; what is no number was not written here."""
    if not process.isdecimal():
        return True
    try:
        os.kill(int(process), 0)
    except ProcessLookupError:
        return False
    except (OSError, OverflowError):
        return True
    return True


STARTS_A_FORMULA = ("=", "+", "-", "@", "\t", "\r", "\n")


def read_text(path: Path, max_bytes: int) -> str:
    """The text of a file.

    Raises:
        InputError: no such file, no file at all, too large, not UTF-8 (with the byte).
    """
    if regular_file(path).st_size > max_bytes:
        raise InputError(str(path), f"expected at most {max_bytes} bytes")
    try:
        return path.read_bytes().decode("utf-8-sig")
    except OSError as error:
        raise InputError(str(path), f"cannot be read: {error.strerror}") from None
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: byte {error.start}", f"expected text in UTF-8{encoding_slip(error)}") from None


def encoding_slip(error: UnicodeDecodeError) -> str:
    """What a file most likely is that is no text in UTF-8."""
    if error.object[:2] in (b"\xff\xfe", b"\xfe\xff"):
        return ", found UTF-16: save it as UTF-8"
    return ": a binary file?" if b"\0" in error.object else ": saved in another encoding, such as Latin-1?"


def write_whole(path: Path, content: bytes) -> None:
    """Write a file that is never seen half-written. Raises OutputError."""
    part = partial_path(path)
    try:
        try:
            part.write_bytes(content)
            os.replace(part, path)
        finally:
            part.unlink(missing_ok=True)
    except OSError as error:
        raise OutputError(str(path), f"cannot be written: {error.strerror}") from None


def csv_bytes(rows: Iterable[Mapping[str, object]], names: Sequence[str]) -> bytes:
    """A table (RFC 4180: commas, lines end in CR LF) in UTF-8, texts as `as_text`; what a row lacks is empty."""
    out = io.StringIO(newline="")
    table = csv.DictWriter(out, names, restval="")
    table.writeheader()
    table.writerows({name: as_text(value) for name, value in row.items()} for row in rows)
    return out.getvalue().encode()


def numbered_lines(text: str) -> list[tuple[int, str]]:
    """Lines with their numbers from 1; empty ones and comments (#) left out."""
    return [(k, line) for k, line in enumerate(text.splitlines(), 1) if line.strip() and line.lstrip()[0] != "#"]


def csv_table(
    path: Path, max_bytes: int, known: Sequence[str] = (), needed: Sequence[str] = ()
) -> tuple[list[str], list[int], list[list[str]]]:
    """Column names of a CSV, and of each row behind them its line, from 1, and its cells; # begins a comment.

    Raises:
        InputError: unreadable, no table, cells parted by other than commas, a column that is `needed` missing, one
            twice or none of the `known`, a row of other length; with the line.
    """
    lines = numbered_lines(read_text(path, max_bytes))
    try:
        table = [[cell.strip() for cell in next(csv.reader([line], strict=True))] for _, line in lines]
    except csv.Error as error:
        raise InputError(str(path), f"expected a table of comma-separated values: {error}") from None
    numbers = [number for number, _ in lines]
    header = next(iter(table), [])
    _check_header(path, header, needed)
    for name in header:
        if header.count(name) > 1:
            raise InputError(f"{path}: line {numbers[0]}", f"'{name}': occurs twice")
        if known and name not in known:
            raise InputError(f"{path}: line {numbers[0]}", f"'{name}': unknown column{nearest(name, known)}")
    for number, row in zip(numbers, table, strict=True):
        if len(row) != len(header):
            raise InputError(f"{path}: line {number}", f"expected {len(header)} cells, found {len(row)}")
    return header, numbers[1:], table[1:]


def _check_header(path: Path, header: list[str], needed: Sequence[str]) -> None:
    if len(header) == 1 and (other := re.search(r"[;\t]", header[0])):
        what = f"expected cells parted by commas, decimals by points, found {other[0]!r}"
        raise InputError(f"{path}: header", what)
    if needed and not header:
        raise InputError(str(path), f"expected a header with the columns {', '.join(needed)}")
    for name in (one for one in needed if one not in header):
        raise InputError(f"{path}: header", f"expected the column '{name}'")


def csv_rows(path: Path, max_bytes: int, known: Sequence[str] = ()) -> list[tuple[str, dict[str, str]]]:
    """Of each row of a `csv_table` its place, for messages, and its filled cells by column."""
    header, numbers, table = csv_table(path, max_bytes, known)
    return [(f"{path}: line {number}", _filled(header, row)) for number, row in zip(numbers, table, strict=True)]


def _filled(header: list[str], row: list[str]) -> dict[str, str]:
    return {name: cell for name, cell in zip(header, row, strict=True) if cell}


def finite_number(text: str, where: str) -> float:
    """The number in a cell. Raises InputError at `where` for what is none, or infinite."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value) or "_" in text:
        raise InputError(where, f"expected a finite number, found '{text[:40]}'")
    return value


def as_text(value: object) -> object:
    """`value`; a text without control characters, which a terminal would obey.

    One that a spreadsheet would run as a formula gets an apostrophe before it (OWASP, CSV injection).
    """
    if not isinstance(value, str):
        return value
    shown = "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in value)
    return f"'{shown}" if value.startswith(STARTS_A_FORMULA) else shown
