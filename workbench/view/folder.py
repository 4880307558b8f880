"""What of a directory may be served, and as what: regular files inside it, by plain names."""

from __future__ import annotations

import html
import os
import stat
from pathlib import Path
from typing import BinaryIO
from urllib.parse import quote, unquote

FIRST = ("report.html", "fleet.html")  # what a browser is sent to
TYPES = {
    ".html": "text/html; charset=utf-8",
    ".json": "application/json",
    ".csv": "text/csv; charset=utf-8",
    ".png": "image/png",
    ".svg": "image/svg+xml",
    ".js": "text/javascript; charset=utf-8",
    ".css": "text/css; charset=utf-8",
    **dict.fromkeys((".mod", ".src", ".dat", ".ls", ".txt", ".md", ".dxf"), "text/plain; charset=utf-8"),
}
MOST_NAMES = 10_000  # of a listing


class NotServedError(Exception):
    """No such file inside the directory, or none that may be served."""


def within(root: Path, address: str) -> Path:
    """The file or directory that a path in an address names.

    Args:
        root: the directory that is served, resolved.
        address: percent-encoded, without a leading slash; '' is the directory itself.

    Raises:
        NotServedError: hidden or climbing names, what does not exist, what lies outside of the directory.
    """
    parts = [unquote(part) for part in address.rstrip("/").split("/")] if address.rstrip("/") else []
    if any(not part or part.startswith(".") or set(part) & set("/\\:\0") for part in parts):
        raise NotServedError(address)
    try:
        found = root.joinpath(*parts).resolve(strict=True)
    except (OSError, RuntimeError, ValueError):
        raise NotServedError(address) from None
    if not found.is_relative_to(root):
        raise NotServedError(address)
    return found


def opened(path: Path) -> tuple[BinaryIO, int]:
    """A regular file to read, and its size in bytes. A pipe or a device is not waited for."""
    flags = os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_BINARY", 0)
    try:
        handle = os.open(path, flags)
    except OSError:
        raise NotServedError(str(path)) from None
    state = os.fstat(handle)
    if not stat.S_ISREG(state.st_mode):
        os.close(handle)
        raise NotServedError(str(path))
    return os.fdopen(handle, "rb"), state.st_size


def content_type(path: Path) -> str:
    """What a browser shall take a file for; what it does not know it stores."""
    return TYPES.get(path.suffix.lower(), "application/octet-stream")


def listing(root: Path, folder: Path) -> bytes:
    """A page with links to what may be served of a directory. Names are text only."""
    names = sorted(path.name + "/" * path.is_dir() for path in folder.iterdir() if _shown(root, path))[:MOST_NAMES]
    links = "\n".join(f'<li><a href="{quote(name)}">{html.escape(name)}</a></li>' for name in names)
    title = html.escape(folder.name)
    return (
        f'<!doctype html>\n<html lang="en"><head><meta charset="utf-8"><title>{title}</title></head>\n'
        f"<body><h1>{title}</h1>\n<ul>\n{links}\n</ul></body></html>\n"
    ).encode(errors="backslashreplace")


def _shown(root: Path, path: Path) -> bool:
    try:
        found = within(root, quote(path.relative_to(root).as_posix()))
    except (NotServedError, UnicodeEncodeError):
        return False
    return found.is_dir() or found.is_file()
