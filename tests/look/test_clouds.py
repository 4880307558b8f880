"""Clouds of unknown unit in `workbench look`: shown in the first one under which they may be a part."""

import re

import numpy as np
import pytest


@pytest.mark.parametrize(
    ("unit", "scale", "told"),
    [
        ("mm", 1.0, "coordinates taken as mm: the format states no unit; inch would be possible too"),
        ("m", 1e-3, "coordinates taken as m: in mm it would be no part"),
    ],
)
def test_a_cloud_is_shown_in_the_first_unit_that_makes_it_a_part(unit, scale, told, command, tmp_path):
    points = np.random.default_rng(4).uniform(0, 200, (500, 3))
    np.savetxt(tmp_path / "c.xyz", points * scale, fmt="%.7f")
    got = command("look", tmp_path / "c.xyz")
    assert told in got.out
    assert "FAIL" not in got.out
    assert ("--input unit=m " in got.out) is (unit == "m")
    low, high = points[:, 0].min(), points[:, 0].max()
    shown = re.search(r"extent: x ([\d.]+) to ([\d.]+) mm", got.out)
    assert (float(shown[1]), float(shown[2])) == pytest.approx((low, high), abs=1e-3)


def test_a_few_points_are_a_cloud_where_they_are_homogeneous(command, tmp_path):
    points = np.column_stack([np.random.default_rng(5).uniform(0, 200, (20, 3)), np.ones(20)])
    np.savetxt(tmp_path / "h.txt", points, fmt="%.4f")
    assert "points: 20" in command("look", tmp_path / "h.txt").out
    np.savetxt(tmp_path / "t.txt", points[:, :3], fmt="%.4f")
    assert "table of numbers" in command("look", tmp_path / "t.txt").out
