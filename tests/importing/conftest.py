"""A synthetic recording as strangers' files: profiles as a table, poses in any controller's convention.

Orientations are written by scipy, whose conventions are none of ours.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from workbench.artefacts import Recording
from workbench.importing.command import import_files
from workbench.scan import read
from workbench.units import Float

SYNTHETIC = Path(__file__).parents[2] / "data" / "synthetic"
MAPPING: dict[str, Any] = {"format": "import-mapping", "version": 1}


def turned(quaternion_wxyz: Float) -> Rotation:
    return Rotation.from_quat(np.roll(quaternion_wxyz, -1, axis=1))


ORIENTATIONS: dict[str, Callable[[Rotation], Float]] = {  # convention -> its columns, angles in deg unless told
    "quaternion_wxyz": lambda r: np.roll(r.as_quat(), 1, axis=1),
    "quaternion_xyzw": lambda r: r.as_quat(),
    "abb": lambda r: np.roll(r.as_quat(), 1, axis=1),
    "fanuc_wpr": lambda r: r.as_euler("xyz", degrees=True),
    "kuka_abc": lambda r: r.as_euler("ZYX", degrees=True),
    "ur": lambda r: r.as_rotvec(),
    "euler_zyz_intrinsic": lambda r: r.as_euler("ZYZ", degrees=True),
    "euler_xyz_extrinsic": lambda r: r.as_euler("xyz", degrees=True),
    "rotation_vector": lambda r: r.as_rotvec(degrees=True),
}


def rows_of(table: Iterable[Iterable[float]], delimiter: str = ",", decimal: str = ".") -> str:
    """Numbers with all their digits; NaN as an empty cell."""
    lines = (delimiter.join("" if v != v else repr(v).replace(".", decimal) for v in row) for row in table)
    return "\n".join(lines) + "\n"


def write_profiles(path: Path, recording: Recording, delimiter: str = ",", decimal: str = ".") -> Path:
    """One row a point: frame, time, x, z, intensity where there is one."""
    frames, columns = recording.z_mm.shape
    table = [
        np.repeat(np.arange(frames), columns).tolist(),
        np.repeat(recording.time_s, columns).tolist(),
        recording.x_mm.astype(float).ravel().tolist(),
        recording.z_mm.astype(float).ravel().tolist(),
    ]
    header = delimiter.join(["profile", "t", "X [µm]", "Z"])
    path.write_text(header + "\n" + rows_of(zip(*table, strict=True), delimiter, decimal), encoding="cp1252")
    return path


def write_poses(
    path: Path, recording: Recording, convention: str = "quaternion_wxyz", unit_mm: float = 1.0, with_pass: bool = False
) -> Path:
    """One row a pose: t, X, Y, Z, o0, o1, ...."""
    values = ORIENTATIONS[convention](turned(recording.robot_quaternion_wxyz))
    columns = [recording.robot_time_s[:, None], recording.robot_position_mm / unit_mm, values]
    header = ["t", "X", "Y", "Z", *(f"o{i}" for i in range(values.shape[1]))]
    if with_pass:
        columns.append(recording.robot_pass[:, None])
        header.append("n")
    path.write_text(",".join(header) + "\n" + rows_of(np.hstack(columns).tolist()))
    return path


def profiles_part(**changes: Any) -> dict[str, Any]:
    columns = {"x": "X [µm]", "z": "Z", "frame": "profile", "time": "t"}
    return {"files": "scan*", "length_unit": "mm", "time_unit": "s", "frames": "column", "columns": columns, **changes}


def poses_part(convention: str = "quaternion_wxyz", **changes: Any) -> dict[str, Any]:
    count = 4 if convention.startswith(("quat", "abb")) else 3
    orientation = [f"o{i}" for i in range(count)]
    unit = {} if count == 4 or convention in ("ur", "fanuc_wpr", "kuka_abc") else {"angle_unit": "deg"}
    part = {"files": "robot*", "length_unit": "mm", "time_unit": "s", "time": "t", "position": ["X", "Y", "Z"]}
    return {**part, "orientation": orientation, "convention": convention, **unit, **changes}


@pytest.fixture
def mapped(tmp_path: Path) -> Callable[..., Path]:
    """Write a mapping file of some parts."""

    def written(**parts: Any) -> Path:
        path = tmp_path / "map.json"
        path.write_text(json.dumps({**MAPPING, **parts}), encoding="utf-8")
        return path

    return written


@pytest.fixture
def imported(tmp_path: Path) -> Callable[..., Recording]:
    """Import sources and read the recording that was written."""

    def made(*sources: Path, mapping: Path | None = None) -> Recording:
        out = tmp_path / "imported.h5"
        import_files(sources, out, mapping)
        return read(recording=out)

    return made


@pytest.fixture
def shop(tmp_path: Path, imported: Callable[..., Recording], mapped: Callable[..., Path]) -> Callable[..., Recording]:
    """`shop(profiles, poses, convention, ...)`: recordings as a scanner's and a robot's file, imported together.

    Parts of the mapping may be others; `profiles` and `poses` of them are what such files are, changed.
    """

    def made(scan: Recording, robot: Recording, convention: str = "quaternion_wxyz", **parts: Any) -> Recording:
        sources = write_profiles(tmp_path / "scan.csv", scan), write_poses(tmp_path / "robot.csv", robot, convention)
        told = {"profiles": profiles_part(**parts.pop("profiles", {}))}
        told |= {"poses": poses_part(convention, **parts.pop("poses", {}))}
        return imported(*sources, mapping=mapped(**told, **parts))

    return made


@pytest.fixture(scope="session")
def milled() -> Recording:
    return read(recording=SYNTHETIC / "milled_edge.h5")


@pytest.fixture(scope="session")
def two_pass() -> Recording:
    return read(recording=SYNTHETIC / "milled_two_pass.h5")
