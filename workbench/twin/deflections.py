"""Displacements of the tool point by point, out of a CSV or JSON file."""

from __future__ import annotations

import csv
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from workbench.artefacts import Layer
from workbench.errors import InputError
from workbench.strict_json import read_any_json
from workbench.text_files import numbered_lines, read_text
from workbench.units import Float

COLUMNS = ("layer", "point", "dx_mm", "dy_mm", "dz_mm")
_MOST_MM = 100.0
MAX_BYTES = 2**28


def read_deflections(path: Path, layers: Sequence[Layer]) -> dict[int, Float]:
    """By layer index the displacement (k, 3) of the tool in its own frame, mm; 0 at points that the file leaves out.

    A CSV has a header and the columns `layer` (its index), `point` (from 0), `dx_mm`, `dy_mm`, `dz_mm`; lines that
    begin with # are comments. A JSON file is a list of objects with these keys. InputError names the row.
    """
    found = {layer.index: np.zeros((len(layer.position_mm), 3)) for layer in layers}
    for where, row in _rows(path):
        layer, point = _whole(where, row, "layer"), _whole(where, row, "point")
        if layer not in found or not 0 <= point < len(found[layer]):
            raise InputError(where, f"a point of the path; there is no point {point} in a layer {layer}")
        found[layer][point] = [_length(where, row, name) for name in COLUMNS[2:]]
    return found


def _rows(path: Path) -> list[tuple[str, Mapping[str, Any]]]:
    """Place and content of each row."""
    if path.suffix.lower() == ".json":
        rows, name = read_any_json(path, MAX_BYTES), "row"
    else:
        rows, name = _csv_rows(path), "data row"
    if not isinstance(rows, list) or not all(isinstance(row, dict) for row in rows):
        raise InputError(str(path), f"a list of objects with the keys {', '.join(COLUMNS)}")
    return [(f"{path}: {name} {number}", row) for number, row in enumerate(rows, start=1)]


def _csv_rows(path: Path) -> list[dict[str, Any]]:
    try:
        return list(csv.DictReader(line for _, line in numbered_lines(read_text(path, MAX_BYTES))))
    except csv.Error as error:
        raise InputError(str(path), f"a CSV or JSON file of deflections ({error})") from None


def _whole(where: str, row: Mapping[str, Any], name: str) -> int:
    value = _number(where, row, name)
    if value != int(value):
        raise InputError(f"{where}: {name}", f"a whole number, not {value:g}")
    return int(value)


def _length(where: str, row: Mapping[str, Any], name: str) -> float:
    value = _number(where, row, name)
    if abs(value) > _MOST_MM:
        raise InputError(f"{where}: {name}", f"a displacement of at most {_MOST_MM:g} mm, not {value:g}")
    return value


def _number(where: str, row: Mapping[str, Any], name: str) -> float:
    try:
        value = float(row[name])
    except (KeyError, TypeError, ValueError):
        raise InputError(f"{where}: {name}", "a number") from None
    if not math.isfinite(value):
        raise InputError(f"{where}: {name}", "a finite number")
    return value
