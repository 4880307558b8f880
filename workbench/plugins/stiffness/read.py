"""`stiffness.read`: joint stiffness from a `stiffness.json`, or given as six numbers."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import Field

from workbench.api import Cell, Document, Float, InputError, InputFile, StiffnessFile, stage
from workbench.plugins.stiffness.values import JointStiffness

Positive = Annotated[float, Field(gt=0, le=1e12)]


@stage("stiffness.read")
def read(
    cell: Cell | None = None,
    *,
    stiffness: InputFile | None = None,
    joint_stiffness_nm_per_rad: tuple[Positive, Positive, Positive, Positive, Positive, Positive] | None = None,
) -> JointStiffness | None:
    """Take the robot's joint stiffness from a file, as given, or from the cell's file: that of this robot, no other's.

    Args:
        cell: the robot cell, whose file may state the stiffness.
        stiffness: a `stiffness.json`, as `stiffness.identify` writes it; null: the numbers given here, or the cell's.
        joint_stiffness_nm_per_rad: of the six joints, exact, where no file is named; null: the cell's.

    Raises:
        InputError: a stiffness of zero or less, a covariance that is none; a cell whose stiffness nobody states.

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
    if given is None and cell is not None:
        if cell.joint_stiffness_nm_per_rad is None:
            where = f"{cell.source}: $.robot.joint_stiffness_nm_per_rad"
            raise InputError(
                where,
                "expected the joint stiffness of this robot, here or as a stiffness.json "
                "(stiffness.identify makes it from loading tests)",
            )
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
