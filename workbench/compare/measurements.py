"""Measurements of a gauge study, one inspection each, by whom and of which part; what the stages exchange of them."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import Any

from workbench.artefacts import UNKNOWN_PART, Part, u_name
from workbench.artefacts.edges import ALL_TERMS, named, required_in_file
from workbench.errors import InputError, nearest
from workbench.storage import csv_rows, finite_number
from workbench.strict_json import MAX_BYTES
from workbench.units import Float, Shaped

CHARACTERISTICS = {name: u_name(name) for name in ALL_TERMS}  # of every joint, and their standard uncertainties
UNITS = ("mm", "deg", "um")  # in which the name of a characteristic may end


def title_of(name: str) -> str:
    """A characteristic's name for a reader; one of other people's as they write it."""
    return ALL_TERMS[name][0] if name in ALL_TERMS else name


@dataclass(frozen=True, slots=True, eq=False)
class Study:
    """Repeated measurements of parts by operators, crossed and balanced: P parts, O operators, R trials, S sections.

    Keys are the characteristics that every measurement has. NaN: hidden, or not stated.
    """

    parts: tuple[str, ...]
    operators: tuple[str, ...]
    trials: int
    section: tuple[int, ...]  # (S,) index, from 1
    arc_length_mm: Shaped[Float, " S"]  # mean place
    measured: Mapping[str, Float]  # (P, O, R, S)
    stated_u: Mapping[str, Float]  # (P, O, R, S) standard uncertainty that each measurement states
    reference: Mapping[str, Float]  # (P, S)
    reference_u: Mapping[str, Float]  # (P, S)
    limits: Mapping[str, tuple[float, float]]  # lower and upper limit of the value, where known
    files: tuple[tuple[str, str], ...]  # path as given and SHA-256 of every inspection
    warnings: tuple[str, ...] = ()
    part: Part = UNKNOWN_PART  # what all inspections agree on
    unit: str = "mm"  # of characteristics whose names do not end in one

    def unit_of(self, name: str) -> str:
        """The unit of a characteristic."""
        suffix = name.rpartition("_")[2]
        return suffix if suffix in UNITS else self.unit


JOINT_FILES = ("inspection.json", "groove.json", "preparation.json")
ONLY = "all"  # the part, the operator, where none is named
NUMBERS = ("arc_length_mm", *CHARACTERISTICS, *CHARACTERISTICS.values())


@dataclass(frozen=True, slots=True)
class Measurement:
    """One inspection: values by section and name (NaN: none), and the limits that it was judged by."""

    part: str
    operator: str
    where: str  # for messages
    sections: dict[int, Mapping[str, float]]
    limits: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    identity: Part = UNKNOWN_PART
    digest: str = ""  # SHA-256 of the file; '': the values stand in the study


def measurements_of(
    study: Path, characteristics: Sequence[str] = (), columns: Mapping[str, str] = MappingProxyType({})
) -> list[Measurement]:
    """The measurements that a study's file lists; inspections are files, or directories that hold one.

    Args:
        study: CSV, one row per inspection, or per section of a trial with its values.
        characteristics: its columns, where it is other people's: a row is a trial then, as they come where none is
            named.
        columns: what such a table calls part, operator and trial.

    Raises:
        InputError: no such column, or a value that is no number, with line and column.
    """
    called = {name: columns.get(name, name) for name in ("part", "operator", "trial")}
    rows = _rows_with(study, [*called.values()], characteristics) if characteristics else _own_rows(study)
    found: dict[tuple[str, ...], Measurement] = {}
    for where, row in rows:
        part, operator = row.get(called["part"], ONLY), row.get(called["operator"], ONLY)
        if "inspection" in row and not characteristics:
            try:
                found[where,] = read_inspection(study.parent / row["inspection"], part, operator)
            except InputError as error:
                raise InputError(where, str(error)) from None
            continue
        trial, section = row.get(called["trial"], where), 1 if characteristics else _section(row["section"], where)
        one = found.setdefault((part, operator, trial), Measurement(part, operator, where, {}))
        if section in one.sections:
            what = f"trial {trial} of part '{part}' by '{operator}' occurs twice"
            raise InputError(where, what if characteristics else f"section {section} of {what}")
        one.sections[section] = _values(row, characteristics or NUMBERS, where)
    return list(found.values())


def _values(row: Mapping[str, str], names: Sequence[str], where: str) -> dict[str, float]:
    """Numbers of a row by name; NaN where its cell is empty."""
    values = {name: finite_number(row[name], f"{where}, {name}") if name in row else math.nan for name in names}
    if names is NUMBERS and (below := [name for name in CHARACTERISTICS.values() if values.get(name, 0.0) < 0]):
        raise InputError(f"{where}, {below[0]}", "expected a standard uncertainty from 0")
    return values


def _section(text: str, where: str) -> int:
    section = finite_number(text, f"{where}, section")
    if section < 1 or section != int(section):
        raise InputError(f"{where}, section", f"expected a whole number from 1, found '{text}'")
    return int(section)


def read_inspection(path: Path, part: str = ONLY, operator: str = ONLY) -> Measurement:
    """The measurement in an `inspection.json`, `groove.json` or `preparation.json`, or in a directory that holds one.

    Raises:
        InputError: not such a file; the place in it and what was expected.
    """
    from workbench.result_files import RESULT_FILES  # the models take time to build: where there is something to read

    if path.is_dir():
        path = next((path / name for name in JOINT_FILES if (path / name).is_file()), path / JOINT_FILES[0])
    file: Any = RESULT_FILES[path.name if path.name in JOINT_FILES else JOINT_FILES[0]].read(path)
    sections: dict[int, Mapping[str, float]] = {
        row.index: {name: math.nan if (value := getattr(row, name, None)) is None else value for name in NUMBERS}
        for row in file.sections
    }
    digest = hashlib.sha256(path.read_bytes()).hexdigest()
    limits = {}
    for name, (nominal, (low, high)) in required_in_file(file.document["requirements"]).items():
        if not low < high:
            where = f"{path}: $.requirements.{named(name, 'tolerance')}"
            raise InputError(where, "expected a lower limit below the upper one")
        limits[name] = nominal + low, nominal + high
    return Measurement(part, operator, str(path), sections, limits, file.part or UNKNOWN_PART, digest)


# The rows of a gauge study's file, as texts by column.

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


def _own_rows(path: Path) -> list[tuple[str, dict[str, str]]]:
    """Each row's place in the file, for messages, and its filled cells by column."""
    rows = _rows(path, COLUMNS)
    for where, row in rows:
        if ("inspection" in row) == ("section" in row):
            raise InputError(where, "expected either an inspection or a section with its values")
        if "section" in row and "trial" not in row:
            raise InputError(where, "expected a trial beside the section")
    return rows


def _rows_with(path: Path, known: Sequence[str], wanted: Sequence[str]) -> list[tuple[str, dict[str, str]]]:
    """As `_own_rows`, of a CSV with any columns: some of those `known` and all those `wanted` must be there."""
    rows = _rows(path)
    names = list(dict.fromkeys(name for _, row in rows for name in row))
    if lacking := [name for name in wanted if name not in names]:
        raise InputError(str(path), f"no column '{lacking[0]}'{nearest(lacking[0], names)}")
    if not set(known) & set(names):
        what = f"expected a column {' or '.join(known)}{nearest(known[0], names)}; name them with `columns`"
        raise InputError(str(path), what)
    return rows


def _rows(path: Path, known: Sequence[str] = ()) -> list[tuple[str, dict[str, str]]]:
    rows = csv_rows(path, MAX_BYTES, known)
    if not rows:
        raise InputError(str(path), "expected at least one measurement")
    return rows
