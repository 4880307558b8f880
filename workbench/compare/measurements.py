"""Measurements of a gauge study: one inspection each, by whom and of which part."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from workbench.compare.study_rows import plain_rows, study_rows
from workbench.compare.values import CHARACTERISTICS
from workbench.errors import InputError

if TYPE_CHECKING:
    from workbench.result_files.contract import RequirementsRow

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
        section = _number(row["section"], f"{where}, section")
        if section < 1 or section != int(section):
            raise InputError(f"{where}, section", f"expected a whole number from 1, found '{row['section']}'")
        if int(section) in one.sections:
            raise InputError(where, f"section {int(section)} of this trial stands twice")
        values = {name: _number(row[name], f"{where}, {name}") if name in row else math.nan for name in NUMBERS}
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
        values = {name: _number(row[name], f"{where}, {name}") if name in row else math.nan for name in characteristics}
        found.append(Measurement(part, operator, where, {1: values}))
    return found


def read_inspection(path: Path, part: str = ONLY, operator: str = ONLY) -> Measurement:
    """The measurement in an `inspection.json`, or in the directory that holds it.

    Raises:
        InputError: not such a file; the place in it and what was expected.
    """
    from workbench.result_files import InspectionFile  # the models take time to build: where there is something to read

    path = path / InspectionFile.NAME if path.is_dir() else path
    file = InspectionFile.read(path)
    sections: dict[int, Mapping[str, float]] = {
        row.index: {name: math.nan if (value := getattr(row, name)) is None else value for name in NUMBERS}
        for row in file.sections
    }
    digest = hashlib.sha256(path.read_bytes()).hexdigest()
    return Measurement(
        part, operator, str(path), sections, _limits(file.requirements, f"{path}: $.requirements"), digest
    )


def _limits(wanted: RequirementsRow, where: str) -> dict[str, tuple[float, float]]:
    """Limits of the values: nominal and deviations added up."""
    found = {}
    for name in CHARACTERISTICS:
        size, unit = name.rsplit("_", 1)
        nominal, (low, high) = (getattr(wanted, f"{size}_{what}_{unit}") for what in ("nominal", "tolerance"))
        if not low < high:
            raise InputError(f"{where}.{size}_tolerance_{unit}", "expected a lower limit below the upper one")
        found[name] = nominal + low, nominal + high
    return found


def _check_uncertainties(values: Mapping[str, float], where: str) -> None:
    for name in CHARACTERISTICS.values():
        if values[name] < 0:
            raise InputError(f"{where}, {name}", "expected a standard uncertainty from 0")


def _number(text: str, where: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.inf
    if not math.isfinite(value) or "_" in text:
        raise InputError(where, f"expected a finite number, found '{text[:40]}'")
    return value
