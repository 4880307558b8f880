"""Clouds of any layout give the points that were put in."""

from typing import Any

import numpy as np
import pytest

from tests.importing.bag_files import Ros
from workbench.errors import InputError
from workbench.importing.bags_profiles import cloud_points

ROS = Ros("mcap")
X = np.array([-1.5, 0.25, 7.0])
Z = np.array([100.0, np.nan, 127.0])


@pytest.mark.parametrize("big", [False, True])
@pytest.mark.parametrize("padding", [0, 3])
@pytest.mark.parametrize("kind", ["f4", "f8"])
def test_floats_of_either_byte_order_and_any_offset(kind: str, padding: int, big: bool) -> None:
    message = ROS.cloud(
        1.0, {"x": X.astype(kind), "ring": np.arange(3, dtype="u1"), "z": Z.astype(kind)}, "f", big, padding
    )
    points = cloud_points(message, "bag")
    np.testing.assert_array_equal(points.xyz[0, 0], X)
    np.testing.assert_array_equal(points.xyz[1, 0], 0)
    np.testing.assert_array_equal(points.xyz[2, 0], Z)


@pytest.mark.parametrize("kind", ["i1", "u1", "i2", "u2", "i4", "u4"])
def test_whole_numbers_of_every_type(kind: str) -> None:
    values = np.array([1, 100, np.iinfo(kind).max]).astype(kind)
    message = ROS.cloud(1.0, {"x": values, "z": values, "intensity": values}, padding=1)
    points = cloud_points(message, "bag")
    np.testing.assert_array_equal(points.xyz[2, 0], values.astype(float))
    assert points.intensity is not None
    np.testing.assert_array_equal(points.intensity[0], values)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda m: setattr(m, "height", 2), "row_step"),
        (lambda m: setattr(m, "row_step", 8), "row_step"),
        (lambda m: setattr(m, "point_step", 10_000), "row_step"),
        (lambda m: setattr(m, "data", m.data[:-1]), "row_step"),
        (lambda m: setattr(m.fields[1], "offset", 1000), r"\.z: expected a field within point_step"),
        (lambda m: setattr(m.fields[1], "datatype", 9), "type 9"),
        (lambda m: setattr(m.fields[0], "count", 2), "count 2"),
        (lambda m: [setattr(f, "name", "r") for f in m.fields], "expected fields x, y, z, found r, r"),
    ],
)
def test_a_cloud_that_contradicts_itself_is_refused(change: Any, said: str) -> None:
    message = ROS.cloud(1.0, {"x": X, "z": Z})
    change(message)
    with pytest.raises(InputError, match=said):
        cloud_points(message, "bag: /profiles[0]")
