"""A file's SHA-256, taken in a thread while the file is read: hashing is slower than reading from a warm cache."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path


@contextmanager
def digesting(path: Path) -> Iterator[Future[str]]:
    """The hexadecimal SHA-256 of the file at `path`, to come; OSError out of its `result()` if it cannot be read."""
    with ThreadPoolExecutor(max_workers=1) as pool:
        yield pool.submit(_sha256, path)


def _sha256(path: Path) -> str:
    with path.open("rb", buffering=0) as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
