"""Files of deflections: what they say, and what is refused."""

from __future__ import annotations

import numpy as np
import pytest

from tests.twin.conftest import perfect_path
from workbench.errors import InputError
from workbench.synthetic import Workpiece, milled_truth
from workbench.twin import mill
from workbench.twin.mill_stage import read_deflections
from workbench.units import DEG

HEADER = "layer,point,dx_mm,dy_mm,dz_mm\n"


def written(tmp_path, text, name="bent.csv"):
    path = tmp_path / name
    path.write_text(text)
    return path


def test_a_table_is_taken_point_by_point(tmp_path, recipe):
    found = read_deflections(
        written(tmp_path, "# by hand\n" + HEADER + "1,0,0.1,0,-0.2\n5,7,0.3,0,0\n"), perfect_path(recipe).layers
    )
    assert found[1][0] == pytest.approx([0.1, 0, -0.2])
    assert found[5][7] == pytest.approx([0.3, 0, 0])
    assert sum(np.abs(value).sum() for value in found.values()) == pytest.approx(0.6)


def test_a_deflection_that_grows_along_the_final_layer_tapers_the_root(tmp_path, recipe):
    """0.01 mm a point outwards, from 0 at arc length 0: the root grows by 0.01 / sin(40 deg) a mm."""
    toolpath = perfect_path(recipe)
    final = toolpath.layers[-1]
    rows = "".join(f"5,{k},{-0.01 * s},0,0\n" for k, s in enumerate(final.arc_length_mm) if s >= 0)
    made, _ = mill(Workpiece(recipe), toolpath, deflections=written(tmp_path, HEADER + rows))
    truth = milled_truth(made)
    expected = 1.5 + 0.01 * truth.arc_length_mm / np.sin(40 * DEG)
    assert truth.root_mm[8:-8] == pytest.approx(expected[8:-8], abs=0.003)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (HEADER + "9,0,0,0,0\n", "no point 0 in a layer 9"),
        (HEADER + "1,500,0,0,0\n", "no point 500 in a layer 1"),
        (HEADER + "1,0.5,0,0,0\n", "no point 0.5 in a layer 1"),
        (HEADER + "1,0,nan,0,0\n", "dx_mm: expected a finite number"),
        (HEADER + "1,0,1e9,0,0\n", "line 2: displacements of at most 100 mm"),
        (HEADER + "1,0,a,0,0\n", "line 2: dx_mm: expected a finite number"),
        ("layer,point\n1,0\n", "dx_mm: expected a finite number"),
    ],
)
def test_what_is_no_deflection_is_refused(tmp_path, recipe, text, message):
    with pytest.raises(InputError, match=message):
        read_deflections(written(tmp_path, text), perfect_path(recipe).layers)


def test_missing_file_is_named(tmp_path, recipe):
    with pytest.raises(InputError, match=r"gone\.csv: no such file"):
        read_deflections(tmp_path / "gone.csv", perfect_path(recipe).layers)
