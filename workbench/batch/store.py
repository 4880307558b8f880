"""Files on this machine or behind an fsspec URL: reading, copying, writing whole.

Credentials come from the environment alone; no message shows them.
"""

from __future__ import annotations

import os
import re
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from workbench import storage
from workbench.errors import InputError, OutputError, WorkbenchError
from workbench.extras import not_installed

LOCAL = "file://"
SCHEMES = ("abfs", "gs", "http", "https", "memory", "s3", "sftp")  # what fsspec opens beyond these is another matter
CLIENTS = {"s3": "s3fs"}  # by protocol
SECRETS = ("AWS_SECRET_ACCESS_KEY", "AWS_SESSION_TOKEN", "AWS_ACCESS_KEY_ID")
TOKENS = ("ETag", "etag", "md5Hash", "content_md5", "mtime", "LastModified", "created")  # what tells versions apart


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
    with remote(url, InputError) as (files, path):
        pattern = path if set("*?[") & set(url) else f"{path.rstrip('/')}/*{suffix}"
        found = [str(files.unstrip_protocol(one)) for one in files.glob(pattern)]
    if not found:
        raise InputError(url, "expected recordings there, found none")
    return found


def version_token(url: str) -> str | None:
    """What the store says of a file's version (an ETag or a time, and the size); None: nothing.

    Raises InputError: there is no such file, or the store does not answer.
    """
    with remote(url, InputError) as (files, path):
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
                with remote(url, InputError) as (files, path):
                    files.get_file(path, str(partial))
                os.replace(partial, place)
            finally:
                shutil.rmtree(partial.parent, ignore_errors=True)
        yield place


def write_whole(path: Path, content: bytes) -> None:
    """A file that is never seen half-written, its folder made first. Raises OutputError."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(str(path), f"cannot be written: {error.strerror}") from None
    storage.write_whole(path, content)


def write_file(place: str, name: str, content: bytes) -> None:
    """One file into a folder at a path or URL, whole."""
    if not is_remote(place):
        write_whole(Path(local_path(place)) / name, content)
        return
    with remote(place, OutputError) as (files, path):
        files.pipe_file(f"{path.rstrip('/')}/{name}", content)


@contextmanager
def remote(url: str, error: type[WorkbenchError]) -> Iterator[tuple[Any, str]]:
    """The file system behind a URL and the path in it; whatever goes wrong there is one line."""
    import fsspec

    protocol = refuse_credentials(url)
    try:
        files, path = fsspec.core.url_to_fs(url)
        files.invalidate_cache()  # others write there too
        yield files, path
    except WorkbenchError:
        raise
    except ImportError:
        missing = not_installed(CLIENTS.get(protocol, ""))
        client = f" {missing.expected}" if missing else " that is not installed"
        raise error(url, f"needs a client for {protocol}://{client}") from None
    except FileNotFoundError:
        raise error(url, "no such file") from None
    except Exception as cause:
        raise error(url, f"the store answers: {type(cause).__name__}: {without_secrets(str(cause))}") from None


def refuse_credentials(url: str) -> str:
    """The protocol of a URL. Raises InputError for others than `SCHEMES`, and, without showing it, for a named user."""
    protocol, _, rest = url.partition("://")
    if protocol.lower() not in SCHEMES:  # chained ones (zip::, simplecache::) and those that run or list things too
        known = ", ".join(f"{scheme}://" for scheme in SCHEMES)
        raise InputError(f"{protocol[:40]}://...", f"expected a path or a URL of {known}")
    if "@" in rest.partition("/")[0]:
        raise InputError(
            f"{protocol}://...", "expected a URL without user and password: those come from the environment"
        )
    return protocol


def without_secrets(text: str) -> str:
    """`text` with the values of credentials in the environment struck out."""
    for value in filter(None, map(os.environ.get, SECRETS)):
        text = text.replace(value, "***")
    return text
