"""Times in a file of their own: for the frames, or for the poses, of another source."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from workbench.errors import InputError
from workbench.importing.mapping import Mapping, claims
from workbench.importing.mapping_parts import TIME_S
from workbench.importing.neutral import Imported
from workbench.importing.text import read_table

NAME = "table of times (by the mapping)"


def recognises(path: Path, head: bytes, mapping: Mapping) -> bool:
    """Whether the mapping names the file."""
    return claims(mapping.stamps, path)


def read(path: Path, mapping: Mapping) -> Imported:
    """The times, in s."""
    part = mapping.stamps
    assert part is not None
    table = read_table(path, part, {"time": part.column})
    note = f"times of the {part.of}: column {table.names['time']}, in {part.time_unit}"
    return Imported(stamps_s=table.present("time") * TIME_S[part.time_unit], notes=(note,))


def stamped(sources: Sequence[Imported], mapping: Mapping) -> list[Imported]:
    """The sources, times of their own file put where they belong.

    Raises:
        InputError: no source, or several, of that many rows without times.
    """
    given = [one for one in sources if one.stamps_s is not None]
    if not given:
        return list(sources)
    assert mapping.stamps is not None
    what = mapping.stamps.of
    for one in given:
        assert one.stamps_s is not None
        count = len(one.stamps_s)
        fits = [k for k, other in enumerate(sources) if _rows(other, what) == count]
        if len(fits) != 1:
            rows = ", ".join(str(_rows(other, what)) for other in sources if getattr(other, what) is not None) or "none"
            raise InputError("stamps", f"{count} times: expected {what} of as many rows without times, found {rows}")
        held = getattr(sources[fits[0]], what)
        filled = replace(sources[fits[0]], **{what: replace(held, time_s=one.stamps_s)})
        sources = [filled if k == fits[0] else other for k, other in enumerate(sources)]
    return [one for one in sources if one.stamps_s is None]


def _rows(source: Imported, what: str) -> int:
    """Frames or poses of a source that have no times; -1 where it has none of them."""
    held = getattr(source, what)
    if held is None or held.time_s is not None:
        return -1
    return len(held.z_mm if what == "profiles" else held.position_mm)
