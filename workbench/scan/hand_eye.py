"""The hand-eye calibration from a `handeye.json` (INTERFACES section 4)."""

from __future__ import annotations

import difflib
from pathlib import Path

import numpy as np

from workbench.artefacts import HandEye, Recording
from workbench.errors import InputError, nearest
from workbench.geometry.poses import is_rigid
from workbench.units import Float


def read_hand_eye(path: Path) -> HandEye:
    """The pose of the profiler on the flange, and its covariance where the file gives one.

    Raises:
        InputError: no such file, not JSON, `flange_from_profiler` missing or not a proper rigid motion, `covariance`
            not a symmetric positive semi-definite 6x6 matrix.
    """
    from workbench.result_files import HandEyeFile  # pydantic: loaded when there is something to read

    found = HandEyeFile.read(path)
    keys = set(HandEyeFile.model_fields)
    for key in found.model_extra or {}:  # a misspelt covariance must not be lost without a word; other keys are free
        if difflib.get_close_matches(key, keys, n=1, cutoff=0.8):
            raise InputError(f"{path}: $.{key}", f"unknown key{nearest(key, keys)}")
    pose = np.array(found.flange_from_profiler)
    check_hand_eye(pose, f"{path}: $.flange_from_profiler")
    covariance = None if found.covariance is None else np.array(found.covariance)
    if covariance is not None:
        _check_covariance(covariance, f"{path}: $.covariance")
    scale, middle = found.sensor_scale or (1.0, 1.0), found.sensor_middle_mm or (0.0, 0.0)
    return HandEye(pose, covariance, str(path), found.part.recorded_at, found.volume_u_mm, scale, middle)


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


def _check_covariance(covariance: Float, where: str) -> None:
    # scaled by the standard deviations, since mm^2 and rad^2 differ by many powers of ten
    variance = np.diag(covariance)
    scale = np.sqrt(np.where(variance > 0, variance, 1.0))
    correlation = covariance / np.outer(scale, scale)
    plausible = variance.min() >= 0 and np.abs(correlation - correlation.T).max() <= 1e-6
    if not plausible or np.linalg.eigvalsh((correlation + correlation.T) / 2).min() < -1e-6:
        raise InputError(where, "expected a covariance: symmetric, no negative eigenvalue")
