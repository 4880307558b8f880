"""What calibrations from tables share: whether a result is good enough, what is noise, what stands in a table."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from workbench.api import Float, InputError, estimator
from workbench.plugins.calibration.tables import Table, check_misfit, enough, noisy, poses


@dataclass(frozen=True)
class Mean:
    """The mean of numbers of standard deviation 1."""

    distance: Float
    misfit: float = 1.0
    freedom: int = 20


@pytest.mark.parametrize(
    ("u_mm", "turn_u_deg", "good"),
    [(0.0624, 0.124, True), (0.0626, 0.124, False), (0.0624, 0.126, False), (0.0626, 0.126, False)],
)
def test_half_of_either_tolerance_is_enough(u_mm: float, turn_u_deg: float, good: bool) -> None:
    """At 30 deg a tool that stands off by u moves the root's end by 2 u."""
    told = enough(u_mm, 30.0, 0.5, "the tool", "measure again", turn=(turn_u_deg, 0.5))
    expanded, turned = f"{4 * u_mm:.3f} mm of a root face tolerance of ± 0.5 mm", f"{2 * turn_u_deg:.3f} deg of a bevel"
    words = "good enough" if good else "not good enough, more than half of it; measure again"
    assert told == (good, f"the tool alone takes U = {expanded} and {turned} tolerance of ± 0.5 deg: {words}")


def test_without_a_direction_the_place_alone_decides() -> None:
    assert enough(0.0624, 30.0, 0.5, "it", "")[0]
    assert not enough(0.0626, 30.0, 0.5, "it", "")[0]
    assert "bevel tolerance" not in enough(0.1, 30.0, 0.5, "it", "")[1]


@pytest.mark.parametrize(
    ("misfit", "words"),
    [
        (15.0**-2 * 0.99, "lie more than 15 times nearer"),
        (15.0**-2 * 1.01, None),
        (2.0, None),
        (2.25, "lie 1.5 times as far"),
    ],
)
def test_residuals_far_from_the_stated_noise_are_told(misfit: float, words: str | None) -> None:
    told = noisy(Mean(np.zeros(3), misfit), "touches", "look")
    assert told == () if words is None else words in told[0]
    assert noisy(Mean(np.zeros(3), misfit, 3), "touches", "look") == ()


def test_a_misfit_of_ten_times_the_noise_is_refused() -> None:
    labels = estimator.Labels("a.csv", (), ask="look")
    check_misfit(Mean(np.zeros(3), 99.0), labels)
    with pytest.raises(InputError, match=r"a\.csv: .*misfit of 101 .*look"):
        check_misfit(Mean(np.zeros(3), 101.0), labels)


def table(folder: Path, text: str, needed: tuple[str, ...] = ("a", "b"), least: int = 1) -> Table:
    path = folder / "t.csv"
    path.write_text(text)
    return Table(path, needed, least)


def test_a_table_names_its_lines_behind_comments(tmp_path: Path) -> None:
    found = table(tmp_path, "# made by hand\na,b,name\n1,2,x\n\n# more\n3,-4e2,\n5,6,x\n")
    assert found.lines == [3, 6, 7]
    assert found.numbers(("b", "a")).tolist() == [[2.0, 1.0], [-400.0, 3.0], [6.0, 5.0]]
    assert found.words("name", "none") == ["x", "none", "x"]
    assert found.words("other", "none") == ["none"] * 3
    names, number = found.labels("name", "none")
    assert (names, number.tolist()) == (("x", "none"), [0, 1, 0])


def test_empty_cells_count_only_where_they_may(tmp_path: Path) -> None:
    found = table(tmp_path, "a,b\n1,\n,2\n")
    assert np.array_equal(
        found.numbers(("a", "b", "c"), blank=True), [[1.0, np.nan, np.nan], [np.nan, 2.0, np.nan]], equal_nan=True
    )
    with pytest.raises(InputError, match="line 2: b"):
        found.numbers(("b",))


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "expected a header with the columns a, b"),
        ("a,c\n1,2\n", "header: expected the column 'b'"),
        ("a,b,b\n1,2,3\n", "header: a column stands twice"),
        ("a,b\n1,2\n1\n", "line 3: expected 2 cells, found 1"),
        ("a,b\n1,2\n", "expected at least 2 rows, found 1"),
    ],
)
def test_tables_that_are_none_are_refused(tmp_path: Path, text: str, words: str) -> None:
    with pytest.raises(InputError, match=words):
        table(tmp_path, text, least=2)
    assert len(table(tmp_path, "a,b\n1,2\n3,4\n", least=2).lines) == 2


@pytest.mark.parametrize(
    ("cell", "good"), [("1e6", True), ("-1e6", True), ("1.01e6", False), ("nan", False), ("x", False)]
)
def test_numbers_beyond_any_cell_are_refused(tmp_path: Path, cell: str, good: bool) -> None:
    found = table(tmp_path, f"a,b\n1,{cell}\n")
    if good:
        assert abs(found.numbers(("b",))[0, 0]) == 1e6
        return
    with pytest.raises(InputError, match="line 2: b: expected a number of at most 1e\\+06"):
        found.numbers(("b",))


@pytest.mark.parametrize(("norm", "good"), [(1.0009, True), (0.9991, True), (1.0011, False), (0.9989, False)])
def test_quaternions_of_another_norm_are_refused(tmp_path: Path, norm: float, good: bool) -> None:
    half = math.radians(15.0)
    turn = ",".join(f"{norm * one!r}" for one in (math.cos(half), 0.0, 0.0, math.sin(half)))
    found = table(tmp_path, f"x_mm,y_mm,z_mm,qw,qx,qy,qz\n1,2,3,{turn}\n", ("qw",))
    if not good:
        with pytest.raises(InputError, match="line 2: expected a quaternion of norm 1"):
            poses(found)
        return
    (pose,) = poses(found)
    c, s = math.cos(2 * half), math.sin(2 * half)
    assert pose == pytest.approx(np.array([[c, -s, 0, 1], [s, c, 0, 2], [0, 0, 1, 3], [0, 0, 0, 1.0]]))
