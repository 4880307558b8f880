"""SICK 3D cameras (iCon): samples in a .dat file, and an .xml file beside it that says what they are.

The .xml lists subcomponents of a scan: name, type (FLOAT, WORD, BYTE, INT), width and size in bytes. The .dat holds one
scan after another, a scan its subcomponents in that order. `Range X` and `Range R` are calibrated coordinates; where
both are 0 nothing came back.
"""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from pathlib import Path
from typing import NamedTuple

import numpy as np

from workbench.errors import InputError, nearest
from workbench.importing.mapping import Mapping
from workbench.importing.neutral import Imported, ProfileFrames, bounded
from workbench.storage import regular_file
from workbench.units import AnyArray

NAME = "SICK scans (.dat with .xml)"
TYPES = {"FLOAT": "<f4", "WORD": "<u2", "BYTE": "u1", "INT": "<i4", "UINT": "<u4", "DOUBLE": "<f8"}
X, R, LIGHT = "Range X", "Range R", "Intensity"
MOST_XML = 1_000_000


class Sub(NamedTuple):
    """A subcomponent of a scan."""

    name: str
    dtype: str
    width: int


def recognises(path: Path, head: bytes, mapping: Mapping) -> bool:
    """Whether it is SICK's description, or a file with such a description beside it."""
    if path.suffix.lower() == ".xml":
        return b"<icon_data_format" in head[:4096]
    beside = _beside(path, ".xml") if path.suffix.lower() == ".dat" else None
    if beside is None:
        return False
    with open(beside, "rb") as file:
        return b"<icon_data_format" in file.read(4096)


def read(path: Path, mapping: Mapping) -> Imported:
    """All scans of the .dat file.

    Raises:
        InputError: a partner is missing, no range in it, a size that is no whole number of scans.
    """
    samples, description = _beside(path, ".dat"), _beside(path, ".xml")
    if samples is None or description is None:
        lacking = path.with_suffix(".dat" if samples is None else ".xml").name
        raise InputError(str(path), f"expected {lacking} beside it: samples and their description belong together")
    subs = described(description)
    record = np.dtype([(f"f{k}", sub.dtype, (sub.width,)) for k, sub in enumerate(subs)])
    size = regular_file(samples).st_size
    if size == 0 or size % record.itemsize:
        over = size % record.itemsize
        raise InputError(
            f"{samples}: byte {size}", f"expected whole scans of {record.itemsize} bytes, found {over} over"
        )
    scans = np.fromfile(samples, record)
    fields = {sub.name: scans[f"f{k}"] for k, sub in enumerate(subs)}
    for name in (X, R):
        if name not in fields:
            raise InputError(str(description), f"expected a subcomponent '{name}'{nearest(name, fields)}")
    x, r = fields[X].astype(np.float64), fields[R].astype(np.float64)
    if x.shape != r.shape:
        raise InputError(str(description), f"expected '{X}' as wide as '{R}'")
    nothing = (x == 0) & (r == 0)
    light = fields.get(LIGHT)
    intensity: AnyArray | None = None
    if light is not None and light.shape == r.shape and light.dtype.kind == "u":
        intensity = light.astype(np.uint16)
    note = f"{NAME}: {len(scans)} scan(s) of {x.shape[1]} points in mm; scans carry no travel"
    frames = ProfileFrames(
        str(samples),
        bounded(np.where(nothing, np.nan, x)),
        bounded(np.where(nothing, np.nan, r)),
        intensity=intensity,
        sensor="SICK",
    )
    return Imported(profiles=frames, notes=(note,))


def described(path: Path) -> list[Sub]:
    """The subcomponents of a scan; document types, which could name other files, are refused."""
    if regular_file(path).st_size > MOST_XML:
        raise InputError(str(path), f"expected at most {MOST_XML} bytes")
    content = path.read_bytes()
    if b"<!" in content or b"\0" in content:  # or in two bytes a letter
        raise InputError(str(path), "expected no document type or entity in it")
    try:
        root = ElementTree.fromstring(content)
    except (ElementTree.ParseError, ValueError) as error:
        raise InputError(str(path), f"expected XML: {error}") from None
    found = []
    for sub in root.iter("subcomponent"):
        name, kind = sub.get("name", ""), sub.get("valuetype", "")
        width = next((p.text or "" for p in sub.iter("parameter") if p.get("name") == "width"), "")
        if kind not in TYPES or not (width.isascii() and width.isdigit() and 0 < int(width) <= 100_000):
            raise InputError(
                f"{path}: subcomponent '{name}'",
                f"expected a type of {', '.join(TYPES)} and a width, found {kind!r}, {width!r}",
            )
        found.append(Sub(name, TYPES[kind], int(width)))
    if not found:
        raise InputError(str(path), "expected subcomponents, found none")
    return found


def _beside(path: Path, suffix: str) -> Path | None:
    """The file itself, or the one of the same name that ends so."""
    if path.suffix.lower() == suffix:
        return path
    return next((one for one in (path.with_suffix(suffix), path.with_suffix(suffix.upper())) if one.is_file()), None)
