"""The SHA-256 of a run's inputs, taken in a thread while the stages work: hashing can take longer than reading."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from threading import Event

from workbench.errors import InputError
from workbench.pipeline.wiring import InputRecord

BLOCK_BYTES = 2**20
Fingerprint = tuple[int, int, int]  # what changes when a file is written to or replaced


class Digests:
    """The digests of a run's input files, each to come."""

    def __init__(self, started: dict[InputRecord, tuple[Fingerprint, Future[str]]]) -> None:
        self._started = started

    def all(self) -> list[tuple[str, str, str]]:
        """Name, path as given and SHA-256 of every file, once; waits until all are known.

        Raises InputError for a file that is not what it was when the run started.
        """
        found = []
        for record, (before, digest) in self._started.items():
            found.append((record.name, record.given, digest.result()))
            if _fingerprint(record) != before:
                raise InputError(record.given, "changed while the pipeline ran")
        return list(dict.fromkeys(found))


@contextmanager
def digesting(records: Iterable[InputRecord]) -> Iterator[Digests]:
    """Start hashing files; whoever leaves early, with an error, need not wait for the rest."""
    stop = Event()
    pool = ThreadPoolExecutor(max_workers=1)
    try:
        yield Digests({record: (_fingerprint(record), pool.submit(_sha256, record, stop)) for record in records})
    finally:
        stop.set()
        pool.shutdown(cancel_futures=True)


def _sha256(record: InputRecord, stop: Event) -> str:
    digest, buffer = hashlib.sha256(), bytearray(BLOCK_BYTES)
    with _readable(record), record.path.open("rb", buffering=0) as file:
        while not stop.is_set() and (count := file.readinto(buffer)):
            digest.update(memoryview(buffer)[:count])
    return digest.hexdigest()


def _fingerprint(record: InputRecord) -> Fingerprint:
    """What changes when the file is written to or replaced."""
    with _readable(record):
        status = os.stat(record.path)
    return status.st_ino, status.st_size, status.st_mtime_ns


@contextmanager
def _readable(record: InputRecord) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise InputError(record.given, f"cannot be read any more: {error.strerror}") from None
