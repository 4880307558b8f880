"""docs/examples/other_forms.py reads what it says."""

import runpy
from pathlib import Path

import numpy as np

FORMS = runpy.run_path(str(Path(__file__).parents[2] / "docs/examples/other_forms.py"))


def test_what_is_zero_in_x_and_range_is_no_return_of_sick(tmp_path):
    rows = np.zeros(2, [("x", "<f4", 3), ("r", "<f4", 3), ("mark", "<i4", 5), ("i", "u1", 3)])
    rows["x"][0], rows["r"][1] = 5, 7
    rows.tofile(tmp_path / "a.dat")
    x, z = FORMS["sick"](tmp_path / "a.dat", 3)
    np.testing.assert_array_equal([x[0], z[0], z[1]], [[5, 5, 5], [0, 0, 0], [7, 7, 7]])


def test_poses_of_kuka_become_tables(tmp_path):
    told = '<Rob><RIst X="1.5" Y="2" Z="-3" A="4" B="5" C="6"/>\n<IPOC>4208</IPOC></Rob>'
    FORMS["kuka_rsi"](told, tmp_path / "rsi.csv")
    FORMS["kuka_program"]("DECL E6POS XP1={X 1.5,Y 2,Z -3,A 4,B 5,C 6,S 2,T 10}", tmp_path / "src.csv")
    assert (tmp_path / "rsi.csv").read_text().split() == ["X,Y,Z,A,B,C,ipoc", "1.5,2,-3,4,5,6,4208"]
    assert (tmp_path / "src.csv").read_text().split() == ["X,Y,Z,A,B,C", "1.5,2,-3,4,5,6"]
