"""One writer at a time: an advisory lock, which ends with the process that holds it, however that ends."""

from __future__ import annotations

import fcntl
import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path


class BusyError(Exception):
    """Somebody else holds the lock."""


@contextmanager
def locked(path: Path) -> Iterator[None]:
    """Hold the lock on a directory, or on the file `path`, made for it and removed after it.

    Where the file system knows no locks (some network shares) nothing guards: better than no run.

    Raises:
        BusyError: it is held, also by this process.
        OSError: the file cannot be made.
    """
    descriptor = _open_and_lock(path)
    try:
        yield
    finally:
        if not path.is_dir():
            with suppress(OSError):
                os.unlink(path)
        os.close(descriptor)


def clear_lock(path: Path) -> None:
    """Remove the lock file of a process that was killed; one that is held stays."""
    with suppress(OSError, BusyError):
        if path.is_file():
            with locked(path):
                pass


def _open_and_lock(path: Path) -> int:
    while True:
        flags = os.O_RDONLY if path.is_dir() else os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW
        descriptor = os.open(path, flags, 0o666)
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            os.close(descriptor)
            raise BusyError(str(path)) from None
        except OSError:
            return descriptor
        with suppress(FileNotFoundError):  # its last holder may have removed it between opening and locking
            if os.path.samestat(os.stat(path), os.fstat(descriptor)):
                return descriptor
        os.close(descriptor)
