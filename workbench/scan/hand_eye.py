"""The hand-eye calibration from a `handeye.json` (INTERFACES section 4)."""

from __future__ import annotations

import difflib
from pathlib import Path
from typing import Any

import numpy as np

from workbench.artefacts import HandEye, Recording
from workbench.artefacts.parts import iso_date
from workbench.errors import InputError, nearest
from workbench.geometry.poses import is_rigid
from workbench.strict_json import read_json
from workbench.units import Float

MAX_U_MM = 1e3
KEYS = (
    "flange_from_profiler", "translation_mm", "rotation_rpy_deg", "covariance", "sphere_center_mm",
    "sphere_diameter_mm", "time_offset_s", "time_offset_u_s", "volume_u_mm", "residual_rms_mm", "method",
    "frames_used", "frames_rejected", "warnings", "part",
)  # fmt: skip


def read_hand_eye(path: Path) -> HandEye:
    """The pose of the profiler on the flange, and its covariance where the file gives one.

    Raises:
        InputError: no such file, not JSON, `flange_from_profiler` missing or not a proper rigid motion, `covariance`
            not a symmetric positive semi-definite 6x6 matrix.
    """
    document = read_json(path)
    for key in document:  # a misspelt covariance must not be lost without a word; other keys are free
        if key not in KEYS and difflib.get_close_matches(key, KEYS, n=1, cutoff=0.8):
            raise InputError(f"{path}: $.{key}", f"unknown key{nearest(key, KEYS)}")
    if "flange_from_profiler" not in document:
        raise InputError(f"{path}: $", f"expected 'flange_from_profiler'{nearest('flange_from_profiler', document)}")
    pose = _matrix(document["flange_from_profiler"], 4, f"{path}: $.flange_from_profiler")
    check_hand_eye(pose, f"{path}: $.flange_from_profiler")
    covariance = None
    if document.get("covariance") is not None:
        covariance = _matrix(document["covariance"], 6, f"{path}: $.covariance")
        _check_covariance(covariance, f"{path}: $.covariance")
    return HandEye(flange_from_profiler=pose, covariance=covariance, source=str(path),
                   calibrated_at=_calibrated_at(document, path), volume_u_mm=_volume_u_mm(document, path))  # fmt: skip


def _calibrated_at(document: dict[str, Any], path: Path) -> str | None:
    """When the sphere was recorded, where the file says so."""
    part = document.get("part") or {}
    day = part.get("recorded_at") if isinstance(part, dict) else part
    if day is not None and (not isinstance(day, str) or iso_date(day) is None):
        raise InputError(f"{path}: $.part.recorded_at", "expected a date as 2026-03-31 (ISO 8601)")
    return day


def _volume_u_mm(document: dict[str, Any], path: Path) -> float | None:
    u = document.get("volume_u_mm")
    if u is not None and (isinstance(u, bool) or not isinstance(u, int | float) or not 0 <= u < MAX_U_MM):
        raise InputError(f"{path}: $.volume_u_mm", "expected a length in mm")
    return None if u is None else float(u)


def recorded_hand_eye(recording: Recording) -> HandEye:
    """The calibration that the recording itself carries.

    Raises:
        InputError: it carries none.
    """
    if recording.flange_from_profiler is None:
        raise InputError(
            f"{recording.source}: /hand_eye/flange_from_profiler",
            "missing, and no calibration file is named (hand_eye)",
        )
    return HandEye(flange_from_profiler=recording.flange_from_profiler, source=recording.source)


def check_hand_eye(pose: Float, where: str) -> None:
    """Refuse what is not a proper rigid motion."""
    if not is_rigid(pose):
        raise InputError(
            where, "expected a rigid motion: rotation orthonormal to 1e-6, determinant +1, last row 0 0 0 1"
        )


def _matrix(value: Any, size: int, where: str) -> Float:
    """A size x size matrix of finite numbers out of JSON."""
    rows = value if isinstance(value, list) else []
    if len(rows) != size or any(not isinstance(row, list) or len(row) != size for row in rows):
        raise InputError(where, f"expected {size} rows of {size} numbers")
    for i, row in enumerate(rows):
        for j, entry in enumerate(row):
            if isinstance(entry, bool) or not isinstance(entry, int | float) or not abs(entry) < 1e12:
                raise InputError(f"{where}[{i}][{j}]", "expected a finite number")
    return np.array(rows, float)


def _check_covariance(covariance: Float, where: str) -> None:
    # scaled by the standard deviations, since mm^2 and rad^2 differ by many powers of ten
    variance = np.diag(covariance)
    scale = np.sqrt(np.where(variance > 0, variance, 1.0))
    correlation = covariance / np.outer(scale, scale)
    plausible = variance.min() >= 0 and np.abs(correlation - correlation.T).max() <= 1e-6
    if not plausible or np.linalg.eigvalsh((correlation + correlation.T) / 2).min() < -1e-6:
        raise InputError(where, "expected a covariance: symmetric, no negative eigenvalue")
