"""Unpacking chunks ourselves gives what HDF5 gives, and damage is refused."""

from __future__ import annotations

import zlib
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from workbench.scan.read import read_frames, unpacks_here

FRAMES, COLUMNS = 23, 9


@pytest.fixture
def values() -> Any:
    grid = np.random.default_rng(3).normal(200, 5, (FRAMES, COLUMNS)).astype(np.float32)
    grid[4, 2:5] = np.nan
    return grid


FORMS: dict[str, tuple[dict[str, Any], bool]] = {
    "contiguous": ({}, False),
    "chunks not packed": ({"chunks": (5, COLUMNS)}, False),
    "gzip": ({"chunks": (5, COLUMNS), "compression": "gzip"}, True),
    "gzip and shuffle": ({"chunks": (5, COLUMNS), "compression": "gzip", "shuffle": True}, True),
    "one chunk": ({"chunks": (FRAMES, COLUMNS), "compression": "gzip", "shuffle": True}, True),
    "a frame a chunk": ({"chunks": (1, COLUMNS), "compression": "gzip", "shuffle": True}, True),
    "chunks across frames": ({"chunks": (5, 4), "compression": "gzip", "shuffle": True}, False),
    "with checksums": ({"chunks": (5, COLUMNS), "compression": "gzip", "fletcher32": True}, False),
    "lzf": ({"chunks": (5, COLUMNS), "compression": "lzf"}, False),
    "half precision": ({"chunks": (5, COLUMNS), "compression": "gzip", "dtype": "f2"}, False),
    "big-endian": ({"chunks": (5, COLUMNS), "compression": "gzip", "shuffle": True, "dtype": ">f4"}, False),
}


@pytest.mark.parametrize("block", [7, FRAMES])
@pytest.mark.parametrize(("storage", "here"), FORMS.values(), ids=FORMS)
def test_every_form_as_hdf5_reads_it(
    tmp_path: Path, values: Any, storage: dict[str, Any], here: bool, block: int
) -> None:
    """Blocks of 7 frames begin and end within chunks of 5."""
    out = np.full(values.shape, -1, np.float32)
    with h5py.File(tmp_path / "grid.h5", "w") as file:
        dataset = file.create_dataset("z", data=values, **storage)
        assert unpacks_here(dataset, out) is here
        for first in range(0, FRAMES, block):
            before = out.copy()
            read_frames(dataset, out[first : first + block], first)
            np.testing.assert_array_equal(out[:first], before[:first])
            np.testing.assert_array_equal(out[first + block :], before[first + block :])
        np.testing.assert_array_equal(out, dataset[()])


def test_a_chunk_that_was_stored_without_its_filters(tmp_path: Path, values: Any) -> None:
    with h5py.File(tmp_path / "grid.h5", "w") as file:
        dataset = file.create_dataset("z", data=values, chunks=(5, COLUMNS), compression="gzip", shuffle=True)
        dataset.id.write_direct_chunk((5, 0), np.ascontiguousarray(values[:5]).tobytes(), filter_mask=3)
        out = np.empty_like(values)
        read_frames(dataset, out, 0)
    np.testing.assert_array_equal(out[5:10], values[:5])


@pytest.mark.parametrize(
    ("chunk", "message"),
    [
        (b"not deflated", "incorrect header check"),
        (zlib.compress(bytes(5 * COLUMNS * 4))[:-6], "expected a chunk of 180 bytes, found [0-9]+ without an end"),
        (zlib.compress(bytes(5 * COLUMNS * 4))[:-1], "found 180 without an end"),  # its checksum is cut off
        (zlib.compress(bytes(10)), "found 10$"),
        (zlib.compress(bytes(10**6)), "found 181"),  # unpacked no further than that
    ],
)
def test_damage_is_refused(tmp_path: Path, values: Any, chunk: bytes, message: str) -> None:
    with h5py.File(tmp_path / "grid.h5", "w") as file:
        dataset = file.create_dataset("z", data=values, chunks=(5, COLUMNS), compression="gzip", shuffle=True)
        dataset.id.write_direct_chunk((10, 0), chunk)
        with pytest.raises(OSError, match=rf"/z\[10\]: .*{message}"):
            read_frames(dataset, np.empty_like(values), 0)
