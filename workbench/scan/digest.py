"""A file's SHA-256, taken in a thread while the file is read: hashing is slower than reading from a warm cache."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from threading import Event

BLOCK_BYTES = 2**20


@contextmanager
def digesting(path: Path) -> Iterator[Future[str]]:
    """The hexadecimal SHA-256 of the file at `path`, to come; OSError out of its `result()` if it cannot be read."""
    stop = Event()
    with ThreadPoolExecutor(max_workers=1) as pool:
        try:
            yield pool.submit(_sha256, path, stop)
        finally:
            stop.set()  # whoever leaves early, with an error, need not wait for the rest


def _sha256(path: Path, stop: Event) -> str:
    digest, buffer = hashlib.sha256(), bytearray(BLOCK_BYTES)
    with path.open("rb", buffering=0) as file:
        while not stop.is_set() and (count := file.readinto(buffer)):
            digest.update(memoryview(buffer)[:count])
    return digest.hexdigest()
