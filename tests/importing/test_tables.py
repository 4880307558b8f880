"""Profiles in any table, as a mapping file describes it."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.importing import makers
from workbench.artefacts import Recording
from workbench.errors import InputError

AXIS = {"linear_axis": {"direction": [0, 1, 0], "speed_mm_s": 50}}
PITCH = {"times": {"source": "pose_each", "pitch_mm": makers.STEP_MM}}
Import = Callable[..., Recording]
Mapped = Callable[..., Path]


def points(cell: Callable[[float], str] = str, delimiter: str = ",", missing: str = "") -> list[list[str]]:
    """Rows of x and z by frame, each row a text."""
    return [
        [delimiter.join([cell(x), missing if np.isnan(z) else cell(z)]) for x, z in zip(makers.X_MM, row, strict=True)]
        for row in makers.heights_mm()
    ]


def part(**changes: Any) -> dict[str, Any]:
    return {"length_unit": "mm", "frames": "blank_lines", "columns": {"x": "x", "z": "z"}, **changes}


def assert_is_the_plate(made: Recording, atol: float = 1e-5) -> None:
    want = makers.heights_mm()
    np.testing.assert_allclose(made.z_mm, want, atol=atol)
    np.testing.assert_allclose(made.x_mm, np.broadcast_to(makers.X_MM, want.shape), atol=1e-6)


def test_blank_lines_between_frames(tmp_path: Path, imported: Import, mapped: Mapped) -> None:
    path = tmp_path / "scan.csv"
    path.write_text("x,z\n" + "\n\n".join("\n".join(frame) for frame in points()) + "\n\n")
    assert_is_the_plate(imported(path, mapping=mapped(profiles=part(), **AXIS, **PITCH)))


def test_semicolons_and_decimal_commas_and_micrometres(tmp_path: Path, imported: Import, mapped: Mapped) -> None:
    path = tmp_path / "scan.txt"
    rows = points(lambda v: f"{v * 1000:.3f}".replace(".", ","), ";", "-9999,0")
    path.write_bytes(("Made up\r\nx;z\r\n" + "\r\n\r\n".join("\r\n".join(frame) for frame in rows)).encode("utf-16"))
    form = part(delimiter=";", decimal=",", skip_lines=1, length_unit="um", missing=[-9999])
    assert_is_the_plate(imported(path, mapping=mapped(profiles=form, **AXIS, **PITCH)))


def test_columns_by_place_without_header(tmp_path: Path, imported: Import, mapped: Mapped) -> None:
    """White space between the columns, indented; the frame's number and travel stand beside each point."""
    lines = [
        f"  {7 + i}   {i * makers.STEP_MM}\t{row}"
        for i, frame in enumerate(points(delimiter="  ", missing="nan"))
        for row in frame
    ]
    (tmp_path / "scan.xz").write_text("\n".join(lines))
    form = part(
        files="*.xz", delimiter=" ", header=False, frames="column", columns={"x": 2, "z": 3, "frame": 0, "travel": 1}
    )
    made = imported(tmp_path / "scan.xz", mapping=mapped(profiles=form, **AXIS))
    assert_is_the_plate(made)
    np.testing.assert_allclose(made.robot_position_mm[:, 1], makers.TRAVEL_MM)


def test_a_row_of_ranges_a_frame(tmp_path: Path, imported: Import, mapped: Mapped) -> None:
    path = tmp_path / "scan.csv"
    path.write_text("\n".join(",".join("" if np.isnan(z) else str(z) for z in row) for row in makers.heights_mm()))
    form = {"files": "*.csv", "length_unit": "mm", "frames": "rows", "header": False, "x_first": -5.0, "x_pitch": 0.25}
    assert_is_the_plate(imported(path, mapping=mapped(profiles=form, **AXIS, **PITCH)))


def test_left_out_points_leave_their_columns_free(tmp_path: Path, imported: Import, mapped: Mapped) -> None:
    """By spacing columns stay the sensor's; by count the points close up."""
    path = tmp_path / "scan.csv"
    path.write_text("x,z\n" + "\n\n".join("\n".join(r for r in frame if r[-1] != ",") for frame in points()))
    spaced = imported(path, mapping=mapped(profiles=part(), **AXIS, **PITCH))
    np.testing.assert_allclose(spaced.z_mm, makers.heights_mm(), atol=1e-5)
    counted = imported(path, mapping=mapped(profiles=part(ragged="count"), **AXIS, **PITCH))
    assert np.isnan(counted.z_mm[1]).sum() == 3
    assert np.isnan(counted.z_mm[1, -3:]).all()


BAD: dict[str, tuple[str, str]] = {
    "a word": ("x,z\n1,2\n\n3,four\n", r"line 4, cell 2: expected a number with decimal mark '\.', found 'four'"),
    "a cell too few": ("x,z\n1,2\n1\n", r"line 3: expected 2 cells, found 1"),
    "infinities": ("x,z\n1,2\n1,inf\n2,3\n1,inf\n", r"line 3: column 'z': expected a finite number"),
    "an underscore": ("x,z\n1,2_0\n", r"line 2, cell 2: expected a number"),
    "another name": ("x,Z\n1,2\n", r"is in no known form"),
    "no rows": ("x,z\n\n\n", r"expected rows of numbers after line 1, found none"),
    "twice": ("x,z,z\n1,2,3\n", r"column 'z': occurs twice"),
    "a frame a row": ("x,z\n1,2\n\n3,4\n\n5,6\n", r"expected several points a frame, found 3 frames in 3 rows"),
    "a zero byte": ("x,z\n1,\0\n", r"line 2: expected text, found a zero byte"),
    "no return": ("x,z\n1,\n2,\n", r"expected returns, found none"),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_tables(case: str, tmp_path: Path, imported: Import, mapped: Mapped) -> None:
    text, message = BAD[case]
    (tmp_path / "scan.csv").write_text(text)
    with pytest.raises(InputError, match=message):
        imported(tmp_path / "scan.csv", mapping=mapped(profiles=part(), **AXIS, **PITCH))


@pytest.mark.parametrize("columns", [{"x": "x", "z": "x"}, {"x": "x", "z": 0}, {"x": "x", "z": "z", "intensity": "z"}])
def test_a_column_stands_for_one_thing(columns: Any, tmp_path: Path, imported: Import, mapped: Mapped) -> None:
    (tmp_path / "scan.csv").write_text("x,z\n" + "\n\n".join("\n".join(frame) for frame in points()))
    with pytest.raises(InputError, match="the mapping names one for both"):
        imported(tmp_path / "scan.csv", mapping=mapped(profiles=part(files="*.csv", columns=columns), **AXIS, **PITCH))


def test_a_position_has_three_columns(milled: Recording, shop: Callable[..., Recording]) -> None:
    with pytest.raises(InputError, match="'position 0' and 'position 1', the mapping names one for both"):
        shop(milled, milled, poses={"position": ["X", "X", "Z"]})


def test_names_are_suggested_where_the_mapping_claims_the_file(
    tmp_path: Path, imported: Import, mapped: Mapped
) -> None:
    (tmp_path / "scan.csv").write_text("X,Zrange\n1,2\n")
    with pytest.raises(InputError, match=r"column 'Zrang': no such column; did you mean 'Zrange'"):
        imported(
            tmp_path / "scan.csv",
            mapping=mapped(profiles=part(files="scan*", columns={"x": "X", "z": "Zrang"}), **AXIS),
        )


@pytest.mark.parametrize("named", ["by files", "by header", "by place", "known header"])
@pytest.mark.parametrize(("delimiter", "shown"), [(";", "';'"), ("\t", "tabs"), (" ", "blanks")])
def test_another_delimiter_that_gives_all_columns_is_told(
    named: str, delimiter: str, shown: str, tmp_path: Path, imported: Import, mapped: Mapped
) -> None:
    names = ["frame", "time_s", "x_mm", "z_mm"] if named == "known header" else ["Profile", "Time", "X", "Z"]
    rows = [f"{k // 4},{0.1 * (k // 4):.1f},{k % 4}.5,80.25" for k in range(12)]
    lines = rows if named == "by place" else [",".join(names), *rows]
    (tmp_path / "s.csv").write_text("\n".join(lines).replace(",", delimiter) + "\n")
    columns = dict(zip(("frame", "time", "x", "z"), range(4) if named == "by place" else names, strict=True))
    form = part(frames="column", time_unit="s", columns=columns, header=named != "by place")
    form |= {} if named == "by header" else {"files": "s.csv"}
    mapping = None if named == "known header" else mapped(profiles=form, **AXIS, **PITCH)
    what = f"separated by {shown}, not by ',': expected \"delimiter\": {json.dumps(delimiter)} in the mapping"
    with pytest.raises(InputError, match=re.escape(what)):
        imported(tmp_path / "s.csv", mapping=mapping)


def test_a_column_that_no_delimiter_gives_is_told_as_before(tmp_path: Path, imported: Import, mapped: Mapped) -> None:
    (tmp_path / "s.csv").write_text("x;z\n1;2\n3;4\n")
    form = part(files="s.csv", columns={"x": "x", "z": "height"})
    with pytest.raises(InputError, match=r"column 'x': no such column.*column 'height': no such column"):
        imported(tmp_path / "s.csv", mapping=mapped(profiles=form, **AXIS, **PITCH))
