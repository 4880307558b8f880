"""`workbench view-cell`: a picture of a robot cell in a posture, and what there is to say of both."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np

from workbench.errors import OutputError, PipelineError
from workbench.robot.description import check_posture, described
from workbench.robot.picture import cell_picture
from workbench.robot.read import read_cell
from workbench.units import DEG, Float


def view_cell(cell_file: str, posture: str, turntable_deg: float, out: str) -> list[str]:
    """Draws the cell of a file to `out` (PNG); the lines to print.

    Args:
        cell_file: JSON or YAML.
        posture: six joint angles in deg, the controller's, separated by commas.
        turntable_deg: angle of the turntable.
        out: the picture's name.

    Raises:
        WorkbenchError: an unusable file or posture, a picture that cannot be drawn or written; then none is written.
    """
    picture = Path(out)
    if picture.suffix.lower() != ".png" or picture.is_dir():
        raise PipelineError(f"--out '{out}'", "expected the name of a picture that ends in .png")
    joints = _angles(posture) * DEG
    cell = read_cell(Path(cell_file))
    check_posture(cell, joints, turntable_deg * DEG)
    lines = described(cell, joints, turntable_deg * DEG)
    _write(picture, cell_picture(cell, joints, turntable_deg * DEG))
    return [*lines, f"picture: {out}"]


def _angles(text: str) -> Float:
    """Six numbers, separated by commas."""
    try:
        angles = np.array([float(part) for part in text.split(",")])
    except ValueError:
        angles = np.array([])
    if len(angles) != 6 or not np.isfinite(angles).all():
        raise PipelineError(f"--posture '{text}'", "expected six joint angles in deg, separated by commas")
    return angles


def _write(path: Path, content: bytes) -> None:
    """Whole or not at all."""
    beside = path.with_name(f".{path.name}.partial-{os.getpid()}")
    try:
        try:
            beside.write_bytes(content)
            os.replace(beside, path)
        finally:
            beside.unlink(missing_ok=True)
    except OSError as error:
        raise OutputError(str(path), f"cannot be written: {error.strerror}") from None
