"""Files on this machine or behind an fsspec URL: recordings to read, folders of results to write.

Credentials come from the environment alone; no message shows them.
"""

from __future__ import annotations

import os
import re
import shutil
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager, nullcontext
from pathlib import Path
from typing import Any, Protocol

from workbench.errors import InputError, OutputError, WorkbenchError
from workbench.pipeline.output import OutputDirectory
from workbench.pipeline.results import RUN_FILE, is_plain_name

LOCAL = "file://"
EXTRAS = {"s3": "s3"}  # by protocol: the extra that brings its client
SECRETS = ("AWS_SECRET_ACCESS_KEY", "AWS_SESSION_TOKEN", "AWS_ACCESS_KEY_ID")
TOKENS = ("ETag", "etag", "md5Hash", "content_md5", "mtime", "LastModified", "created")  # what tells versions apart


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
        self._results = OutputDirectory(path)

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
        with _remote(self.url, InputError) as (files, path):
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
        import json

        run = self.read(RUN_FILE)
        self._remove(marker)
        for name in {*filter(is_plain_name, json.loads(run).get("files", []) if run else []), RUN_FILE}:
            self._remove(name)
        self._write(marker, content)

    def _write(self, name: str, content: bytes) -> None:
        with _remote(self.url, OutputError) as (files, path):
            files.pipe_file(f"{path}/{name}", content)

    def _remove(self, name: str) -> None:
        with _remote(self.url, OutputError) as (files, path):
            if files.exists(f"{path}/{name}"):
                files.rm_file(f"{path}/{name}")


def folder(place: str) -> Folder:
    """The folder at a path or URL; it need not exist."""
    return RemoteFolder(place) if is_remote(place) else LocalFolder(Path(local_path(place)))


def is_remote(place: str) -> bool:
    """Whether it is a URL, and not of this machine's files."""
    return re.match(r"[A-Za-z][A-Za-z0-9+.-]*://", place) is not None and not place.startswith(LOCAL)


def local_path(place: str) -> str:
    """A path or file:// URL as a path."""
    return place.removeprefix(LOCAL)


def joined(place: str, name: str) -> str:
    """`name` in a folder."""
    return f"{place.rstrip('/')}/{name}" if is_remote(place) else str(Path(local_path(place)) / name)


def listed(url: str, suffix: str) -> list[str]:
    """The files that a URL stands for: itself, those its wildcards match, or those with `suffix` in its folder."""
    if not (url.endswith("/") or set("*?[") & set(url)):
        return [url]
    with _remote(url, InputError) as (files, path):
        pattern = path if set("*?[") & set(url) else f"{path.rstrip('/')}/*{suffix}"
        found = [str(files.unstrip_protocol(one)) for one in files.glob(pattern)]
    if not found:
        raise InputError(url, "expected recordings there, found none")
    return found


def version_token(url: str) -> str | None:
    """What the store says of a file's version (an ETag or a time, and the size); None: nothing.

    Raises InputError: there is no such file, or the store does not answer.
    """
    with _remote(url, InputError) as (files, path):
        known = files.info(path)
    token = next((f"{key} {known[key]}" for key in TOKENS if known.get(key)), None)
    return token and f"{token} {known.get('size')}"


@contextmanager
def copied(url: str, cache: Path | None) -> Iterator[Path]:
    """A copy of a file, whole; kept in `cache` by URL and version, or dropped afterwards where that is None."""
    import hashlib

    with tempfile.TemporaryDirectory(prefix="workbench-") as made:
        key = hashlib.sha256(f"{url}\n{version_token(url)}".encode()).hexdigest()[:32]
        place = (cache or Path(made)) / key / (re.split(r"[/\\]", url.rstrip("/"))[-1] or "recording")
        if not place.exists():
            place.parent.mkdir(parents=True, exist_ok=True)
            partial = Path(tempfile.mkdtemp(prefix="partial-", dir=place.parent)) / place.name
            try:
                with _remote(url, InputError) as (files, path):
                    files.get_file(path, str(partial))
                os.replace(partial, place)
            finally:
                shutil.rmtree(partial.parent, ignore_errors=True)
        yield place


def write_whole(path: Path, content: bytes) -> None:
    """A file that is never seen half-written. Raises OutputError."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, beside = tempfile.mkstemp(prefix=f".{path.name}.partial-", dir=path.parent)
        try:
            with os.fdopen(handle, "wb") as file:
                file.write(content)
            os.chmod(beside, 0o644)
            os.replace(beside, path)
        except BaseException:
            Path(beside).unlink(missing_ok=True)
            raise
    except OSError as error:
        raise OutputError(str(path), f"cannot be written: {error.strerror}") from None


def write_file(place: str, name: str, content: bytes) -> None:
    """One file into a folder at a path or URL, whole."""
    if not is_remote(place):
        write_whole(Path(local_path(place)) / name, content)
        return
    with _remote(place, OutputError) as (files, path):
        files.pipe_file(f"{path.rstrip('/')}/{name}", content)


@contextmanager
def _remote(url: str, error: type[WorkbenchError]) -> Iterator[tuple[Any, str]]:
    """The file system behind a URL and the path in it; whatever goes wrong there is one line."""
    import fsspec

    protocol, _, rest = url.partition("://")
    if "@" in rest.partition("/")[0]:
        raise error(f"{protocol}://...", "expected a URL without user and password: those come from the environment")
    try:
        yield fsspec.core.url_to_fs(url)
    except WorkbenchError:
        raise
    except ImportError:
        extra = f": install workbench[{EXTRAS[protocol]}]" if protocol in EXTRAS else ""
        raise error(url, f"needs a client for {protocol}:// that is not installed{extra}") from None
    except FileNotFoundError:
        raise error(url, "no such file") from None
    except Exception as cause:
        raise error(url, f"the store answers: {type(cause).__name__}: {without_secrets(str(cause))}") from None


def without_secrets(text: str) -> str:
    """`text` with the values of credentials in the environment struck out."""
    for value in filter(None, map(os.environ.get, SECRETS)):
        text = text.replace(value, "***")
    return text
