"""`program.csv`: every point, in the order of motion."""

import csv as comma_separated
import io
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from workbench.program import csv

from .conftest import passed, rejected
from .paths import Shape, all_points, mill_path


def test_read_back_the_points_are_the_same() -> None:
    path = mill_path(Shape(bend=1 / 300, length_mm=60, lifted_mm=(20, 40)))
    document = csv(path, passed(path))
    assert document.name == "toolpath.csv"
    rows = list(comma_separated.DictReader(io.StringIO(document.content.decode("ascii"), newline="")))
    position, quaternion, feed = all_points(path)

    def column(*names: str) -> np.ndarray:
        return np.array([[float(row[name]) for name in names] for row in rows])

    assert np.abs(column("x_mm", "y_mm", "z_mm") - position).max() < 1e-6
    assert np.abs(column("qw", "qx", "qy", "qz") - quaternion).max() < 1e-8
    assert np.abs(column("feed_mm_s")[:, 0] - feed).max() < 1e-6
    for layer in path.layers:
        mine = [row for row in rows if row["layer"] == str(layer.index)]
        assert [float(row["arc_length_mm"]) for row in mine] == layer.arc_length_mm.tolist()
        assert [row["cutting"] == "1" for row in mine] == layer.cutting.tolist()
        assert [row["measured"] == "1" for row in mine] == layer.measured.tolist()
    between = [row for row in rows if row["layer"] == "0"]
    assert len(between) == sum(len(travel.feed_mm_s) for travel in path.travels)
    assert {(row["arc_length_mm"], row["cutting"]) for row in between} == {("", "0")}


@pytest.mark.parametrize(
    ("changed", "written"),
    [({"loosened": ("SHAPE ONLY: nothing shows it",)}, True), ({"loosened": ("penetration_mm 2",)}, False), ({}, True)],
)
def test_a_shape_is_written_and_a_path_with_a_weaker_check_or_that_failed_is_not(changed: Any, written: bool) -> None:
    path = mill_path(Shape(length_mm=10))
    assert (csv(path, replace(passed(path), **changed)) is not None) is written
    assert csv(path, replace(rejected(path), **changed)) is None
