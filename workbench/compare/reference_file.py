"""Reference data sets as NIST hands them out: points (`.ds`) and answers (`.fit`), plain numbers."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from workbench.errors import InputError
from workbench.geometry.fits import Shape
from workbench.text_files import numbered_lines, read_text
from workbench.units import Float

MAX_BYTES = 2**28
NUMBERS: dict[Shape, tuple[int, str]] = {
    "line": (6, "a point and the direction"),
    "plane": (6, "a point and the normal"),
    "circle": (7, "centre, normal and diameter"),
    "sphere": (4, "centre and diameter"),
    "cylinder": (7, "a point of the axis, its direction and the diameter"),
}


def read_points(path: Path) -> Float:
    """Points (n, 3): three numbers a line, blanks or commas between; lines that begin with # are comments.

    Raises:
        InputError: unreadable, no numbers; with the line.
    """
    lines = numbered_lines(read_text(path, MAX_BYTES))
    rows = [_numbers(line, f"{path}: line {k}") for k, line in lines]
    for (k, _), row in zip(lines, rows, strict=True):
        if len(row) != 3:
            raise InputError(f"{path}: line {k}", f"expected three numbers, found {len(row)}")
    if not rows:
        raise InputError(str(path), "expected points, found none")
    return np.array(rows)


def read_answer(path: Path, shape: Shape) -> Float:
    """The numbers of an answer, in any lines; a direction need not be a unit vector.

    Raises:
        InputError: another count of numbers than the shape has, no direction, no diameter.
    """
    lines = numbered_lines(read_text(path, MAX_BYTES))
    values = np.array([value for k, line in lines for value in _numbers(line, f"{path}: line {k}")])
    count, words = NUMBERS[shape]
    if len(values) != count:
        raise InputError(str(path), f"expected {count} numbers for a {shape}, {words}, found {len(values)}")
    if count > 4 and not np.linalg.norm(values[3:6]) > 0:
        raise InputError(str(path), "expected a direction, found zero")
    if count != 6 and not values[-1] > 0:
        raise InputError(str(path), f"expected a diameter above 0, found {values[-1]:g}")
    return values


def _numbers(line: str, where: str) -> list[float]:
    values = []
    for word in line.replace(",", " ").split():
        try:
            value = float(word)
        except ValueError:
            value = np.inf
        if not np.isfinite(value) or "_" in word:
            raise InputError(where, f"expected finite numbers, found '{word[:40]}'")
        values.append(value)
    return values
