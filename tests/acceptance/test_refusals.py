"""What cannot be used ends with 2, one line and nothing behind."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest

from .conftest import SCAN, Ended
from .hdf import write
from .stranger import Part, Scan, Setting, record

Run = Callable[..., Ended]
SHORT = replace(SCAN, start_mm=40.0, stop_mm=60.0, columns=400)
RAW = Part(root_mm=(8.0, 8.0))
Arrays = dict[str, np.ndarray]


def refused(ended: Ended, *words: str) -> str:
    """The one line, once it is known to be one and to name `words`."""
    lines = [line for line in ended.err.splitlines() if not line.startswith(("[", "compiling"))]
    assert ended.status == 2, ended.out
    assert len(lines) == 1, lines
    assert lines[0].startswith("error: ")
    assert "failed inside" not in lines[0]
    for word in words:
        assert word in lines[0]
    assert not ended.directory.exists() or not list(ended.directory.iterdir())
    return lines[0]


def _of_x(make: Callable[[np.ndarray, np.random.Generator], np.ndarray]) -> Callable[[Arrays], Arrays]:
    return lambda arrays: (
        arrays
        | {
            "/profiles/z": make(arrays["/profiles/x"], np.random.default_rng(2)).astype("f4"),
        }
    )


def test_a_sensor_that_says_nothing_is_refused(run: Run, setting: Setting, folder: Path) -> None:
    """Shapes that are no bevel: tests/checks/test_faces.py."""
    arrays = _of_x(lambda x, r: 0 * x)(record(Part(), [SHORT], setting))
    refused(run(write(folder / "odd.h5", arrays)), "odd.h5")


def test_a_corrugated_sheet_never_passes(run: Run, setting: Setting, folder: Path) -> None:
    """Its flanks are nearly plane for a millimetre, so that it may be measured; it is no bevel of 40 deg."""
    sheet = _of_x(lambda x, r: 100 + 2 * np.sin(x) + r.normal(0, 0.012, x.shape))
    ended = run(write(folder / "sheet.h5", sheet(record(Part(), [SHORT], setting))))
    if ended.status != 1:
        refused(ended, "sheet.h5")


@pytest.mark.parametrize("scan", [SHORT, replace(SHORT, elevation_deg=0), replace(SHORT, elevation_deg=-30)])
def test_a_raw_edge_is_refused(scan: Scan, run: Run, setting: Setting, folder: Path) -> None:
    refused(run(write(folder / "raw.h5", record(RAW, [scan], setting))), "raw.h5", "no edge")


def test_a_single_frame_is_refused(run: Run, setting: Setting, folder: Path) -> None:
    one = replace(SHORT, stop_mm=40.1)
    refused(run(write(folder / "one.h5", record(Part(), [one], setting))), "one.h5", "single frame")


@pytest.mark.parametrize("frames", [2, 3])
def test_very_few_frames_never_break_it(frames: int, run: Run, setting: Setting, folder: Path) -> None:
    few = replace(SHORT, stop_mm=40 + 0.5 * (frames - 0.5))
    ended = run(write(folder / "few.h5", record(Part(), [few], setting)))
    if ended.status == 2:
        refused(ended, "few.h5")
    else:
        for section in ended.read()["sections"]:
            if section["root_mm"] is not None:
                assert abs(section["root_mm"] - 1.5) < max(4 * section["root_u_mm"], 0.05)


def test_a_scanner_at_rest_is_refused_in_words(run: Run, setting: Setting, folder: Path) -> None:
    rest = replace(SHORT, stop_mm=40.002, pitch_mm=0.0001)
    refused(run(write(folder / "rest.h5", record(Part(), [rest], setting))), "rest.h5")


def test_a_sphere_recording_is_refused(run: Run, setting: Setting, folder: Path) -> None:
    ball = _of_x(lambda x, r: 112 - np.sqrt(np.where(np.abs(x) < 6, 161.3 - x**2, np.nan)) + r.normal(0, 0.01, x.shape))
    path = write(folder / "sphere.h5", ball(record(Part(), [SHORT], setting)))
    with h5py.File(path, "r+") as file:
        file.create_group("sphere").attrs["diameter_mm"] = 12.7
    refused(run(path), "sphere.h5")
