"""Writing a profile recording (INTERFACES section 1), whole or not at all."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterable
from dataclasses import fields
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np

from workbench.artefacts import PartNames, Recording
from workbench.errors import OutputError
from workbench.storage import new_hdf5, partial_path
from workbench.units import AnyArray

CHUNK_BYTES = 2**18  # of one data set: large enough to compress well, small enough for the cache


class Frames(NamedTuple):
    """Some frames of a recording: F frames of M columns."""

    x_mm: AnyArray  # (F, M)
    z_mm: AnyArray  # (F, M)
    intensity: AnyArray | None  # (F, M)


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

    Example:
        >>> import tempfile
        >>> from workbench import scan
        >>> recording = scan.read(recording="data/synthetic/milled_edge.h5")
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     copy = Path(folder) / "copy.h5"
        ...     write(recording, copy)
        ...     scan.read(recording=copy).z_mm.shape == recording.z_mm.shape
        True
    """
    partial = partial_path(path)
    grids = Frames(recording.x_mm, recording.z_mm, recording.intensity)
    try:
        fill(partial, recording, [grids], compression)
        os.replace(partial, path)
    except OSError as error:
        raise OutputError(str(path), f"cannot be written: {error.strerror or error}") from None
    finally:
        with contextlib.suppress(OSError):
            partial.unlink()


def fill(path: Path, recording: Recording, frames: Iterable[Frames], compression: str | None) -> None:
    """Write the HDF5 file `path` in place: all but the grids from `recording`, those from `frames`, one after another.

    Of the recording's own grids only shape and type count here, so that long recordings need little memory.

    Raises:
        OSError: too little room, or whatever else the file system says.
    """
    grids = Frames(recording.x_mm, recording.z_mm, recording.intensity)
    with new_hdf5(path, sum(grid.nbytes for grid in grids if grid is not None)) as file:
        _header(file, recording)
        sets = [
            None if grid is None else file.create_dataset(f"profiles/{name}", **_storage(grid, compression))
            for name, grid in zip(("x", "z", "intensity"), grids, strict=True)
        ]
        done = 0
        for block in frames:
            rows = slice(done, done + len(block.x_mm))
            for values, into in zip(block, sets, strict=True):
                if into is not None:
                    into[rows] = values
            done = rows.stop


def _header(file: Any, recording: Recording) -> None:
    """Everything but the grids."""
    header: dict[str, str | int] = {"format": "profile-recording", "version": 1, "length_unit": "mm", "time_unit": "s"}
    part = {field.name: getattr(recording.part, field.name) for field in fields(PartNames)}
    if recording.part.simulated is not None:
        header["simulated"] = int(recording.part.simulated)
    if recording.part.scan_plan is not None:
        header["scan_plan"] = recording.part.scan_plan
    if recording.not_confirmed:
        header["not_confirmed"] = "\n".join(recording.not_confirmed)
    file.attrs.update({**{name: text for name, text in part.items() if text is not None}, **header})
    profiles, robot = file.create_group("profiles"), file.create_group("robot")
    if recording.clock == "own":
        profiles.attrs["clock"] = "own"
    profiles["time"] = recording.time_s
    profiles["pass"] = recording.pass_index.astype(np.int32)
    robot["time"] = recording.robot_time_s
    robot["position"] = recording.robot_position_mm
    robot["quaternion_wxyz"] = recording.robot_quaternion_wxyz
    robot["pass"] = recording.robot_pass.astype(np.int32)
    if recording.flange_from_profiler is not None:
        file["hand_eye/flange_from_profiler"] = recording.flange_from_profiler
    if recording.sphere_diameter_mm is not None:
        file.create_group("sphere").attrs["diameter_mm"] = recording.sphere_diameter_mm


def _storage(grid: AnyArray, compression: str | None) -> dict[str, Any]:
    """Contiguous, or whole frames a chunk: the reader goes by frames."""
    (frames, columns), form = grid.shape, {"shape": grid.shape, "dtype": grid.dtype}
    if compression is None:
        return form
    rows = min(frames, max(1, CHUNK_BYTES // (columns * grid.itemsize)))
    return {**form, "chunks": (rows, columns), "compression": compression, "shuffle": True}
