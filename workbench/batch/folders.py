"""The folder of one part's results, on this machine or in a store: a whole set of results or none."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager, nullcontext
from pathlib import Path
from typing import Protocol

from workbench.batch.store import is_remote, local_path, remote, write_whole
from workbench.errors import InputError, OutputError
from workbench.pipeline.output import OutputDirectory
from workbench.pipeline.results import RUN_FILE, is_plain_name


class Folder(Protocol):
    """The folder of one part's results."""

    def reserved(self) -> AbstractContextManager[None]:
        """For the length of a run: it takes files, and nobody else writes there."""

    def read(self, name: str) -> bytes | None:
        """A file's content; None: there is none."""

    def publish(self, files: Mapping[str, bytes], marker: str) -> None:
        """Write the files as the folder's one set of results; without `marker`, which comes last, it is none."""

    def withdraw(self, marker: str, content: bytes) -> None:
        """No earlier result may stand for a run that failed; `marker` says why."""


class LocalFolder:
    """On this machine: files change places by renaming."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._results = OutputDirectory(path, exists=True)

    @contextmanager
    def reserved(self) -> Iterator[None]:
        """As Folder; the lock is on the folder itself, so that a process that dies leaves none behind."""
        try:
            self.path.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise OutputError(str(self.path), f"cannot be written: {error.strerror}") from None
        with self._results.reserved():
            yield

    def read(self, name: str) -> bytes | None:
        """As Folder."""
        try:
            return (self.path / name).read_bytes()
        except OSError:
            return None

    def publish(self, files: Mapping[str, bytes], marker: str) -> None:
        """As Folder; the marker lists what belongs together, so it may come with the rest."""
        self._results.publish(files)

    def withdraw(self, marker: str, content: bytes) -> None:
        """As Folder: results move into `superseded/`."""
        self._results.supersede()
        write_whole(self.path / marker, content)


class RemoteFolder:
    """Behind a URL: a store of objects, each written whole."""

    def __init__(self, url: str) -> None:
        self.url = url.rstrip("/")

    def reserved(self) -> AbstractContextManager[None]:
        """As Folder: a store of objects has no lock; who writes the same part writes the same bytes."""
        return nullcontext()

    def read(self, name: str) -> bytes | None:
        """As Folder."""
        with remote(self.url, InputError) as (files, path):
            try:
                return bytes(files.cat_file(f"{path}/{name}"))
            except FileNotFoundError:
                return None

    def publish(self, files: Mapping[str, bytes], marker: str) -> None:
        """As Folder."""
        self._remove(marker)
        for name in sorted(files, key=lambda name: (name == marker, name == RUN_FILE)):
            self._write(name, files[name])

    def withdraw(self, marker: str, content: bytes) -> None:
        """As Folder: results are removed."""
        run = self.read(RUN_FILE)
        self._remove(marker)
        for name in {*filter(is_plain_name, json.loads(run).get("files", []) if run else []), RUN_FILE}:
            self._remove(name)
        self._write(marker, content)

    def _write(self, name: str, content: bytes) -> None:
        with remote(self.url, OutputError) as (files, path):
            files.pipe_file(f"{path}/{name}", content)

    def _remove(self, name: str) -> None:
        with remote(self.url, OutputError) as (files, path):
            if files.exists(f"{path}/{name}"):
                files.rm_file(f"{path}/{name}")


def folder(place: str) -> Folder:
    """The folder at a path or URL; it need not exist."""
    return RemoteFolder(place) if is_remote(place) else LocalFolder(Path(local_path(place)))
