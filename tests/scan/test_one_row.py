"""x that all frames share is in memory once, and everything is as if each frame had its own."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import h5py
import numpy as np
import pytest

from workbench.artefacts import Inspection, Recording
from workbench.cloud import denoise
from workbench.edge import segment
from workbench.geometry.blocks import is_repeated
from workbench.inspect import sections
from workbench.scan import fuse, read

DATA = Path(__file__).parents[2] / "data" / "synthetic"


def with_own_x(recording: Recording) -> Recording:
    return dataclasses.replace(recording, x_mm=np.array(recording.x_mm))


def inspected(recording: Recording) -> Inspection:
    return sections(segment(denoise(fuse(recording))))


@pytest.mark.parametrize("name", ["milled_edge"])
def test_an_inspection_is_the_same_to_the_byte(name: str) -> None:
    recording = read(recording=DATA / f"{name}.h5")
    assert is_repeated(recording.x_mm)
    one, other = inspected(recording), inspected(with_own_x(recording))
    for field in dataclasses.fields(one.profile):
        a, b = getattr(one.profile, field.name), getattr(other.profile, field.name)
        if isinstance(a, np.ndarray):
            assert a.tobytes() == b.tobytes(), field.name
    assert [check.value for check in one.checks] == [check.value for check in other.checks]


@pytest.mark.parametrize("block_bytes", [1, 2**22])
@pytest.mark.parametrize("compression", [None, "gzip"])
def test_frames_that_differ_are_read_with_their_own(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, compression: str | None, block_bytes: int
) -> None:
    """Blocks before and after the one that shows it are filled in."""
    monkeypatch.setattr("workbench.scan.read_stage.BLOCK_BYTES", block_bytes)
    path = tmp_path / "scan.h5"
    path.write_bytes((DATA / "milled_edge.h5").read_bytes())
    with h5py.File(path, "r+") as file:
        x = file["profiles/x"][()]
        x[100, 7] += 1.0
        x[200, 3] = np.nan
        del file["profiles/x"]
        chunks = {"compression": compression, "chunks": (16, x.shape[1])} if compression else {}
        file.create_dataset("profiles/x", data=x, **chunks)
    found = read(recording=path)
    assert not is_repeated(found.x_mm)
    np.testing.assert_array_equal(found.x_mm, x)
