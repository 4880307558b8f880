"""Keyence LJ-X / LJ-V: profiles saved as tab-separated text, and raw heights.

Text (LJ-V7000 communication library reference, section 11.2: values are saved unmodified): a row a point, its x, then
its height, both whole numbers of 0.01 micrometres; from -2147483645 downwards no return. Raw: uint16 heights, 0 = no
return, z = (v - 32768) ZUnit / 100 and x = (XStart + i XPitch) / 100 in micrometres; the numbers stand in the mapping.
"""

from __future__ import annotations

import itertools
from pathlib import Path

import numpy as np

from workbench.errors import InputError
from workbench.importing.mapping import Mapping, claims
from workbench.importing.mapping_parts import LENGTH_MM, RawPart, TextPart
from workbench.importing.neutral import Imported, ProfileFrames, bounded
from workbench.importing.text import head_text, read_table
from workbench.storage import regular_file
from workbench.units import AnyArray

NAME = "Keyence profile"
FORM = TextPart(length_unit="0.01um", delimiter="\t", header=False)
NO_RETURN = -2147483645  # and below: invalid, dead zone, waiting for judgement
ZERO_HEIGHT = 32768
FEWEST_ROWS = 8
MICROMETRE = 1e-3  # mm
SHARES = 100.0  # units a micrometre


def recognises(path: Path, head: bytes, mapping: Mapping) -> bool:
    """Whether the mapping says so, or all of the head is whole numbers between tabs, x rising by equal steps."""
    if mapping.keyence_raw is not None and claims(mapping.keyence_raw, path):
        return True
    lines = head_text(head).split("\n")[:-1]
    rows = [line.strip().split("\t") for line in lines[:FEWEST_ROWS]]
    if len(rows) < FEWEST_ROWS or not all(len(row) > 1 and all(map(_is_whole, row)) for row in rows):
        return False
    return len({int(b[0]) - int(a[0]) for a, b in itertools.pairwise(rows)}) == 1


def read(path: Path, mapping: Mapping) -> Imported:
    """One profile of a saved file; all profiles of a raw one.

    Raises:
        InputError: a file that is no whole number of profiles, or several profiles side by side.
    """
    if mapping.keyence_raw is not None and claims(mapping.keyence_raw, path):
        return _read_raw(path, mapping.keyence_raw)
    with open(path, "rb") as file:
        side_by_side = len(head_text(file.readline(65_536)).strip().split("\t")) - 1
    if side_by_side != 1:
        raise InputError(
            str(path),
            f"holds {side_by_side} profiles side by side (heads, or largest and smallest): name one in a mapping, "
            'delimiter "\\t", header false, length_unit "0.01um", frames "one"',
        )
    table = read_table(path, FORM, {"x": 0, "z": 1})
    x, z = table.present("x"), table.present("z")
    height = np.where(z <= NO_RETURN, np.nan, z) * LENGTH_MM["0.01um"]
    note = f"{NAME}: {len(x)} points in 0.01 micrometres, one profile"
    frames = ProfileFrames(table.where, bounded(x * LENGTH_MM["0.01um"])[None], bounded(height)[None], sensor="Keyence")
    return Imported(profiles=frames, notes=(note,))


def _read_raw(path: Path, part: RawPart) -> Imported:
    """Heights of profile after profile; the luminance of all of them may follow."""
    size = regular_file(path).st_size
    bytes_a_profile = 2 * part.columns * (2 if part.luminance else 1)
    if size == 0 or size % bytes_a_profile:
        raise InputError(
            f"{path}: byte {size}",
            f"expected whole profiles of {bytes_a_profile} bytes, found {size % bytes_a_profile} bytes over",
        )
    values = np.fromfile(path, np.dtype(np.uint16).newbyteorder("<" if part.byte_order == "little" else ">"))
    frames = size // bytes_a_profile
    heights = values[: frames * part.columns].reshape(frames, part.columns)
    light: AnyArray | None = None
    if part.luminance:
        light = values[frames * part.columns :].reshape(heights.shape).astype(np.uint16)
    z_mm = np.where(heights == 0, np.nan, (heights - float(ZERO_HEIGHT)) * part.z_unit / SHARES * MICROMETRE)
    across = (part.x_start + part.x_pitch * np.arange(part.columns)) / SHARES * MICROMETRE
    x_mm = np.broadcast_to(bounded(np.asarray(across)), heights.shape)
    note = f"Keyence raw heights: {frames} profiles of {part.columns} points, ZUnit {part.z_unit}"
    found = ProfileFrames(str(path), np.asarray(x_mm), bounded(z_mm), intensity=light, sensor="Keyence")
    return Imported(profiles=found, notes=(note,))


def _is_whole(text: str) -> bool:
    digits = text.removeprefix("-")
    return digits.isascii() and digits.isdigit() and len(digits) <= 10
