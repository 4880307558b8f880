"""Measurements of a gauge study, one inspection each, by whom and of which part; what the stages exchange of them."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from workbench.artefacts import UNKNOWN_PART, Part, u_name
from workbench.artefacts.edges import ALL_TERMS, named, required_in_file
from workbench.errors import InputError, nearest
from workbench.storage import csv_rows, finite_number
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


def measurements_of(study: Path) -> list[Measurement]:
    """The measurements that a study's file lists; inspections are files, or directories that hold one."""
    found: dict[tuple[str, ...], Measurement] = {}
    for where, row in study_rows(study):
        part, operator = row.get("part", ONLY), row.get("operator", ONLY)
        if "inspection" in row:
            path = study.parent / row["inspection"]
            found["inspection", where] = read_inspection(path, part, operator)
            continue
        if "trial" not in row:
            raise InputError(where, "expected a trial beside the section")
        one = found.setdefault((part, operator, row["trial"]), Measurement(part, operator, where, {}))
        section = finite_number(row["section"], f"{where}, section")
        if section < 1 or section != int(section):
            raise InputError(f"{where}, section", f"expected a whole number from 1, found '{row['section']}'")
        if int(section) in one.sections:
            raise InputError(where, f"section {int(section)} of this trial stands twice")
        values = _values(row, NUMBERS, where)
        _check_uncertainties(values, where)
        one.sections[int(section)] = values
    return list(found.values())


def plain_measurements(study: Path, characteristics: Sequence[str], columns: Mapping[str, str]) -> list[Measurement]:
    """The measurements in a table of other people's: a row a trial, a column a characteristic.

    `columns` says what the table calls part, operator and trial; without a trial, rows count as they come.

    Raises:
        InputError: no such column, or a value that is no number, with line and column.
    """
    called = {name: columns.get(name, name) for name in ("part", "operator", "trial")}
    found: list[Measurement] = []
    seen: set[tuple[str, ...]] = set()
    for where, row in plain_rows(study, [*called.values()], characteristics):
        part, operator = row.get(called["part"], ONLY), row.get(called["operator"], ONLY)
        if called["trial"] in row:
            key = (part, operator, row[called["trial"]])
            if key in seen:
                raise InputError(where, f"trial {key[2]} of part '{part}' by operator '{operator}' stands twice")
            seen.add(key)
        found.append(Measurement(part, operator, where, {1: _values(row, characteristics, where)}))
    return found


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


def _values(row: Mapping[str, str], names: Sequence[str], where: str) -> dict[str, float]:
    """Numbers of a row by name; NaN where its cell is empty."""
    return {name: finite_number(row[name], f"{where}, {name}") if name in row else math.nan for name in names}


def _check_uncertainties(values: Mapping[str, float], where: str) -> None:
    for name in CHARACTERISTICS.values():
        if values[name] < 0:
            raise InputError(f"{where}, {name}", "expected a standard uncertainty from 0")


# The rows of a gauge study's file, as texts by column.

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


def study_rows(path: Path) -> list[tuple[str, dict[str, str]]]:
    """Each row's place in the file, for messages, and its filled cells by column.

    Raises:
        InputError: unreadable, no rows, an unknown column; with the line.
    """
    rows = _rows(path, COLUMNS)
    for where, row in rows:
        if ("inspection" in row) == ("section" in row):
            raise InputError(where, "expected either an inspection or a section with its values")
    return rows


def plain_rows(path: Path, known: Sequence[str], wanted: Sequence[str]) -> list[tuple[str, dict[str, str]]]:
    """As `study_rows`, of a CSV with any columns: those `known` may be there, those `wanted` must."""
    rows = _rows(path)
    names = list(dict.fromkeys(name for _, row in rows for name in row))
    for name in wanted:
        if name not in names:
            raise InputError(str(path), f"no column '{name}'{nearest(name, names)}")
    if not set(known) & set(names):
        what = f"expected a column {' or '.join(known)}{nearest(known[0], names)}; name them with `columns`"
        raise InputError(str(path), what)
    return rows


def _rows(path: Path, known: Sequence[str] = ()) -> list[tuple[str, dict[str, str]]]:
    rows = csv_rows(path, MAX_BYTES, known)
    if not rows:
        raise InputError(str(path), "expected at least one measurement")
    return rows
