"""Room on disk, asked for before writing: HDF5 may end the process when a disk fills up under it."""

from __future__ import annotations

import shutil
from pathlib import Path

from workbench.errors import OutputError

MEGABYTE = 1e6
SPARE_BYTES = 1_000_000  # for headers and tables beside the grids


def require_space(path: Path, grid_bytes: int) -> None:
    """Refuse to write `grid_bytes` to the file `path` where its disk has not that much left, uncompressed.

    Raises:
        OutputError: too little room; or the folder does not exist.
    """
    needed = grid_bytes + SPARE_BYTES
    try:
        free = shutil.disk_usage(path.parent).free
    except OSError as error:
        raise OutputError(str(path), f"cannot be written: {error.strerror}") from None
    if free < needed:
        raise OutputError(
            str(path), f"expected {needed / MEGABYTE:.0f} MB of free disk, found {free / MEGABYTE:.0f} MB"
        )
