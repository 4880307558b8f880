"""Writing a profile recording (INTERFACES section 1), whole or not at all."""

from __future__ import annotations

import contextlib
import os
from dataclasses import fields
from pathlib import Path
from typing import Any, Literal

import numpy as np

from workbench.artefacts import PartNames, Recording
from workbench.errors import OutputError
from workbench.storage import beside, require_space

CHUNK_BYTES = 2**18  # of one data set: large enough to compress well, small enough for the cache


def write(
    recording: Recording,
    path: Path,
    *,
    compression: Literal["gzip", "lzf"] | None = None,
) -> None:
    """Write `recording` to `path` as HDF5, beside it first and then renamed, so that a killed run leaves no half file.

    Args:
        recording: what `scan.read` would return.
        path: the file; replaced if it exists.
        compression: None is the fastest to read; gzip (with shuffle) makes about a third of it.

    Raises:
        OutputError: the file cannot be written.
    """
    import h5py

    grids = [g for g in (recording.x_mm, recording.z_mm, recording.intensity) if g is not None]
    require_space(path, sum(g.nbytes for g in grids))
    partial = beside(path)
    try:
        try:
            with h5py.File(partial, "w") as file:
                _fill(file, recording, compression)
            os.replace(partial, path)
        finally:
            with contextlib.suppress(FileNotFoundError):
                partial.unlink()
    except (OSError, RuntimeError) as error:
        raise OutputError(str(path), f"cannot be written: {error}") from None


def _fill(file: Any, recording: Recording, compression: str | None) -> None:
    header: dict[str, str | int] = {"format": "profile-recording", "version": 1, "length_unit": "mm", "time_unit": "s"}
    part = {field.name: getattr(recording.part, field.name) for field in fields(PartNames)}
    if recording.part.simulated is not None:
        header["simulated"] = int(recording.part.simulated)
    if recording.not_confirmed:
        header["not_confirmed"] = "\n".join(recording.not_confirmed)
    file.attrs.update({**{name: text for name, text in part.items() if text is not None}, **header})
    profiles, robot = file.create_group("profiles"), file.create_group("robot")
    if recording.clock == "own":
        profiles.attrs["clock"] = "own"
    profiles["time"] = recording.time_s
    profiles["pass"] = recording.pass_index.astype(np.int32)
    for name, grid in (("x", recording.x_mm), ("z", recording.z_mm), ("intensity", recording.intensity)):
        if grid is not None:
            profiles.create_dataset(name, data=grid, **_storage(grid.shape, grid.itemsize, compression))
    robot["time"] = recording.robot_time_s
    robot["position"] = recording.robot_position_mm
    robot["quaternion_wxyz"] = recording.robot_quaternion_wxyz
    robot["pass"] = recording.robot_pass.astype(np.int32)
    if recording.flange_from_profiler is not None:
        file["hand_eye/flange_from_profiler"] = recording.flange_from_profiler
    if recording.sphere_diameter_mm is not None:
        file.create_group("sphere").attrs["diameter_mm"] = recording.sphere_diameter_mm


def _storage(shape: tuple[int, ...], itemsize: int, compression: str | None) -> dict[str, Any]:
    """Contiguous, or whole frames a chunk: the reader goes by frames."""
    if compression is None:
        return {}
    frames, columns = shape
    rows = min(frames, max(1, CHUNK_BYTES // (columns * itemsize)))
    return {"chunks": (rows, columns), "compression": compression, "shuffle": True}
