"""From what stands on the command line to parts: each recording's place, and the name of the folder of its results."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

from workbench.batch.store import is_remote, listed, local_path, refuse_credentials
from workbench.errors import InputError

LONGEST = 100  # characters of a name; file systems take 255 bytes
TAKEN = ("fleet.html", "fleet.parquet", "superseded")  # what the folder of a batch holds beside its parts
SUFFIX = ".h5"


@dataclass(frozen=True, slots=True)
class Part:
    """One part: `name` is that of its folder, `recording` a path or URL as given."""

    name: str
    recording: str


def parts(recordings: Iterable[str]) -> tuple[Part, ...]:
    """The parts of these recordings, in the order given: that is taken as the order of production.

    A folder stands for the recordings (`.h5`) in it, a URL may hold wildcards: in the order of their names, numbers by
    value.

    Raises:
        InputError: none; one given twice; two whose folders would have the same name.
    """
    found = [Part(safe_name(one), one) for given in recordings for one in _expanded(given)]
    if not found:
        raise InputError("recordings", "expected at least one")
    known: dict[str, Part] = {}
    for part in found:
        key = part.name.casefold()  # some file systems know no case
        if key in known and _same(known[key].recording, part.recording):
            raise InputError(part.recording, "is given twice")
        if key in known:
            raise InputError(
                part.recording,
                f"its results would go into the folder '{part.name}', as those of "
                f"{known[key].recording}: expected file names that differ",
            )
        known[key] = part
    return tuple(found)


def safe_name(recording: str) -> str:
    """The file's name without its ending, as a folder's: letters, digits, '.', '-' and '_'; never hidden or a path."""
    file = PurePosixPath(recording.rstrip("/")).name if is_remote(recording) else Path(local_path(recording)).name
    stem = unicodedata.normalize("NFC", file.removesuffix(SUFFIX))
    name = "".join(c if c.isalnum() or c in "-_." else "_" for c in stem)[:LONGEST].strip(".")
    if not name or name.casefold() in TAKEN:
        raise InputError(recording, "expected a file name that a folder can be called after")
    return name


def _expanded(given: str) -> list[str]:
    """The recordings that one argument stands for."""
    if is_remote(given):
        refuse_credentials(given)
        return sorted(listed(given, SUFFIX), key=by_numbers)
    folder = Path(local_path(given))
    if not folder.is_dir():
        return [given]
    found = sorted((str(path) for path in folder.iterdir() if path.suffix == SUFFIX), key=by_numbers)
    if not found:
        raise InputError(given, f"expected recordings (*{SUFFIX}) in this folder, found none")
    return found


def by_numbers(name: str) -> list[tuple[int, int, str]]:
    """A key that sorts part-2 before part-10."""
    return [(0, int(piece), "") if piece.isdecimal() else (1, 0, piece) for piece in re.split(r"(\d+)", name) if piece]


def _same(one: str, other: str) -> bool:
    if is_remote(one) or is_remote(other):
        return one == other
    return Path(local_path(one)).resolve() == Path(local_path(other)).resolve()
