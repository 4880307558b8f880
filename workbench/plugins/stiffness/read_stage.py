"""`stiffness.read`: joint stiffness from a `stiffness.json`, or given as six numbers.

And loading tests out of a `loads.csv`: one row a load, wrench and displacement as loaded minus unloaded.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import Field

from workbench.api import (
    DEG,
    Bool,
    Cell,
    Document,
    Float,
    InputError,
    InputFile,
    StiffnessFile,
    result_file,
    stage,
)
from workbench.plugins.csv_table import Table
from workbench.plugins.stiffness.values import DISPLACEMENT, JointStiffness, LoadingTests, moved_columns

Positive = Annotated[float, Field(gt=0, le=1e12)]
ANGLES = tuple(f"q{i}_deg" for i in range(1, 7))
WRENCH = ("fx_n", "fy_n", "fz_n", "tx_nm", "ty_nm", "tz_nm")
TARGET = re.compile(r"p([1-9]\d*)([xyz])_mm")


@stage("stiffness.read")
def read(
    cell: Cell | None = None,
    *,
    stiffness: InputFile | None = None,
    joint_stiffness_nm_per_rad: tuple[Positive, Positive, Positive, Positive, Positive, Positive] | None = None,
) -> JointStiffness | None:
    """Take the joint stiffness of this robot from a file, as given, or from the cell's file.

    None where nobody states it: postures are then chosen without it.

    Args:
        cell: the robot cell, whose file may state the stiffness.
        stiffness: a `stiffness.json` of `stiffness.identify`; null: the numbers given here, or the cell's.
        joint_stiffness_nm_per_rad: of the six joints, exact; null: the cell's.

    Raises:
        InputError: a stiffness of zero or less, an invalid covariance.

    Example:
        >>> from workbench import robot
        >>> from workbench.plugins import stiffness
        >>> cell = robot.cell(cell="data/robot/cell.json")
        >>> type(stiffness.read(cell)).__name__
        'JointStiffness'
    """
    if stiffness is not None:
        found = StiffnessFile.read(stiffness)
        k, covariance = np.array(found.joint_stiffness_nm_per_rad), np.array(found.covariance)
        return JointStiffness(k, covariance, found.condition_number or 0.0, found.postures, found.loads, str(stiffness))
    given = joint_stiffness_nm_per_rad
    if given is None and cell is not None and cell.joint_stiffness_nm_per_rad is not None:
        return _exact(cell.joint_stiffness_nm_per_rad, cell.source)
    return None if given is None else _exact(np.array(given), "given")


def _exact(values: Float, source: str) -> JointStiffness:
    return JointStiffness(values, np.zeros((6, 6)), 0.0, 0, 0, source)


def stiffness_document(stiffness: JointStiffness, **more: Any) -> Document:
    """`stiffness.json` (docs/pipelines.md); `more`: what the identification adds."""
    return result_file(
        "stiffness.json",
        {
            "joint_stiffness_nm_per_rad": stiffness.nm_per_rad,
            "covariance": stiffness.covariance,
            "standard_uncertainty_nm_per_rad": stiffness.u_nm_per_rad,
            "condition_number": stiffness.condition_number,
            "postures": stiffness.postures,
            "loads": stiffness.loads,
            **more,
            "warnings": list(stiffness.warnings),
        },
    )


# Loading tests.


def read_loads(path: Path) -> LoadingTests:
    """Read a file of loading tests.

    Raises:
        InputError: it cannot be read; a column is missing; a cell is no finite number; a load has no displacement.
    """
    table = Table(path, ("posture", *ANGLES, *WRENCH), 0)
    if not table.lines:
        raise InputError(str(path), "expected a header and one row a load")
    count = max((int(match[1]) for name in table.header if (match := TARGET.fullmatch(name))), default=0)
    six = all(name in table.header for name in DISPLACEMENT)
    if six == bool(count):
        more = (
            "expected dx_mm ... rz_deg or tracked points p1x_mm ..., not both"
            if six
            else "loads without displacement: expected dx_mm ... rz_deg or p1x_mm, p1y_mm, p1z_mm, ..."
        )
        raise InputError(f"{path}: header", more)
    columns = _columns(path, table.header, count)
    known = {"posture", *ANGLES, *WRENCH, *DISPLACEMENT, *columns}
    ignored = [name for name in table.header if name not in known]
    found = LoadingTests(
        source=str(path),
        labels=tuple(table.words("posture", "")),
        lines=tuple(table.lines),
        joints=table.numbers(ANGLES) * DEG,
        wrench=table.numbers(WRENCH),
        moved=table.numbers(columns, blank=count > 0),
        points=count,
        warnings=(f"{path}: columns that are not used: {', '.join(ignored)}",) if ignored else (),
    )
    lost: Bool = np.any(np.isnan(found.vectors), axis=2)  # a point of which a cell is empty
    if (unseen := np.all(lost, axis=1)).any():
        raise InputError(table.place(unseen), "a load without displacement: expected at least one point")
    found.vectors[lost] = np.nan
    return replace(found, moved=found.moved * found.units)


def _columns(path: Path, header: Sequence[str], count: int) -> tuple[str, ...]:
    """Those of the displacement; InputError where one of a point's three is missing."""
    columns = moved_columns(count)
    points = {name[: -len("x_mm")] for name in header if TARGET.fullmatch(name)}
    for name in columns:
        if name[: -len("x_mm")] in points and name not in header:
            raise InputError(f"{path}: header", f"expected the column '{name}': a point has all three or none")
    return columns
