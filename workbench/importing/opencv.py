"""A profile in OpenCV's file storage, YAML: points x, 0, z one after another, or a matrix with one row per point."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from workbench.errors import InputError
from workbench.importing.mapping import Mapping
from workbench.importing.neutral import Imported, ProfileFrames, bounded
from workbench.importing.text import head_text, read_text
from workbench.units import Float

NAME = "OpenCV file storage (YAML)"
MARK = "%YAML:1.0"  # OpenCV's own; YAML proper writes a blank


def recognises(path: Path, head: bytes, mapping: Mapping) -> bool:
    """Whether the file begins as OpenCV writes it."""
    return head_text(head).startswith(MARK)


def read(path: Path, mapping: Mapping) -> Imported:
    """The profile, in mm: the longest list of the file.

    Raises:
        InputError: no list of numbers, one that is not points of two or three, or y that changes.
    """
    text = read_text(path)
    lists = re.findall(r"^\s*([^\s:#]+)\s*:\s*\[([^\]]*)\]", text, re.M)
    if not lists:
        raise InputError(str(path), "expected a list of points, `name: [ x, 0., z, ... ]`, found none")
    (name, content), *others = sorted(lists, key=lambda one: -len(one[1]))
    points = _points(path, text, content)
    if points.shape[1] == 3 and np.ptp(points[:, 1]) > 0:
        raise InputError(str(path), f"{name}: expected points of one profile, x, 0, z; found y that changes")
    x, z = bounded(points[:, 0].copy()), bounded(points[:, -1].copy())
    frames = ProfileFrames(str(path), x[None], z[None])
    left_out = f"; left out: {', '.join(other for other, _ in others)}" if others else ""
    note = f"{NAME}: {len(x)} points of '{name}', lengths in mm, one profile{left_out}"
    return Imported(profiles=frames, notes=(note,))


def _points(path: Path, text: str, content: str) -> Float:
    """(n, 2 or 3) the list's numbers; OpenCV writes `.Nan` where there is none."""
    plain = re.sub(r"\.(nan|inf)", r"\1", content, flags=re.I)
    try:
        values = np.array([float(one) for one in plain.split(",") if one.strip()])
    except ValueError as error:
        raise InputError(str(path), f"expected numbers: {error}") from None
    matrix = re.search(r"\bcols:\s*(\d+)\s+dt:\s*\"?(\d*)[df]", text)  # dt: channels and kind of number
    width = int(matrix[1]) * int(matrix[2] or 1) if matrix else 3
    if width not in (2, 3) or not len(values) or len(values) % width:
        raise InputError(str(path), f"expected points of 2 or 3 numbers, found {len(values)} numbers, {width} a point")
    return values.reshape(-1, width)
