"""Loading tests with a mistake in them: each is refused, and named."""

import dataclasses
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from workbench.errors import InputError
from workbench.robot import Cell, forward_kinematics

Change = Callable[[Any, Cell], Any]


def scaled(part: str, columns: Any, factor: float) -> Change:
    def change(tests: Any, cell: Cell) -> Any:
        values = getattr(tests, part).copy()
        values[:, columns] *= factor
        return dataclasses.replace(tests, **{part: values})

    return change


def wrench_in_base(tests: Any, cell: Cell) -> Any:
    rotation = forward_kinematics(cell.chain, tests.joints)[:, :3, :3]
    halves = [(rotation @ tests.wrench[:, part, None])[..., 0] for part in (slice(0, 3), slice(3, 6))]
    return dataclasses.replace(tests, wrench=np.hstack(halves))


def in_si(tests: Any, cell: Cell) -> Any:
    return dataclasses.replace(tests, moved=tests.moved * ([1e-3] * 3 + [np.pi / 180] * 3))


def from_horizontal(tests: Any, cell: Cell) -> Any:
    joints = tests.joints.copy()
    joints[:, 2] -= joints[:, 1]
    return dataclasses.replace(tests, joints=joints)


MISTAKES: list[tuple[str, int, Change, str]] = [
    ("signs", 0, scaled("wrench", slice(None), -1), "opposite signs"),
    ("p3z reversed", 4, scaled("moved", 8, -1), "column p3z_mm is of the wrong sign"),
    ("ry in mrad", 0, scaled("moved", 4, 1e3 * np.pi / 180), "column ry_deg is 17.453 times too large: in mrad?"),
    ("ry in rad", 0, scaled("moved", 4, np.pi / 180), "column ry_deg is 57.296 times too small: in rad?"),
    ("torques in kgf cm", 0, scaled("wrench", slice(3, 6), 10.1972), "tz_nm are 10.197 times too large: in kgf cm?"),
    ("all points in m", 4, scaled("moved", slice(None), 1e-3), "columns p1x_mm to p4z_mm are 1,000 times"),
    ("displacements in m and rad", 0, in_si, "displacements are in m and rad"),
    ("wrench in base axes", 0, wrench_in_base, "wrench is in base axes"),
    ("angles in rad", 0, scaled("joints", slice(None), np.pi / 180), "joint angles are in rad"),
    ("joint 3 reversed", 0, scaled("joints", 2, -1), "column q3_deg is of the wrong sign"),
    ("joint 6 reversed", 4, scaled("joints", 5, -1), "column q6_deg is of the wrong sign"),
    ("joint 3 from the horizontal", 0, from_horizontal, "q3_deg is counted from the horizontal"),
]
SELDOM = dict.fromkeys(
    ("ry in mrad", "all points in m", "joint 3 reversed", "p3z reversed"), pytest.mark.slow
)  # as rad, torques, joint 6


@pytest.mark.parametrize(
    ("targets", "change", "message"), [pytest.param(*m[1:], id=m[0], marks=SELDOM.get(m[0], ())) for m in MISTAKES]
)
def test_mistakes_are_named(identified, cell, noisy, targets, change, message):
    with pytest.raises(InputError) as caught:
        identified(change(noisy(20, targets, 2), cell))  # of two load points
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)
    assert len(str(caught.value).rpartition("loads.csv: ")[2]) <= 200


def test_another_convention_is_named(identified: Any, cell: Cell, noisy: Any) -> None:
    """The file holds the other reading of the paper's DH angles, taken for the angles of a robot with wide limits."""
    wide = dataclasses.replace(cell, chain=dataclasses.replace(cell.chain, limits=3.0 * cell.chain.limits))
    tests = noisy(20, 0, 2)
    other = dataclasses.replace(tests, joints=tests.joints + np.radians([0, 90, 0, 0, 0, 0]))
    with pytest.raises(InputError, match="angle_convention to 'dh_same_sense'"):
        identified(other, wide)


@pytest.mark.parametrize(("part", "message"), [("wrench", "loads without wrench"), ("moved", "without displacement")])
def test_columns_of_zeros_are_refused(identified: Any, cell: Cell, noisy: Any, part: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        identified(scaled(part, slice(None), 0.0)(noisy(21), cell))


@pytest.mark.parametrize("targets", [0, 4])
def test_no_sound_set_is_refused(identified: Any, noisy: Any, targets: int) -> None:
    found, _ = identified(noisy(30, targets))
    assert found.loads >= 71
    assert found.warnings == ()
