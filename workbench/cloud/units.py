"""Units of a cloud's coordinates, and that of a LAS file's reference system: by WKT or GeoTIFF keys in any record."""

from __future__ import annotations

import math
import re
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO, Literal

from workbench.errors import InputError

Unit = Literal["mm", "m", "inch"]

MM: dict[Unit, float] = {"mm": 1.0, "m": 1000.0, "inch": 25.4}
OF_A_MAP = b"LASF_Projection"  # who signs the records of a reference system
WKT, GEO_KEYS = 2112, 34735  # numbers of the records that tell a unit
IN_PLANE, OF_HEIGHT = 3076, 4099  # GeoTIFF keys of units
MOST_BYTES = 2**20  # of a record that tells one
CODES = {9001: ("metre", 1.0), 9002: ("foot", 0.3048), 9003: ("US survey foot", 1200 / 3937)}  # EPSG
OF_ELLIPSOID = re.compile(r"\b(?:ELLIPSOID|SPHEROID)\[(?:[^][]|\[(?:[^][]|\[[^][]*\])*\])*\]", re.IGNORECASE)
UNIT = re.compile(r'\b(?:LENGTH)?UNIT\s*\[\s*"([^"]*)"\s*,\s*(\d+(?:\.\d*)?(?:e[-+]?\d+)?)', re.IGNORECASE)
PROJECTED = re.compile(r"\bPROJ(?:CS|CRS|ECTEDCRS)\[", re.IGNORECASE)
OF_ANGLES = re.compile("deg|rad|gon|arc|unity", re.IGNORECASE)


def las_unit(file: Path) -> Unit | None:
    """The unit of lengths in the file's reference system; None: it has no such system.

    Source: ASPRS LAS 1.4 R15, 2.4 to 2.7.

    Raises:
        InputError: its system has lengths in several units, in one that is not known here, or tells none.
    """
    with open(file, "rb") as stream:
        records = [*_records(stream)]
    if not records:
        return None
    units = {one for number, body in records for one in (_by_wkt(body) if number == WKT else _by_keys(number, body))}
    fits = [name for name, mm in MM.items() if units and all(math.isclose(mm, 1e3 * m, rel_tol=1e-7) for _, m in units)]
    if fits:
        return fits[0]
    found = " and ".join(sorted({name for name, _ in units})) or "no unit"
    expected = f'expected a reference system (map) in {", ".join(MM)}, found {found}: state the "unit", or convert it'
    raise InputError(str(file), expected)


def _records(stream: BinaryIO) -> Iterator[tuple[int, bytes]]:
    """Number and content of the records of a reference system: behind the header, and behind the points (LAS 1.4)."""
    head, end = stream.read(375).ljust(375, b"\0"), stream.seek(0, 2)
    start, (count,) = struct.unpack_from("<H", head, 94)[0], struct.unpack_from("<I", head, 100)
    lists = [(start, count, "<2x16sHH32x")]
    if start >= 375:
        lists.append((*struct.unpack_from("<QI", head, 235), "<2x16sHQ32x"))
    for at, many, form in lists:
        for _ in range(many):
            stream.seek(min(at, end))
            header = stream.read(struct.calcsize(form))
            if len(header) < struct.calcsize(form):
                break
            owner, number, length = struct.unpack(form, header)
            if owner.rstrip(b"\0") == OF_A_MAP:
                yield number, stream.read(min(length, MOST_BYTES))
            at += len(header) + length


def _by_wkt(body: bytes) -> Iterator[tuple[str, float]]:
    """Units of length of a system, in metres; of one in degrees none, an ellipsoid's own neither."""
    text = body.decode("utf-8", errors="replace")
    if not PROJECTED.search(text) and "GEOG" in text.upper():
        return
    for name, factor in UNIT.findall(OF_ELLIPSOID.sub("", text)):
        if not OF_ANGLES.search(name):
            yield name, float(factor)


def _by_keys(number: int, body: bytes) -> Iterator[tuple[str, float]]:
    """Units of a system that tells that in its plane; the height's alone says nothing of it."""
    if number == GEO_KEYS:
        keys = {key: value for key, _, _, value in struct.iter_unpack("<4H", body[: len(body) // 8 * 8])}
        for value in (keys[key] for key in (IN_PLANE, OF_HEIGHT) if IN_PLANE in keys and key in keys):
            yield CODES.get(value, (f"EPSG {value}", math.nan))
