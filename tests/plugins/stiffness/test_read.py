"""`stiffness.read`: a file's stiffness, or given numbers; loading tests; what is refused of both."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from workbench.errors import InputError, PipelineError
from workbench.plugins.stiffness import identify, read
from workbench.robot import Cell

from .conftest import ROOT, K

LOADS = ROOT / "data" / "synthetic" / "loads.csv"
HEAD = "posture,q1_deg,q2_deg,q3_deg,q4_deg,q5_deg,q6_deg,fx_n,fy_n,fz_n,tx_nm,ty_nm,tz_nm"
SIX = HEAD + ",dx_mm,dy_mm,dz_mm,rx_deg,ry_deg,rz_deg"
ROW = "a,1,2,3,4,5,6,10,20,30,1,2,3"
POINTS = HEAD + ",p1x_mm,p1y_mm,p1z_mm,p2x_mm,p2y_mm,p2z_mm"


def test_stiffness_is_the_cells_or_nobodys(cell: Cell) -> None:
    """No other robot's numbers stand in: the shipped cell states the paper's Table 2."""
    assert read(cell).nm_per_rad.tolist() == K.tolist()
    assert read() is None
    assert read(dataclasses.replace(cell, joint_stiffness_nm_per_rad=None)) is None
    assert read(joint_stiffness_nm_per_rad=[1e6] * 6).nm_per_rad.tolist() == [1e6] * 6


def test_what_is_identified_is_read_back(cell: Cell, tmp_path: Path) -> None:
    found, _, document = identify(cell, loads=LOADS)
    (tmp_path / "stiffness.json").write_bytes(document.content)
    again = read(stiffness=tmp_path / "stiffness.json")
    assert np.array_equal(again.nm_per_rad, found.nm_per_rad)
    assert np.array_equal(again.covariance, found.covariance)
    assert (again.condition_number, again.postures, again.loads) == (found.condition_number, 3, 120)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"joint_stiffness_nm_per_rad": [1e6, 0, 1e6, 1e6, 1e6, 1e6]}, "[1]: expected greater than 0, got 0"),
        ({"joint_stiffness_nm_per_rad": [1e6, 1e6, 1e6, 1e6, 1e6, -3]}, "[5]: expected greater than 0, got -3"),
        ({"joint_stiffness_nm_per_rad": [1e6] * 5}, "expected 6 entries, found 5"),
        ({"joint_stiffness_nm_per_rad": "soft"}, "expected a valid array"),
        ({"covariance": [[1.0] * 6] * 5}, "expected 6 entries, found 5"),
        ({"covariance": (-np.eye(6)).tolist()}, "no negative eigenvalue"),
        ({"covariance": (np.eye(6) + np.eye(6, k=1)).tolist()}, "symmetric"),
        ({"covariance": (1e10 * np.eye(6)[::-1]).tolist()}, "no negative eigenvalue"),  # of what is exact there is none
        ({"covariance": None}, "expected a valid array"),
    ],
)
def test_what_is_no_stiffness_is_refused(tmp_path: Path, change: Any, message: str) -> None:
    good = {"joint_stiffness_nm_per_rad": K.tolist(), "covariance": np.eye(6).tolist()}
    (tmp_path / "stiffness.json").write_text(json.dumps(good | change))
    with pytest.raises(InputError) as caught:
        read(stiffness=tmp_path / "stiffness.json")
    assert message in str(caught.value)


def test_numbers_given_are_checked() -> None:
    with pytest.raises(PipelineError, match="greater than 0"):
        read(joint_stiffness_nm_per_rad=(1e6, 1e6, 0, 1e6, 1e6, 1e6))


def write(path: Path, *lines: str) -> Path:
    (path / "loads.csv").write_text("\n".join(lines) + "\n")
    return path / "loads.csv"


def test_columns_stand_in_any_order_and_others_are_noted(cell: Cell, tmp_path: Path) -> None:
    lines = [line for line in LOADS.read_text().splitlines() if line[0] != "#"]
    turned = ["# comment", "", *(",".join(line.split(",")[::-1]) for line in lines), "  # another"]
    turned[2:-1] = [line + (",21" if k else ",temperature_c") for k, line in enumerate(turned[2:-1])]
    found, plain = (identify(cell, loads=path)[0] for path in (write(tmp_path, *turned), LOADS))
    assert np.allclose(found.nm_per_rad, plain.nm_per_rad, rtol=1e-9)
    assert "temperature_c" in found.warnings[0]


@pytest.mark.parametrize(
    ("lines", "message"),
    [
        ([HEAD, ROW], "loads without displacement"),
        ([SIX.replace("fz_n,", ""), ROW], "expected the column 'fz_n'"),
        ([SIX + POINTS.removeprefix(HEAD), ROW + ",0" * 12], "not both"),
        ([SIX], "one row a load"),
        ([SIX, ROW], "line 2: expected 19 cells, found 13"),
        ([SIX, ROW + ",0.1,0.2,,0,0,0"], "line 2: dz_mm: expected a finite number, found ''"),
        ([SIX, ROW + ",0.1,0.2,nan,0,0,0"], "expected a finite number, found 'nan'"),
        ([SIX, ROW.replace("20", "2O") + ",1,2,3,0,0,0"], "line 2: fy_n"),
        ([POINTS.removesuffix(",p2z_mm"), ROW + ",0" * 5], "expected the column 'p2z_mm'"),
        ([POINTS, ROW + ",,,,,,"], "line 2: a load without displacement"),
        ([SIX + ",dx_mm", ROW + ",0" * 7], "occurs twice"),
        ([SIX.replace("rz_deg", "rz_rad"), ROW + ",0" * 6], "loads without displacement"),
    ],
)
def test_bad_files_are_refused(cell: Cell, tmp_path: Path, lines: list[str], message: str) -> None:
    with pytest.raises(InputError) as caught:
        identify(cell, loads=write(tmp_path, *lines))
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def test_bytes_that_are_no_text(cell: Cell, tmp_path: Path) -> None:
    (tmp_path / "loads.csv").write_bytes(b"\xff\xfe\x00posture")
    with pytest.raises(InputError, match="UTF-8"):
        identify(cell, loads=tmp_path / "loads.csv")
    with pytest.raises(InputError, match="no such file"):
        identify(cell, loads=tmp_path / "none.csv")
