"""What cannot be used ends with 2, one line and nothing behind."""

from __future__ import annotations

import json
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


NOT_EDGES: dict[str, Callable[[Arrays], Arrays]] = {
    "flat plate": _of_x(lambda x, r: 100 + 0.4 * x + r.normal(0, 0.012, x.shape)),
    "corner of 90 deg": _of_x(lambda x, r: 100 + np.abs(x) + r.normal(0, 0.012, x.shape)),
    "noise": _of_x(lambda x, r: r.uniform(80, 120, x.shape)),
    "cylinder": _of_x(lambda x, r: 130 - np.sqrt(900 - x**2) + r.normal(0, 0.012, x.shape)),
    "step": _of_x(lambda x, r: 100 + 5 * (x > 0) + r.normal(0, 0.012, x.shape)),
    "constant": _of_x(lambda x, r: 0 * x),
}


@pytest.mark.parametrize("kind", NOT_EDGES)
def test_what_is_no_milled_edge_is_refused(kind: str, run: Run, setting: Setting, folder: Path) -> None:
    arrays = NOT_EDGES[kind](record(Part(), [SHORT], setting))
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


def _set(path: str, change: Callable[[np.ndarray], np.ndarray]) -> Callable[[Path], None]:
    def edit(file: Path) -> None:
        with h5py.File(file, "r+") as handle:
            value = change(handle[path][()])
            del handle[path]
            handle[path] = value

    return edit


def _attribute(name: str, value: object) -> Callable[[Path], None]:
    def edit(file: Path) -> None:
        with h5py.File(file, "r+") as handle:
            handle.attrs[name] = value

    return edit


def _at(index: object, value: float) -> Callable[[np.ndarray], np.ndarray]:
    def change(array: np.ndarray) -> np.ndarray:
        out = array.copy()
        out[index] = value
        return out

    return change


BROKEN: dict[str, tuple[Callable[[Path], None], str]] = {
    "unit": (_attribute("length_unit", "inch"), "length_unit"),
    "version": (_attribute("version", 2), "version"),
    "format": (_attribute("format", "point-cloud"), "format"),
    "truncated": (lambda p: p.write_bytes(p.read_bytes()[: p.stat().st_size // 2]), "broken.h5"),
    "text": (lambda p: p.write_text("x z\n1 2\n"), "broken.h5"),
    "empty": (lambda p: p.write_bytes(b""), "broken.h5"),
    "times fall": (_set("/profiles/time", lambda t: t[::-1].copy()), "/profiles/time"),
    "frames outside poses": (_set("/profiles/time", lambda t: t + 0.01), "/profiles/time"),
    "infinite range": (_set("/profiles/z", _at((3, 100), np.inf)), "/profiles/z"),
    "lost pose": (_set("/robot/position", _at((0, 1), np.nan)), "/robot/position"),
    "long quaternion": (_set("/robot/quaternion_wxyz", lambda q: 1.01 * q), "/robot/quaternion_wxyz"),
    "mirrored hand-eye": (_set("/hand_eye/flange_from_profiler", lambda h: h * [-1, 1, 1, 1]), "/hand_eye"),
    "shapes": (_set("/profiles/z", lambda z: z[:, :-1]), "/profiles/z"),
    "all NaN": (_set("/profiles/x", lambda x: x * np.nan), "/profiles"),
    "unknown pass": (_set("/profiles/pass", lambda p: p + 1), "/profiles/pass"),
}


@pytest.mark.parametrize("kind", BROKEN)
def test_a_broken_recording_is_refused_at_its_place(kind: str, run: Run, setting: Setting, folder: Path) -> None:
    path = write(folder / "broken.h5", record(Part(), [SHORT], setting))
    damage, place = BROKEN[kind]
    damage(path)
    refused(run(path), "broken.h5", place)


def test_a_sphere_recording_is_refused(run: Run, setting: Setting, folder: Path) -> None:
    ball = _of_x(lambda x, r: 112 - np.sqrt(np.where(np.abs(x) < 6, 161.3 - x**2, np.nan)) + r.normal(0, 0.01, x.shape))
    path = write(folder / "sphere.h5", ball(record(Part(), [SHORT], setting)))
    with h5py.File(path, "r+") as file:
        file.create_group("sphere").attrs["diameter_mm"] = 12.7
    refused(run(path), "sphere.h5")


ARGUMENTS = {
    "input typo": (["--input", "root_nominl_mm=1.5"], "root_nominal_mm"),
    "input type": (["--input", "sections=nine"], "sections"),
    "input range": (["--input", "root_nominal_mm=-1"], "root_nominal_mm"),
    "limits in the wrong order": (["--input", "bevel_tolerance_deg=[1, -1]"], "bevel_tolerance_deg"),
    "limits on one side": (["--input", "root_tolerance_mm=[0.1, 0.5]"], "root_tolerance_mm"),
    "NaN": (["--input", "bevel_nominal_deg=NaN"], "bevel_nominal_deg"),
    "set typo": (["--set", "inspect.sections.section=3"], "sections"),
    "stage typo": (["--set", "inspect.sectons.sections=3"], "inspect.sections"),
    "no equals sign": (["--input", "sections"], "sections"),
    "no such option": (["--inputs", "sections=3"], "--input"),
    "no such file": (["--input", "recording=nowhere.h5"], "nowhere.h5"),
    "a directory": (["--input", "recording=."], "."),
}


@pytest.mark.parametrize("kind", ARGUMENTS)
def test_arguments_are_refused_with_the_right_name(kind: str, run: Run, easy: Path) -> None:
    extra, word = ARGUMENTS[kind]
    refused(run(easy, *extra), word)


DOCUMENTS: dict[str, tuple[Callable[[dict], object], str]] = {
    "stage": (lambda d: d["stages"][2].update(stage="cloud.denoize"), "cloud.denoise"),
    "key": (lambda d: d["stages"][4].update(secions=3), "sections"),
    "input": (lambda d: d["stages"][4].update(sections="${section}"), "sections"),
    "version": (lambda d: d.update(version=2), "version"),
    "order": (lambda d: d["stages"].reverse(), "stages"),
    "missing source": (lambda d: d["stages"].pop(1), "stages"),
    "no stages": (lambda d: d.update(stages=[]), "stages"),
    "foreign key": (lambda d: d.update(stage=1), "stages"),
}


@pytest.mark.parametrize("kind", DOCUMENTS)
def test_documents_are_refused_before_anything_runs(
    kind: str, command: Run, quick: Path, easy: Path, tmp_path: Path
) -> None:
    document = json.loads(quick.read_text())
    document["inputs"]["recording"] = str(easy)
    change, word = DOCUMENTS[kind]
    change(document)
    (tmp_path / "bad.json").write_text(json.dumps(document))
    ended = command("run", tmp_path / "bad.json")
    line = refused(ended, "bad.json", word)
    assert "[1/" not in ended.err
    validated = command("validate", tmp_path / "bad.json")
    assert validated.status == 2
    assert validated.err.strip() == line


def test_bad_json_names_line_and_column(command: Run, tmp_path: Path) -> None:
    (tmp_path / "bad.json").write_text('{"version": 1,\n "stages": [}\n')
    line = refused(command("run", tmp_path / "bad.json"), "bad.json")
    assert "line 2" in line or ":2:" in line


def test_an_output_that_cannot_be(command: Run, quick: Path, easy: Path, tmp_path: Path) -> None:
    (tmp_path / "out").write_text("somebody's file")
    ended = command("run", quick, "--input", f"recording={easy}")
    assert ended.status == 2
    assert ended.err.startswith("error: ")
    assert len(ended.err.splitlines()) == 1
    assert (tmp_path / "out").read_text() == "somebody's file"


def test_a_refused_run_leaves_no_older_result_that_looks_new(run: Run, easy: Path, tmp_path: Path) -> None:
    assert run(easy).status == 0
    (tmp_path / "out" / "notes.txt").write_text("mine")
    (tmp_path / "bad.h5").write_bytes(b"\x89HDF")
    assert run(tmp_path / "bad.h5").status == 2
    left = {one.name for one in (tmp_path / "out").iterdir()}
    assert "notes.txt" in left
    assert not left & {"inspection.json", "run.json", "report.html"}
