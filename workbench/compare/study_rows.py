"""The rows of a gauge study's file, CSV or JSON, as texts by column."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path

from workbench.compare.values import CHARACTERISTICS
from workbench.errors import InputError, nearest
from workbench.strict_json import read_json
from workbench.text_files import numbered_lines, read_text

MAX_BYTES = 2**24
COLUMNS = (
    "part",
    "operator",
    "trial",
    "inspection",
    "section",
    "arc_length_mm",
    *CHARACTERISTICS,
    *CHARACTERISTICS.values(),
)


def study_rows(path: Path) -> list[tuple[str, Mapping[str, str]]]:
    """Each row's place in the file, for messages, and its filled cells by column.

    A CSV has a header; lines that begin with # are comments. A JSON file holds the same rows as objects:
    `{"format": "gauge-study", "version": 1, "measurements": [{"part": "A", ...}, ...]}`.

    Raises:
        InputError: unreadable, no rows, an unknown column; with line or index.
    """
    rows = list(_json_rows(path) if path.suffix.lower() == ".json" else _csv_rows(path))
    if not rows:
        raise InputError(str(path), "expected at least one measurement")
    for where, row in rows:
        if ("inspection" in row) == ("section" in row):
            raise InputError(where, "expected either an inspection or a section with its values")
    return rows


def plain_rows(path: Path, known: Sequence[str], wanted: Sequence[str]) -> list[tuple[str, Mapping[str, str]]]:
    """As `study_rows`, of a CSV with any columns: those `known` may be there, those `wanted` must."""

    def check(names: list[str], where: str) -> None:
        for name in wanted:
            if name not in names:
                raise InputError(where, f"no column '{name}'{nearest(name, names)}")
        if not set(known) & set(names):
            raise InputError(
                where, f"expected a column {' or '.join(known)}{nearest(known[0], names)}; name them with `columns`"
            )

    rows = list(_csv_rows(path, check))
    if not rows:
        raise InputError(str(path), "expected at least one measurement")
    return rows


def _csv_rows(
    path: Path, check: Callable[[list[str], str], None] | None = None
) -> Iterator[tuple[str, Mapping[str, str]]]:
    lines = numbered_lines(read_text(path, MAX_BYTES))
    if not lines:
        return
    try:
        table = list(csv.reader(io.StringIO("\n".join(line for _, line in lines)), strict=True))
    except csv.Error as error:
        raise InputError(str(path), f"expected a table of comma-separated values: {error}") from None
    if len(table) != len(lines):
        raise InputError(str(path), "expected one row a line")
    header = [name.strip() for name in table[0]]
    (check or _check_columns)(header, f"{path}: line {lines[0][0]}")
    for (number, _), cells in zip(lines[1:], table[1:], strict=True):
        where = f"{path}: line {number}"
        if len(cells) != len(header):
            raise InputError(where, f"expected {len(header)} cells, found {len(cells)}")
        yield where, {name: cell.strip() for name, cell in zip(header, cells, strict=True) if cell.strip()}


def _json_rows(path: Path) -> Iterator[tuple[str, Mapping[str, str]]]:
    document = read_json(path)
    if document.get("format") != "gauge-study" or document.get("version") != 1:
        raise InputError(f"{path}: $.format", "expected 'gauge-study', version 1")
    measurements = document.get("measurements")
    if not isinstance(measurements, list):
        raise InputError(f"{path}: $.measurements", "expected a list")
    for i, entry in enumerate(measurements):
        where = f"{path}: $.measurements[{i}]"
        if not isinstance(entry, dict):
            raise InputError(where, "expected an object")
        _check_columns(list(entry), where)
        for name, value in entry.items():
            if not isinstance(value, str | int | float) and value is not None:
                raise InputError(f"{where}.{name}", "expected a text or a number")
        yield where, {name: str(value) for name, value in entry.items() if value is not None}


def _check_columns(names: list[str], where: str) -> None:
    for name in names:
        if name not in COLUMNS:
            raise InputError(where, f"unknown column '{name}'{nearest(name, COLUMNS)}")
    if len(set(names)) < len(names):
        raise InputError(where, "expected every column once")
