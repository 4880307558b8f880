"""What a file system may have in store: a file that is none, a disk without room, text as people write it.

HDF5 may end the process when a disk fills up under it, so room is asked for before writing.
"""

from __future__ import annotations

import glob
import os
import shutil
import stat
from contextlib import suppress
from pathlib import Path

from workbench.errors import InputError, OutputError, nearest

MEGABYTE = 1e6
SPARE_BYTES = 1_000_000  # for headers and tables beside the grids


def require_space(path: Path, grid_bytes: int) -> None:
    """Refuse to write `grid_bytes` to the file `path` where its disk has not that much left, uncompressed.

    Raises:
        OutputError: too little room; or the folder does not exist.
    """
    needed = grid_bytes + SPARE_BYTES
    try:
        free = shutil.disk_usage(path.parent).free
    except OSError as error:
        raise OutputError(str(path), f"cannot be written: {error.strerror}") from None
    if free < needed:
        raise OutputError(
            str(path), f"expected {needed / MEGABYTE:.0f} MB of free disk, found {free / MEGABYTE:.0f} MB"
        )


def regular_file(path: Path) -> os.stat_result:
    """The file's status; refuses what is not there, not a file (a pipe would hang) or not readable."""
    try:
        status = os.stat(path)
    except FileNotFoundError:
        readable = path.parent.is_dir() and os.access(path.parent, os.R_OK)
        siblings = os.listdir(path.parent) if readable else ()
        raise InputError(str(path), f"no such file{nearest(path.name, siblings)}") from None
    except (OSError, ValueError) as error:
        raise InputError(str(path), f"cannot be opened: {getattr(error, 'strerror', None) or error}") from None
    if not stat.S_ISREG(status.st_mode):
        raise InputError(str(path), "expected a file, not a directory or a device")
    if not os.access(path, os.R_OK):
        raise InputError(str(path), "may not be read: permission denied")
    return status


def beside(path: Path) -> Path:
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
        raise InputError(f"{path}: byte {error.start}", "expected text in UTF-8") from None


def numbered_lines(text: str) -> list[tuple[int, str]]:
    """Lines with their numbers from 1; empty ones and comments (#) left out."""
    return [(k, line) for k, line in enumerate(text.splitlines(), 1) if line.strip() and line.lstrip()[0] != "#"]


def as_text(value: object) -> object:
    """`value`; a text that a spreadsheet would run as a formula gets an apostrophe before it (OWASP, CSV injection)."""
    return f"'{value}" if isinstance(value, str) and value.startswith(STARTS_A_FORMULA) else value
