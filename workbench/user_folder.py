"""The folder in which the program keeps what is quicker to read than to make: kernels, the list of stages.

All in it can be made again; who deletes it loses a minute. What was made with other sources is known by their digest.
"""

from __future__ import annotations

import contextlib
import functools
import hashlib
import os
import stat
import tempfile
import time
from importlib.util import find_spec
from pathlib import Path

with contextlib.suppress(ImportError):  # not everywhere
    import fcntl

KEPT_DAYS = 60  # after which what nobody has made again goes
LONGEST_S = 60.0  # that another process is waited for


class UserFolder:
    """The first that can be used: below `NUMBA_CACHE_DIR`, the user's cache folder, a temporary one; or none."""

    def __init__(self) -> None:
        self.refused: list[str] = []
        own = f"workbench-{os.getuid() if hasattr(os, 'getuid') else ''}"
        named = os.environ.get("NUMBA_CACHE_DIR")
        temporary = tempfile.gettempdir()  # Python falls back on the working directory, which is no place for this
        instead = None if os.path.samefile(temporary, ".") else Path(temporary, own)
        candidates = [Path(named, own) if named else None, _user_cache(), instead]
        self.path = next((path for place in candidates if place and (path := self._usable(place))), None)

    def note(self) -> str:
        """Where it is, if not where it belongs; else ''."""
        if not self.refused:
            return ""
        kept = f"kept in {self.path}" if self.path else "not kept"
        return f"{kept}: {'; '.join(self.refused)} (NUMBA_CACHE_DIR names another folder)"

    def _usable(self, path: Path) -> Path | None:
        """The folder, if it is `own`."""
        try:
            own(path)
        except (OSError, RuntimeError) as error:
            self.refused.append(f"{path} cannot be used ({getattr(error, 'strerror', None) or error})")
            return None
        return path


def own(path: Path) -> None:
    """Make the folder, or raise OSError where this user may not write it or somebody else may: what is kept is run."""
    path.mkdir(parents=True, exist_ok=True, mode=0o700)
    status = path.stat()
    if hasattr(os, "getuid") and (status.st_uid != os.getuid() or status.st_mode & (stat.S_IWGRP | stat.S_IWOTH)):
        raise PermissionError(0, "others may write it: expected a folder that you alone may write")
    tempfile.TemporaryFile(dir=path).close()


def _user_cache() -> Path | None:
    """By the XDG rules; a home that cannot be written is found out when the folder is made."""
    home = os.environ.get("XDG_CACHE_HOME") or os.path.join(os.path.expanduser("~"), ".cache")
    return Path(home, "workbench", "kept") if os.path.isabs(home) else None  # an unknown user has no home


@functools.cache
def folder() -> UserFolder:
    """This process's folder, looked for once."""
    return UserFolder()


def keep(path: Path, *parts: bytes | memoryview) -> None:
    """Write a file of a folder as a whole; one that has become full or read-only costs the next process time only."""
    with contextlib.suppress(OSError):
        descriptor, written = tempfile.mkstemp(dir=path.parent, prefix=".writing-")
        try:
            with open(descriptor, "wb") as file:
                file.writelines(parts)
            os.replace(written, path)
        except OSError:
            os.unlink(written)


@functools.cache
def _turns() -> int:
    """A file of which a byte stands for whatever is being made; OSError: there is none."""
    place = folder().path
    if place is None:
        raise FileNotFoundError
    return os.open(place / "turns", os.O_RDWR | os.O_CREAT, 0o600)


def take_turn(name: str) -> bool:
    """Whether it is this process's to make `name`, until `end_turn` or its own end: what another makes is waited for.

    False where that takes too long, or files cannot be locked: then both make it.
    """
    until = time.monotonic() + LONGEST_S
    with contextlib.suppress(OSError, NameError):
        while time.monotonic() < until:
            with contextlib.suppress(BlockingIOError):
                fcntl.lockf(_turns(), fcntl.LOCK_EX | fcntl.LOCK_NB, 1, _byte(name))
                return True
            time.sleep(0.02)
    return False


def end_turn(name: str) -> None:
    """The next may make `name`."""
    with contextlib.suppress(OSError, NameError):
        fcntl.lockf(_turns(), fcntl.LOCK_UN, 1, _byte(name))


def _byte(name: str) -> int:
    return int.from_bytes(hashlib.sha256(name.encode()).digest()[:6], "big")


def forget(pattern: str, where: Path | None = None, days: int = KEPT_DAYS) -> None:
    """Remove the files of a pattern that were not touched for long, and what killed processes have left."""
    where, oldest = where or folder().path, time.time() - days * 86400
    for path in [*where.glob(pattern), *where.glob(".writing-*")] if where else ():
        with contextlib.suppress(OSError):
            if path.stat().st_mtime < oldest:
                path.unlink()


SOURCES = (".py", ".j2", ".css", ".js")  # what a package's behaviour is written in


@functools.cache
def package_digest(name: str) -> str:
    """Of a package's source files, by name and content."""
    spec = find_spec(name)
    places = [Path(place) for place in (spec.submodule_search_locations or ())] if spec else []
    files = sorted((path for place in places for path in place.rglob("*") if path.suffix in SOURCES), key=str)
    if spec and spec.origin and not places:
        files, places = [Path(spec.origin)], [Path(spec.origin).parent]
    digest = hashlib.sha256()
    for path in files:
        digest.update(f"{path.relative_to(next(p for p in places if p in path.parents))}\n".encode())
        digest.update(path.read_bytes())
    return digest.hexdigest()
