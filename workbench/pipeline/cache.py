"""A cache of what stages made: what rests on nothing that changed is not computed again.

A stage's result is found by the digest of the code of its package and of this one, the versions of the libraries, its
parameters, and the digests of what it takes. What reads files or asks for the run's provenance is always run; the
digest of its result stands for it. An entry whose content is not what was written is made anew.
"""

from __future__ import annotations

import hashlib
import json
import os
import pickle
import stat
import tempfile
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any, TypeAlias

from workbench.artefacts import Provenance
from workbench.errors import OutputError
from workbench.pipeline.wiring import Step
from workbench.user_folder import package_digest

Made: TypeAlias = tuple[tuple[Any, ...], list[str]]  # artefacts and warnings of a stage

QUICK_S = 0.05  # what takes less is not kept: reading it back takes as long
KEPT_DAYS = 30  # since an entry was last used
SUFFIX = ".stage"


class StageCache:
    """The entries in one folder, for one run."""

    def __init__(self, folder: Path, versions: Mapping[str, str]) -> None:
        """`versions`: of the libraries that results rest on. Raises OutputError: the folder cannot be used."""
        self.folder, self._versions = folder, dict(versions)
        self._known: dict[str, str | None] = {}  # by step: what stands for its result
        try:
            folder.mkdir(parents=True, exist_ok=True, mode=0o700)
            status = folder.stat()
            tempfile.TemporaryFile(dir=folder).close()
        except (OSError, ValueError) as error:
            why = getattr(error, "strerror", None) or error
            raise OutputError(f"--cache {folder}", f"cannot be written: {why}") from None
        if hasattr(os, "getuid") and (status.st_uid != os.getuid() or status.st_mode & (stat.S_IWGRP | stat.S_IWOTH)):
            raise OutputError(
                f"--cache {folder}", "expected a folder that you alone may write: its entries are trusted"
            )
        self._forget()

    def made(self, step: Step, run: Callable[[], Made]) -> Made:
        """What the step makes, out of the cache or by `run`."""
        key = self._key(step)
        found = self._load(key) if key else None
        if found is None:
            start = time.perf_counter()
            found = run()
            slow = time.perf_counter() - start > QUICK_S
            packed = _packed(found) if slow or key is None else None
            if key is None and packed:
                key = _digest(packed)
            elif key and packed:
                self._keep(key, packed)
        self._known[step.id] = key
        return found

    def _key(self, step: Step) -> str | None:
        """None: it has to be run."""
        from pydantic_core import to_jsonable_python

        taken = [self._known[one] for ids in step.sources.values() for one in ids]
        if step.files or None in taken or any(issubclass(one.type, Provenance) for one in step.stage.sources):
            return None
        packages = {step.stage.function.__module__.partition(".")[0], "workbench"}
        code = [(name, package_digest(name)) for name in sorted(packages)]
        sources = {name: [self._known[one] for one in ids] for name, ids in step.sources.items()}
        rests_on = [self._versions, code, step.stage.name, sources, to_jsonable_python(dict(step.parameters))]
        return hashlib.sha256(json.dumps(rests_on, sort_keys=True).encode()).hexdigest()

    def _load(self, key: str) -> Made | None:
        path = self.folder / f"{key}{SUFFIX}"
        try:
            content = memoryview(path.read_bytes())
            digest, sizes, body = _parts(content)
            if hashlib.sha256(content[32:]).digest() != digest:
                return None
            buffers, at = [], sizes[0]
            for size in sizes[1:]:
                buffers.append(body[at : at + size])
                at += size
            made: Made = pickle.loads(body[: sizes[0]], buffers=buffers)
            os.utime(path)
            return made
        except (OSError, ValueError, IndexError):  # not there, or cut short
            return None

    def _keep(self, key: str, packed: list[bytes | memoryview]) -> None:
        sizes = json.dumps([len(part) for part in packed]).encode() + b"\n"
        digest = hashlib.sha256(sizes)
        for part in packed:
            digest.update(part)
        with suppress(OSError):  # a full disk costs the next run time, no more
            descriptor, written = tempfile.mkstemp(dir=self.folder, prefix=".writing-")
            try:
                with open(descriptor, "wb") as file:
                    for part in (digest.digest(), sizes, *packed):
                        file.write(part)
                os.replace(written, self.folder / f"{key}{SUFFIX}")
            except OSError:
                os.unlink(written)

    def _forget(self) -> None:
        """Remove what was not used for long, and what killed runs left."""
        oldest = time.time() - KEPT_DAYS * 86400
        for path in [*self.folder.glob(f"*{SUFFIX}"), *self.folder.glob(".writing-*")]:
            with suppress(OSError):
                if path.stat().st_mtime < oldest:
                    path.unlink()


def _packed(made: Made) -> list[bytes | memoryview] | None:
    """A stage's result as bytes, large arrays by themselves; None: it holds what only this process knows."""
    buffers: list[pickle.PickleBuffer] = []
    try:
        head = pickle.dumps(made, protocol=5, buffer_callback=buffers.append)
    except (pickle.PicklingError, TypeError, AttributeError, RecursionError):
        return None
    return [head, *(buffer.raw() for buffer in buffers)]


def _digest(packed: list[bytes | memoryview]) -> str:
    digest = hashlib.sha256()
    for part in packed:
        digest.update(part)
    return digest.hexdigest()


def _parts(content: memoryview) -> tuple[bytes, list[int], memoryview]:
    """Digest, sizes of the parts, and the parts. Raises ValueError for what is no entry."""
    end = bytes(content[32:100_000]).index(b"\n") + 32
    return bytes(content[:32]), json.loads(bytes(content[32:end])), content[end + 1 :]
