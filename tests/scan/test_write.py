"""`write`: what was written is what is read, and nothing is left of what failed."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from pathlib import Path
from typing import Any, Literal

import h5py
import numpy as np
import pytest

from workbench.artefacts import Part, Recording
from workbench.errors import OutputError
from workbench.scan import read, write


@pytest.fixture
def recording(build: Callable[..., Path]) -> Recording:
    return read(recording=build())


def same(a: Recording, b: Recording) -> None:
    for field in dataclasses.fields(Recording):
        if field.name != "source":
            np.testing.assert_array_equal(getattr(a, field.name), getattr(b, field.name), err_msg=field.name)


@pytest.mark.parametrize("compression", [None, "gzip", "lzf"])
def test_what_was_written_is_read(
    recording: Recording, tmp_path: Path, compression: Literal["gzip", "lzf"] | None
) -> None:
    path = tmp_path / "again.h5"
    recording = dataclasses.replace(recording, part=Part(part_id="A-7", sensor="LPS 36", simulated=True))
    write(recording, path, compression=compression)
    same(read(recording=path), recording)
    with h5py.File(path) as file:
        assert file["profiles/x"].compression == compression
        assert file.attrs["sensor"] == "LPS 36"
        assert file.attrs["simulated"] == 1


@pytest.mark.parametrize(
    "changes",
    [
        {"flange_from_profiler": None, "intensity": None, "part": Part()},
        {"sphere_diameter_mm": 25.4, "clock": "own"},
    ],
)
def test_optional_parts_come_back(recording: Recording, tmp_path: Path, changes: dict[str, Any]) -> None:
    other = dataclasses.replace(recording, **changes)
    write(other, tmp_path / "again.h5")
    same(read(recording=tmp_path / "again.h5"), other)


def test_the_same_recording_gives_the_same_bytes(recording: Recording, tmp_path: Path) -> None:
    paths = [tmp_path / name for name in ("a.h5", "b.h5")]
    for path in paths:
        write(recording, path, compression="gzip")
    assert paths[0].read_bytes() == paths[1].read_bytes()


def test_a_failed_write_leaves_the_old_file_and_no_other(recording: Recording, tmp_path: Path) -> None:
    path = tmp_path / "again.h5"
    write(recording, path)
    before = path.read_bytes()
    broken = dataclasses.replace(recording, robot_position_mm=np.full(recording.robot_position_mm.shape, object()))
    with pytest.raises(TypeError):
        write(broken, path)
    assert path.read_bytes() == before
    assert not list(tmp_path.glob("*partial*"))


def test_an_unwritable_place_is_named(recording: Recording, tmp_path: Path) -> None:
    for path in (tmp_path / "none" / "part.h5", tmp_path / "part.h5" / "x.h5"):
        with pytest.raises(OutputError) as caught:
            write(recording, path)
        assert str(caught.value).startswith(f"{path}: ")
    (tmp_path / "folder").mkdir()
    with pytest.raises(OutputError):
        write(recording, tmp_path / "folder")
    assert not list(tmp_path.glob("*partial*"))
