"""Text files as people write them: UTF-8, of a bounded size, with comments; and text that spreadsheets open."""

from __future__ import annotations

from pathlib import Path

from workbench.errors import InputError
from workbench.storage import regular_file

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
