"""`stiffness.read`: joint stiffness from a `stiffness.json`, or given as six numbers.

And loading tests out of a `loads.csv`: one row a load, wrench and displacement as loaded minus unloaded.
"""

from __future__ import annotations

import csv
import math
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import Field

from workbench.api import (
    DEG,
    Cell,
    Document,
    Float,
    InputError,
    InputFile,
    StiffnessFile,
    numbered_lines,
    read_text,
    stage,
)
from workbench.plugins.stiffness.values import JointStiffness, LoadingTests

Positive = Annotated[float, Field(gt=0, le=1e12)]
ANGLES = tuple(f"q{i}_deg" for i in range(1, 7))
WRENCH = ("fx_n", "fy_n", "fz_n", "tx_nm", "ty_nm", "tz_nm")
DISPLACEMENT = ("dx_mm", "dy_mm", "dz_mm", "rx_deg", "ry_deg", "rz_deg")
TARGET = re.compile(r"p([1-9]\d*)([xyz])_mm")
MAX_BYTES = 2**26
MOST = 1e6  # degrees, N, Nm, mm: beyond it lies nobody's test


@stage("stiffness.read")
def read(
    cell: Cell | None = None,
    *,
    stiffness: InputFile | None = None,
    joint_stiffness_nm_per_rad: tuple[Positive, Positive, Positive, Positive, Positive, Positive] | None = None,
) -> JointStiffness | None:
    """Take the robot's joint stiffness from a file, as given, or from the cell's file: that of this robot, no other's.

    None where nobody states it: postures are then chosen without it.

    Args:
        cell: the robot cell, whose file may state the stiffness.
        stiffness: a `stiffness.json`, as `stiffness.identify` writes it; null: the numbers given here, or the cell's.
        joint_stiffness_nm_per_rad: of the six joints, exact, where no file is named; null: the cell's.

    Raises:
        InputError: a stiffness of zero or less, a covariance that is none.

    Example:
        >>> from workbench import robot
        >>> from workbench.plugins import stiffness
        >>> cell = robot.cell(cell="data/robot/cell.json")
        >>> type(stiffness.read(cell)).__name__
        'JointStiffness'
    """
    if stiffness is not None:
        return read_stiffness(stiffness)
    given = joint_stiffness_nm_per_rad
    if given is None and cell is not None and cell.joint_stiffness_nm_per_rad is not None:
        return _exact(cell.joint_stiffness_nm_per_rad, cell.source)
    return None if given is None else _exact(np.array(given), "given")


def _exact(values: Float, source: str) -> JointStiffness:
    return JointStiffness(values, np.zeros((6, 6)), 0.0, 0, 0, source)


def read_stiffness(path: Path) -> JointStiffness:
    """The stiffness in a file; raises InputError with the place and what was expected."""
    found = StiffnessFile.read(path)
    covariance = np.array(found.covariance)
    if not _is_covariance(covariance):
        raise InputError(f"{path}: $.covariance", "expected a symmetric positive semi-definite 6x6 matrix")
    k, condition = np.array(found.joint_stiffness_nm_per_rad), found.condition_number or 0.0
    return JointStiffness(k, covariance, condition, found.postures, found.loads, str(path))


def _is_covariance(matrix: Float) -> bool:
    """Symmetric, and its correlations positive semi-definite."""
    scale = np.sqrt(np.abs(np.diag(matrix))) + 1e-150
    correlation = matrix / scale / scale[:, None]
    return bool(
        np.allclose(matrix, matrix.T, rtol=1e-6)
        and np.abs(correlation).max() < 1 + 1e-6
        and np.linalg.eigvalsh(correlation).min() > -1e-6
    )


def stiffness_document(stiffness: JointStiffness, **more: Any) -> Document:
    """`stiffness.json` (docs/pipelines.md); `more`: what the identification adds."""
    return Document(
        StiffnessFile.NAME,
        StiffnessFile.written(
            {
                "format": "joint-stiffness",
                "version": 1,
                "joint_stiffness_nm_per_rad": stiffness.nm_per_rad,
                "covariance": stiffness.covariance,
                "standard_uncertainty_nm_per_rad": stiffness.u_nm_per_rad,
                "condition_number": stiffness.condition_number,
                "postures": stiffness.postures,
                "loads": stiffness.loads,
                **more,
                "warnings": list(stiffness.warnings),
            }
        ),
    )


# Loading tests.


@dataclass(frozen=True)
class _Row:
    line: int
    cells: dict[str, str]


def read_loads(path: Path) -> LoadingTests:
    """Read a file of loading tests.

    Raises:
        InputError: it cannot be read; a column is missing; a cell is no finite number; a load has no displacement.
    """
    header, lines = _table(path)
    targets = _target_columns(header)
    missing = [name for name in ("posture", *ANGLES, *WRENCH) if name not in header]
    if missing:
        raise InputError(f"{path}: header", f"expected the column '{missing[0]}'")
    six = all(name in header for name in DISPLACEMENT)
    if not six and not targets:
        raise InputError(
            f"{path}: header", "loads without displacement: expected dx_mm ... rz_deg or p1x_mm, p1y_mm, p1z_mm, ..."
        )
    if six and targets:
        raise InputError(f"{path}: header", "expected dx_mm ... rz_deg or tracked points p1x_mm ..., not both")
    rows = _rows(header, lines, path)
    known = {"posture", *ANGLES, *WRENCH, *DISPLACEMENT, *(name for names in targets for name in names)}
    ignored = [name for name in header if name not in known]
    return LoadingTests(
        source=str(path),
        labels=tuple(row.cells["posture"].strip() for row in rows),
        lines=tuple(row.line for row in rows),
        joints=_numbers(rows, ANGLES, path) * DEG,
        wrench=_numbers(rows, WRENCH, path),
        displacement=_numbers(rows, DISPLACEMENT, path) * ([1.0] * 3 + [DEG] * 3) if six else None,
        targets_mm=None if six else _targets(rows, targets, path),
        warnings=(f"{path}: columns that are not used: {', '.join(ignored)}",) if ignored else (),
    )


def _table(path: Path) -> tuple[list[str], list[tuple[int, str]]]:
    """Header and rows as text with their line numbers; comments and empty lines left out."""
    numbered = numbered_lines(read_text(path, MAX_BYTES))
    if len(numbered) < 2:
        raise InputError(str(path), "expected a header and one row a load")
    header = [name.strip() for name in next(csv.reader([numbered[0][1]]))]
    if len(set(header)) < len(header):
        raise InputError(f"{path}: header", "a column stands twice")
    return header, numbered[1:]


def _rows(header: list[str], lines: list[tuple[int, str]], path: Path) -> list[_Row]:
    rows = []
    for line, text in lines:
        cells = next(csv.reader([text]))
        if len(cells) != len(header):
            raise InputError(f"{path}: line {line}", f"expected {len(header)} cells, found {len(cells)}")
        rows.append(_Row(line, dict(zip(header, cells, strict=True))))
    return rows


def _target_columns(header: list[str]) -> list[tuple[str, str, str]]:
    """Columns of the points p1, p2, ... that the file has, in the order of their numbers; all three of each."""
    numbers = sorted({int(match[1]) for name in header if (match := TARGET.fullmatch(name))})
    if not numbers:
        return []
    return [(f"p{k}x_mm", f"p{k}y_mm", f"p{k}z_mm") for k in range(1, numbers[-1] + 1)]


def _targets(rows: list[_Row], columns: list[tuple[str, str, str]], path: Path) -> Float:
    """(L, k, 3); NaN for a point of which a cell is empty."""
    found = np.full((len(rows), len(columns), 3), np.nan)
    for i, row in enumerate(rows):
        for k, names in enumerate(columns):
            if all(row.cells.get(name, "").strip() for name in names):
                found[i, k] = [_number(row, name, path) for name in names]
        if np.isnan(found[i]).all():
            raise InputError(f"{path}: line {row.line}", "a load without displacement: expected at least one point")
    return found


def _numbers(rows: list[_Row], columns: tuple[str, ...], path: Path) -> Float:
    return np.array([[_number(row, name, path) for name in columns] for row in rows])


def _number(row: _Row, name: str, path: Path) -> float:
    try:
        value = float(row.cells[name])
    except ValueError:
        value = math.nan
    if not abs(value) <= MOST:
        expected = "a number" if math.isnan(value) else f"a number within ±{MOST:g}"
        raise InputError(f"{path}: line {row.line}: {name}", f"expected {expected}, found {row.cells[name]!r}")
    return value
