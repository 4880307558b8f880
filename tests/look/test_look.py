"""`workbench look`: whatever can be read is told and shown; what cannot ends in one line."""

import re
import shutil
from pathlib import Path

import h5py
import numpy as np
import pytest

from bench.recordings import frames
from tests.importing.makers import write_gocator, write_gopxl
from workbench.scan import read, write

ROOT = Path(__file__).parents[2]
SYNTHETIC = ROOT / "data" / "synthetic"


def test_a_recording_is_told_and_shown(command, tmp_path):
    out = tmp_path / "page.html"
    got = command("look", SYNTHETIC / "milled_edge.h5", "--out", out)
    assert (got.status, got.err) == (0, "")
    assert "309 frames of 600 columns" in got.out
    assert "deg off the laser plane's normal" in got.out
    assert re.search(r"checks: \d\d passed, 0 failed", got.out)
    assert "conventions that would" not in got.out
    page = out.read_text()
    assert 'class="scene"' in page
    assert "http" not in page.replace('http-equiv="Content-Security-Policy"', "")
    assert "default-src &#39;none&#39;" in page


def test_a_recording_that_no_stage_takes_is_shown_with_the_reason(command, tmp_path):
    path = tmp_path / "back.h5"
    shutil.copy(SYNTHETIC / "milled_edge.h5", path)
    with h5py.File(path, "r+") as file:
        file["/profiles/time"][5] = file["/profiles/time"][4]
    got = command("look", path, "--out", tmp_path / "page.html")
    assert got.status == 0
    assert "FAIL recording_read" in got.out
    assert "expected times that rise" in got.out
    assert (tmp_path / "page.html").exists()


@pytest.mark.parametrize(
    ("name", "says"),
    [("sphere.h5", "calibration recording"), ("milled_edge.laz", "cloud without a grid"), ("two_pass", "pass 1")],
)
def test_whatever_the_project_ships(command, name, says):
    path = SYNTHETIC / ("milled_two_pass.h5" if name == "two_pass" else name)
    got = command("look", path)
    assert got.status == 0
    assert says in got.out


def test_vendors_files(command, tmp_path):
    surface = command("look", write_gocator(tmp_path / "s.csv"), "--out", tmp_path / "s.html")
    assert surface.status == 0
    assert "y is the way along the scan" in surface.out
    profile = command("look", write_gopxl(tmp_path / "p.csv"), "--out", tmp_path / "p.html")
    assert profile.status == 0
    assert "needs frames along its edge" in profile.out
    assert '<img src="data:image/svg+xml' in (tmp_path / "p.html").read_text()


@pytest.mark.parametrize("content", [b"", b"hello\n", b"\0" * 4000, b"a,b\n1,2\n"])
def test_what_cannot_be_read_ends_in_one_line(command, tmp_path, content):
    path = tmp_path / "x.csv"
    path.write_bytes(content)
    got = command("look", path, "--out", tmp_path / "x.html")
    assert got.status == 2
    assert got.err.startswith("error: ")
    assert got.err.count("\n") == 1
    assert not (tmp_path / "x.html").exists()


def test_the_page_wants_a_place_and_a_name(command, tmp_path):
    assert "ending in .html" in command("look", SYNTHETIC / "milled_edge.laz", "--out", tmp_path / "a.png").err
    assert (
        "cannot be written" in command("look", SYNTHETIC / "milled_edge.laz", "--out", tmp_path / "no" / "a.html").err
    )


def test_no_file_of_another_kind_is_replaced(command, tmp_path):
    other = tmp_path / "report.html"
    other.write_text("<!doctype html><title>Report</title>\n")
    found = command("look", SYNTHETIC / "milled_edge.laz", "--out", other)
    assert found.status == 2
    assert "would be lost" in found.err
    assert other.read_text() == "<!doctype html><title>Report</title>\n"


def test_a_page_is_written_anew(command, tmp_path):
    page = tmp_path / "page.html"
    assert [command("look", SYNTHETIC / "milled_edge.laz", "--out", page).status for _ in range(2)] == [0, 0]


def lines_named(got) -> list[str]:
    lines = got.out.splitlines()
    at = lines.index("conventions that would make this consistent:")
    return [line.strip() for line in lines[at + 1 :] if line.startswith("  ")]


def scaled(by, *places):
    """Numbers in another unit: of a pose the translation."""

    def change(file):
        for place in places:
            value = file[place][...]
            value[(slice(3), 3) if value.shape == (4, 4) else ...] *= by
            file[place][...] = value

    return change


def swapped(file):
    x, z = file["profiles/x"][...], file["profiles/z"][...]
    file["profiles/x"][...], file["profiles/z"][...] = z, x


def rolled(file):
    file["/robot/quaternion_wxyz"][...] = np.roll(file["/robot/quaternion_wxyz"][...], -1, axis=1)


X, Z = "profiles/x", "profiles/z"
POSE = "hand_eye/flange_from_profiler"
CONVENTIONS = [
    (["milled_arc"], scaled(1e-3, "robot/position"), "the robot's positions are in metres"),
    (["milled_arc"], scaled(1e-3, POSE), "the hand-eye pose's translation is in metres"),
    (["milled_edge", "raw_edge"], scaled(1e3, X, Z), "the profiles' x and z are in micrometres"),
    (["milled_edge", "raw_edge"], scaled(1e3, Z), "the profiles' z, but not their x, are in micrometres"),
    (["milled_edge", "raw_edge"], scaled(1e-3, X, Z), "the profiles' x and z are in metres"),
    (["milled_edge"], rolled, "quaternions are stored x y z w, not w x y z"),
    (["milled_arc", "groove"], swapped, "the profiles' x and z are swapped (signs unknown)"),
]


@pytest.mark.parametrize(
    ("name", "change", "said"), [(name, change, said) for names, change, said in CONVENTIONS for name in names]
)
def test_the_convention_that_makes_it_consistent_is_named_alone(name, change, said, command, tmp_path):
    """Micrometres are more than any length in mm may be: no stage reads them, and the unit is named all the same."""
    path = tmp_path / "changed.h5"
    recording = read(recording=SYNTHETIC / f"{name}.h5")
    write(frames(recording, np.arange(0, len(recording.time_s), 4)), path)
    with h5py.File(path, "r+") as file:
        change(file)
    got = command("look", path)
    assert "FAIL" in got.out
    assert ("FAIL recording_read" in got.out) is ("micrometres" in said)
    assert [line.partition(" (laser plane")[0] for line in lines_named(got)] == [said]


def test_a_code_for_no_return_is_no_unit(command, tmp_path):
    path = tmp_path / "coded.h5"
    shutil.copy(SYNTHETIC / "milled_edge.h5", path)
    with h5py.File(path, "r+") as file:
        z = file["profiles/z"][...]
        file["profiles/z"][...] = np.where(np.isnan(z), 999999.0, z)
    got = command("look", path)
    assert "FAIL recording_read" in got.out
    assert "conventions that would" not in got.out


def test_a_table_of_a_gauge_study_is_told_column_by_column(command, tmp_path):
    path = tmp_path / "study.csv"
    rows = [f"{k % 3 + 1},{k % 2 + 1},{k},{0.2 + 0.01 * k:.3f}" for k in range(12)]
    path.write_text("\n".join(["Operators,Trials,SN,C13A_TP", *rows, ""]))
    got = command("look", path)
    assert got.status == 0
    assert "C13A_TP: 0.2 to 0.31, 12 different" in got.out
    assert "compare.study" in got.out


def rows_of_ranges(row: np.ndarray, path: Path) -> np.random.Generator:
    """40 rows of counts with noise, as a table below a line of column numbers."""
    rng = np.random.default_rng(1)
    rows = np.round(row + rng.normal(0, 2, (40, 1200))).astype(int)
    path.write_text("\n".join(",".join(map(str, one)) for one in [np.arange(1200), *rows]) + "\n")
    return rng


@pytest.mark.parametrize("blind", [0, 48])
def test_a_groove_in_rows_of_ranges_is_told_in_columns_by_the_engine(blind, command, tmp_path):
    """A V, of whose root a reflection hides `blind` columns: where its walls meet is then not told."""
    row = np.interp(np.arange(1200), [300, 600, 900], [2500, 1585, 2500])
    row[600 - blind // 2 : 600 + blind // 2] = 4000  # a reflection
    rows_of_ranges(row, tmp_path / "groove.csv")
    (tmp_path / "parts.csv").write_text("part,gap\n1,2\n")
    assert "lost" in command("look", tmp_path / "groove.csv", "--corners", tmp_path / "parts.csv").err
    shown = command("look", tmp_path / "groove.csv", "--corners", tmp_path / "corners.csv")
    assert shown.status == 0
    told = re.search(r"gap (-?[\d.]+) ± ([\d.]+)", shown.out)
    assert (told is None) == (blind > 0)
    if told:
        gap, more = map(float, told.groups())
        assert abs(gap) < more + 1.5
    names, first = (line.split(",") for line in (tmp_path / "corners.csv").read_text().splitlines()[:2])
    found = dict(zip(names, first, strict=True))
    for name, at in (("left_upper", 300), ("right_upper", 900)):
        assert float(found[f"{name}_column"]) == pytest.approx(at, abs=1.5)
        assert float(found[f"{name}_range"]) == pytest.approx(2500, abs=3)


def test_of_a_groove_with_a_flat_floor_no_root_is_told(command, tmp_path):
    row = np.interp(np.arange(1200), [300, 500, 700, 900], [2500, 1890, 1890, 2500])
    rows_of_ranges(row, tmp_path / "groove.csv")
    shown = command("look", tmp_path / "groove.csv", "--corners", tmp_path / "corners.csv")
    assert shown.status == 0
    assert "a weld or a backing strip" in shown.out
    names, first = (line.split(",") for line in (tmp_path / "corners.csv").read_text().splitlines()[:2])
    assert dict(zip(names, first, strict=True))["left_root_column"] == ""
