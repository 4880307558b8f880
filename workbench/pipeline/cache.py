"""What stages made, kept: what rests on nothing that changed is not computed again.

A stage's result is found by the digest of the code of its package and of this one, the versions of the libraries, its
parameters, and the digests of what it takes. What reads files or asks for the run's provenance is always run; the
digest of its result stands for it. An entry whose content is not what was written is made anew. What a result holds of
the results that its stage takes (a decision holds its path) is kept by number: read back, it is the same object again.
"""

from __future__ import annotations

import hashlib
import io
import json
import os
import pickle
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any, TypeAlias

from workbench.artefacts import Provenance
from workbench.errors import OutputError
from workbench.pipeline.wiring import Step
from workbench.user_folder import forget, keep, own, package_digest

Made: TypeAlias = tuple[tuple[Any, ...], list[str]]  # artefacts and warnings of a stage

QUICK_S = 0.05  # what takes less is not kept: reading it back takes as long
KEPT_DAYS = 30  # since an entry was last used
SUFFIX = ".stage"
DIGEST = hashlib.sha256().digest_size  # an entry begins with that of the rest


class StageCache:
    """The entries in one folder, for one run."""

    def __init__(self, folder: Path, versions: Mapping[str, str]) -> None:
        """`versions`: of the libraries that results rest on. Raises OutputError: the folder cannot be used."""
        self.folder, self._versions = folder, dict(versions)
        self._known: dict[str, str | None] = {}  # by step: what stands for its result
        self._made: dict[str, tuple[Any, ...]] = {}  # by step: its artefacts
        try:
            own(folder)
        except (OSError, ValueError) as error:
            why = getattr(error, "strerror", None) or error
            raise OutputError(f"--cache {folder}", f"cannot be used: {why}") from None
        forget(f"*{SUFFIX}", self.folder, KEPT_DAYS)

    def made(self, step: Step, run: Callable[[], Made]) -> Made:
        """What the step makes, out of the cache or by `run`."""
        key, taken = self._key(step), [one for ids in step.sources.values() for k in ids for one in self._made[k]]
        found = self._load(key, taken) if key else None
        if found is None:
            start = time.perf_counter()
            found = run()
            slow = time.perf_counter() - start > QUICK_S
            if key is None:
                digest = hashlib.sha256()
                key = digest.hexdigest() if _pickled(found, (), digest.update) else None  # by all that it holds
            elif slow and _pickled(found, taken, (content := io.BytesIO()).write):
                keep(self.folder / f"{key}{SUFFIX}", hashlib.sha256(content.getbuffer()).digest(), content.getbuffer())
        self._known[step.id], self._made[step.id] = key, found[0]
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

    def _load(self, key: str, taken: Sequence[Any]) -> Made | None:
        path = self.folder / f"{key}{SUFFIX}"
        try:
            content = memoryview(path.read_bytes())
            if hashlib.sha256(content[DIGEST:]).digest() != content[:DIGEST]:  # cut short, or not what was written
                return None
            reader = pickle.Unpickler(io.BytesIO(content[DIGEST:]))
            reader.persistent_load = taken.__getitem__  # type: ignore[method-assign]
            made: Made = reader.load()
            os.utime(path)
            return made
        except OSError:  # not there
            return None


def _pickled(made: Made, taken: Sequence[Any], write: Callable[[Any], object]) -> bool:
    """Write a stage's result piece by piece, arrays as they lie, of what it has taken the numbers.

    False: it holds what only this process knows.
    """
    numbers = {id(one): number for number, one in enumerate(taken)}
    writer = pickle.Pickler(SimpleNamespace(write=write), pickle.HIGHEST_PROTOCOL)
    writer.persistent_id = lambda part: numbers.get(id(part))  # type: ignore[method-assign]
    try:
        writer.dump(made)
    except (pickle.PicklingError, TypeError, AttributeError, RecursionError):
        return False
    return True
