"""Height grids in text: a corner cell such as `y/x`, x along the first row, y down the first column, z between."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from workbench.errors import InputError
from workbench.importing.mapping import Mapping
from workbench.importing.mapping_parts import LENGTH_MM, TextPart
from workbench.importing.neutral import Imported, ProfileFrames, bounded
from workbench.importing.text import cells, first_bytes, head_text, slabs

NAME = "height grid (y/x)"
CORNER = re.compile(r'^\s*"?\s*y\s*(?:\[(\w+)\])?\s*[/\\|]\s*x\s*(?:\[(\w+)\])?\s*"?\s*([,;\t])', re.IGNORECASE)
MISSING = (-999.999, -999.99, -9999.0, -99999.0)


def recognises(path: Path, head: bytes, mapping: Mapping) -> bool:
    """Whether the first cell is `y/x`, perhaps with units in brackets."""
    return CORNER.match(head_text(head[:4096])) is not None


def read(path: Path, mapping: Mapping) -> Imported:
    """One surface: a row a profile, y the way along the scan.

    Raises:
        InputError: a cell that is no number, rows of unequal length, a coordinate missing.
    """
    where = str(path)
    with open(path, "rb") as file:
        first = head_text(file.readline(2**22) or first_bytes(path)).strip("\r\n")
    found = CORNER.match(first)
    assert found is not None
    unit = found[2] or found[1] or "mm"
    if unit not in LENGTH_MM:
        raise InputError(f"{where}: line 1", f"expected lengths in one of {', '.join(LENGTH_MM)}, found {unit!r}")
    delimiter = found[3]
    titles = cells(first, delimiter)[1:]
    decimal = "," if delimiter != "," and any("," in title for title in titles) else "."
    try:
        x = np.array([float(title.replace(",", ".") if decimal == "," else title) for title in titles])
    except ValueError:
        raise InputError(f"{where}: line 1", "expected x as numbers after the corner cell") from None
    form = TextPart.model_validate(
        {"length_unit": "mm", "delimiter": delimiter, "decimal": decimal, "header": False, "skip_lines": 1}
    )
    rows = list(slabs(path, form, {str(k): k for k in range(len(x) + 1)}))
    y = np.concatenate([slab.present("0") for slab in rows])
    z = np.concatenate([np.stack([slab.columns[str(k + 1)] for k in range(len(x))], axis=1) for slab in rows])
    z[np.isin(z, MISSING)] = np.nan
    scale = LENGTH_MM[unit]
    x_mm = np.broadcast_to(bounded(x * scale), z.shape)
    note = f"{NAME}: {len(y)} rows of {len(x)}, lengths in {unit}; a row is a profile, y the way along the scan"
    frames = ProfileFrames(where, np.asarray(x_mm), bounded(z * scale), travel_mm=y * scale, length_unit=unit)
    return Imported(profiles=frames, notes=(note,))
