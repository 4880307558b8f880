"""Cutter against clamps and table, in cases worked out by hand."""

from __future__ import annotations

import numpy as np
import pytest

from workbench.synthetic.milling import clamp_overlap, table_overlap

BOX = np.array([10.0, 0, 1, 0, -4, 4, -6, 3, 0, 5])  # x 6..14, y -3..6 (outwards is -y), z 0..5
RADIUS = np.full(3, 5.0)


def along(axis):
    return np.tile(np.array(axis, float), (3, 1))


def test_flank_against_the_face_of_a_clamp():
    """An upright cutter 4, 5.1 and 20 mm in front of the face y = -3."""
    centre = np.array([[10.0, -7, 0], [10, -8.1, 0], [10, -23, 0]])
    assert clamp_overlap(BOX, centre, along([0, 0, -1]), RADIUS, 3.0) == pytest.approx([1.0, 0.0, 0.0])


def test_corner_of_a_clamp():
    """The vertical edge at (6, -3), 3 mm and 3 mm aside: 5 - sqrt(18) deep."""
    centre = np.array([[3.0, -6, 0], [2.0, -7, 0], [3.0, -6, 30]])
    found = clamp_overlap(BOX, centre, along([0, 0, -1]), RADIUS, 10.0)
    assert found == pytest.approx([5 - np.sqrt(18), 0.0, 0.0], abs=1e-9)


def test_the_tip_ends_above_a_clamp():
    """Upright over the clamp, its top at 5: the tip at 5.1, 4.9 and far below."""
    centre = np.array([[10.0, 1, 15.1], [10, 1, 14.9], [10, 1, 2]])
    found = clamp_overlap(BOX, centre, along([0, 0, -1]), RADIUS, 10.0)
    assert found[0] == 0.0
    assert (found[1:] > 4.5).all()


def test_a_ball_end_above_and_beside_a_clamp():
    """Upright over the top at 5: its centre 5.5, 4 and 0 above; then 3 mm beside and 3 mm above an edge."""
    centre = np.array([[10.0, 1, 10.5], [10, 1, 9.0], [10, 1, 5.0]])
    found = clamp_overlap(BOX, centre, along([0, 0, -1]), RADIUS, 0.0, ball_end=True)
    assert found == pytest.approx([0.0, 1.0, 5.0])
    beside = np.tile([10.0, -6.0, 8.0], (3, 1))
    assert clamp_overlap(BOX, beside, along([0, 0, -1]), RADIUS, 0.0, True) == pytest.approx([5 - np.sqrt(18)] * 3)


def test_a_ball_end_against_the_table():
    """However it leans, it is a radius below its centre."""
    centre = np.array([[0.0, 0, -14.0], [0, 0, -15.5], [0, 0, 0]])
    for axis in ([0, 0, -1.0], [0.6, 0, -0.8]):
        start = centre - 10.0 * along(axis)
        assert table_overlap(-20.0, start, along(axis), RADIUS, 10.0, True) == pytest.approx([0.0, 0.5, 0.0])


def test_rim_of_the_tip_against_the_table():
    """Tilted by 30 deg, tip 10 mm along the axis: its rim is 10 cos(30) + 5 sin(30) below the origin."""
    axis = along([0.5, 0, -np.sqrt(0.75)])
    lowest = 10 * np.sqrt(0.75) + 5 * 0.5
    centre = np.array([[0.0, 0, lowest - 20.5], [0, 0, lowest - 19.5], [0, 0, 0]])
    assert table_overlap(-20.0, centre, axis, RADIUS, 10.0) == pytest.approx([0.5, 0.0, 0.0])
