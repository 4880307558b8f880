"""What times, passes and poses of a recording must satisfy; the hand-eye calibration from a `handeye.json`."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from workbench.artefacts import UNKNOWN_PART, HandEye, Part, Recording
from workbench.errors import InputError
from workbench.geometry.poses import RIGID, is_rigid
from workbench.units import AnyArray, Float, Int


def read_hand_eye(path: Path, part: Part = UNKNOWN_PART) -> HandEye:
    """The pose of the profiler on the flange, and its covariance where the file gives one.

    Raises:
        InputError: no such file, not JSON, `flange_from_profiler` missing or not a proper rigid motion, `covariance`
            not a symmetric positive semi-definite 6x6 matrix; of another sensor or robot than the part's recording.
    """
    from workbench.result_files import HandEyeFile  # pydantic: loaded when there is something to read

    return HandEyeFile.hand_eye(path, part)


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
        raise InputError(where, RIGID)


UNIT_TOLERANCE = 1e-3  # of a quaternion's norm; nearer to 1 it is normalised (INTERFACES section 0)
MAX_SECONDS = 1e11  # 3,000 years: what is beyond was not counted in seconds
FAR_MM = 1e4  # no profiler sees so far
MAX_MM = 1e6  # of a flange position: 1 km


def checked(where: str, values: dict[str, AnyArray], is_calibration: bool, clock: str) -> dict[str, AnyArray]:
    """`values` (fields of a Recording, grid aside) with quaternions normalised, or an InputError naming the row."""
    _check_bounded(values["time_s"], MAX_SECONDS, f"{where}: /profiles/time", "s")
    _check_bounded(values["robot_time_s"], MAX_SECONDS, f"{where}: /robot/time", "s")
    _check_bounded(values["robot_position_mm"], MAX_MM, f"{where}: /robot/position", "mm")
    _check_rising(values["time_s"], values["pass_index"], f"{where}: /profiles/time")
    _check_rising(values["robot_time_s"], values["robot_pass"], f"{where}: /robot/time")
    _check_covered(where, values, is_calibration, clock)
    if len(values["time_s"]) == 1 and not is_calibration:
        raise InputError(f"{where}: /profiles", "a single frame: an edge is measured from frames along it")
    if "flange_from_profiler" in values:
        check_hand_eye(values["flange_from_profiler"], f"{where}: /hand_eye/flange_from_profiler")
    quaternion = normalised(values["robot_quaternion_wxyz"], f"{where}: /robot/quaternion_wxyz")
    return {**values, "robot_quaternion_wxyz": quaternion}


def normalised(quaternion_wxyz: Float, where: str) -> Float:
    """Unit quaternions (K, 4); refuses one whose norm is off 1 by more than the tolerance."""
    _check_bounded(quaternion_wxyz, 2.0, where, "a unit quaternion")
    norm = np.linalg.norm(quaternion_wxyz, axis=1)
    off = np.flatnonzero(np.abs(norm - 1) > UNIT_TOLERANCE)
    if len(off):
        raise InputError(
            f"{where}[{off[0]}]", f"expected a norm of 1 within {UNIT_TOLERANCE}, found {norm[off[0]]:.6g}"
        )
    return np.asarray(quaternion_wxyz / norm[:, None])


def in_micrometres(lengths_mm: AnyArray) -> str:
    """': um read as mm?' where that explains all lengths, of which some are beyond reason; else ''."""
    size = np.abs(lengths_mm[np.isfinite(lengths_mm)])
    return ": um read as mm?" if len(size) and size.min() > FAR_MM and size.max() <= 1000.0 * FAR_MM else ""


def _check_bounded(values: AnyArray, limit: float, where: str, expected: str) -> None:
    bad = np.argwhere(~(np.abs(values) <= limit))
    if len(bad):
        place = ", ".join(map(str, bad[0]))
        raise InputError(f"{where}[{place}]", f"expected {expected}, found {values[tuple(bad[0])]:g}")


def _check_rising(time_s: Float, pass_index: Int, where: str) -> None:
    """Times strictly increase within each pass, in the order of the file."""
    order = np.argsort(pass_index, kind="stable")
    same = pass_index[order[1:]] == pass_index[order[:-1]]
    stuck = order[1:][same & (np.diff(time_s[order]) <= 0)]
    if len(stuck):
        row = int(stuck.min())
        place = f"pass {pass_index[row]}"
        raise InputError(
            f"{where}[{row}]",
            f"expected times that rise within {place}, found {time_s[row]!s} s after one as late or later",
        )


def _check_covered(where: str, values: dict[str, AnyArray], is_calibration: bool, clock: str) -> None:
    """Every frame's pass has poses, and its time lies within theirs.

    Exempt are postures held still (calibration, one pose per pass: its frames are repeats there) and times on the
    profiler's own clock, which cannot be compared.
    """
    time_s, number = values["time_s"], values["pass_index"]
    order = np.argsort(values["robot_pass"], kind="stable")  # rising times stay in order within a pass
    passes, first, count = np.unique(values["robot_pass"][order], return_index=True, return_counts=True)
    which = np.minimum(np.searchsorted(passes, number), len(passes) - 1)
    lost = np.flatnonzero(passes[which] != number)
    if len(lost):
        raise InputError(
            f"{where}: /profiles/pass[{lost[0]}]",
            f"pass {number[lost[0]]} has no robot poses; passes with poses: {', '.join(map(str, passes[:12]))}",
        )
    pose_time_s = values["robot_time_s"][order]
    start_s, end_s = pose_time_s[first][which], pose_time_s[first + count - 1][which]
    compared = (clock == "robot") & ~(is_calibration & (count[which] == 1))
    out = np.flatnonzero(compared & ((time_s < start_s) | (time_s > end_s)))
    if len(out):
        row = out[0]
        still = "; one pose suffices for a posture held still before a sphere: is /sphere missing?"
        raise InputError(
            f"{where}: /profiles/time[{row}]",
            f"expected a time within the poses of pass {number[row]}, {start_s[row]!s} to {end_s[row]!s} s, "
            f"found {time_s[row]!s} s{still if count[which][row] == 1 else ''}",
        )
