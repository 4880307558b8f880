"""A new set of files changes places with an old one: a run killed at any moment leaves what the next can finish.

The new set stands complete in a staged directory. Names of both sets are written there first; then the old files go
out, then the new ones come in. No rename is lost: the next run continues where a killed one stopped.
"""

from __future__ import annotations

import glob
import json
import os
import shutil
from contextlib import suppress
from pathlib import Path

from workbench.pipeline.results import is_plain_name

OLD = ".old"
MOVING = ".moving"  # in a staged set: it is complete, and its files are changing places


def staged_prefix(target: Path) -> str:
    """How names of staged directories for `target` begin."""
    return f".{target.name}.partial-"


def exchange(staged: Path, target: Path, old: list[str], new: list[str]) -> None:
    """Files `old` of `target` into `staged`, files `new` the other way, in order; OSError: all is as before."""
    (staged / MOVING).write_text(json.dumps({"old": old, "new": new}))
    try:
        _change_places(staged, target, old, new)
    except OSError:
        _put_back(staged, target, old, new)
        _moved(staged)
        raise
    _moved(staged)


def clear_killed_runs(target: Path, *, beside: bool = True) -> None:
    """What killed runs left: a set that was changing places goes all the way, others were never complete.

    `beside`: a run may have begun before `target` was there, so the folder above is looked through as well.
    """
    for place in (target, target.parent) if beside else (target,):
        for staged in place.glob(f"{glob.escape(staged_prefix(target))}*"):
            with suppress(FileNotFoundError, ValueError):  # ValueError: killed before the first file moved
                _change_places(staged, target, *_names(staged))
                _moved(staged)
            shutil.rmtree(staged, ignore_errors=True)


def _names(staged: Path) -> tuple[list[str], list[str]]:
    """Old and new ones; FileNotFoundError if nothing was moving, ValueError for what no run wrote."""
    moving = json.loads((staged / MOVING).read_text())
    if not isinstance(moving, dict) or moving.keys() != {"old", "new"}:
        raise ValueError(MOVING)
    old, new = ([name for name in moving[key] if is_plain_name(name)] for key in ("old", "new"))
    return old, new


def _change_places(staged: Path, target: Path, old: list[str], new: list[str]) -> None:
    for name in old:
        if not (staged / f"{name}{OLD}").exists():
            os.rename(target / name, staged / f"{name}{OLD}")
    for name in new:
        if (staged / name).exists():
            os.rename(staged / name, target / name)


def _moved(staged: Path) -> None:
    """The staged directory goes now; the next run must not take what is left of it for a set on its way."""
    (staged / MOVING).unlink()


def _put_back(staged: Path, target: Path, old: list[str], new: list[str]) -> None:
    for name in (name for name in new if not (staged / name).exists()):
        os.rename(target / name, staged / name)
    for name in (name for name in old if (staged / f"{name}{OLD}").exists()):
        os.rename(staged / f"{name}{OLD}", target / name)
