"""Runs of poses as moves (that they keep to the path, and how few they are: tests/path/test_simplify.py).

How far a rounded corner leaves its path: against the parabola itself.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from workbench.geometry.moves import Tolerances, merge_poses, rounding_mm, step_lengths_mm, step_times_s, travel_time_s
from workbench.units import DEG

NONE = np.full((3, 3), np.nan)

CORNERS = np.array([[0.0, 0.0, 0.0], [3.0, 4.0, 0.0], [3.0, 4.0, 12.0], [3.0, 4.0, 12.0]])


def merge(position, quaternion, **tolerances):
    n = len(position)
    allowed = Tolerances(**{"chord_mm": 0.01, "angle": 0.05 * DEG, "least_sweep": 4.2 * DEG} | tolerances)
    return merge_poses(position, quaternion, np.ones(n), np.full(n, 0.1), np.zeros(n, int), allowed)


def test_a_line_along_which_the_tool_turns_holds_for_another_point_of_the_tool() -> None:
    """The tip is moved straight from target to target: what lies a lever away leaves its line by the chord at most."""
    s, lever = np.linspace(0, 300, 601), np.array([0.0, 8.0, 12.0])
    turns = Rotation.from_rotvec(np.outer(s / 300 * 40 * DEG, [1.0, 0, 0]))
    position = s[:, None] * [[1.0, 0, 0]]
    quaternion = turns.as_quat(scalar_first=True)
    assert merge(position, quaternion)[0].tolist() == [0, 600]
    targets, circular, *_ = merge(position, quaternion, lever_mm=float(np.linalg.norm(lever)))
    assert not circular.any()
    assert 40 / 5.2 < len(targets) - 1 < 40 / 3.8
    tip = position + turns.apply(lever)
    driven = np.stack([np.interp(s, s[targets], tip[targets, c]) for c in range(3)], axis=1)
    off = np.linalg.norm(driven - turns.apply(lever) - position, axis=1)
    assert 0.008 < off.max() < 0.0101


@pytest.mark.parametrize(("degrees", "moves"), [(4.0, 0), (4.5, 1), (165, 1), (175, 2), (355, 3)])
def test_sweeps_of_arcs_are_limited_and_their_middles_are_the_paths(degrees: float, moves: int) -> None:
    def ring(a):
        turned = Rotation.from_rotvec(a[:, None] * [[0, 0, 1]]).as_quat(scalar_first=True)
        return 3000.0 * np.stack([np.cos(a), np.sin(a), 0 * a], axis=1), turned

    a = np.linspace(0, degrees * DEG, 4000)
    targets, circular, via, via_turn = merge(*ring(a))
    assert circular.sum() == moves
    position, quaternion = ring(0.5 * (a[targets[:-1]] + a[targets[1:]])[circular[1:]])
    np.testing.assert_allclose(via[circular], position, atol=1e-6)
    np.testing.assert_allclose(np.abs((via_turn[circular] * quaternion).sum(axis=1)), 1.0, atol=1e-9)


def test_a_turn_on_the_spot_is_kept() -> None:
    position = np.array([[0.0, 0, 0], [10, 0, 0], [10, 0, 0], [20, 0, 0]])
    turned = [np.cos(20 * DEG), np.sin(20 * DEG), 0, 0]
    quaternion = np.array([[1.0, 0, 0, 0], [1, 0, 0, 0], turned, turned])
    assert merge(position, quaternion)[0].tolist() == [0, 1, 2, 3]


@pytest.mark.parametrize("turn_deg", [0.0, 10.0, 90.0, 180.0])
def test_straight_corners(turn_deg: float) -> None:
    turn = np.radians(turn_deg)
    position = np.array([[-10.0, 0, 0], [0, 0, 0], [10 * np.cos(turn), 10 * np.sin(turn), 0]])
    off = rounding_mm(position, NONE, np.zeros(3, bool), 2.0)
    middle = (2.0 * position[0] / 10 + 2.0 * position[2] / 10) / 4  # of the parabola over 2 mm on either side
    assert off[0] == off[2] == 0
    assert off[1] == pytest.approx(np.linalg.norm(middle), abs=1e-12)


def test_no_rounding_begins_more_than_half_way() -> None:
    position = np.array([[-1.0, 0, 0], [0, 0, 0], [0, 30, 0]])
    assert rounding_mm(position, NONE, np.zeros(3, bool), 50.0)[1] == pytest.approx(0.5 * np.sin(np.pi / 4) / 2)


def test_an_arc_that_goes_on_as_a_line_has_no_corner() -> None:
    """A quarter of a circle whose tangent at the end is x, and a line along x or along y."""
    position = np.array([[0.0, 0, 0], [10, 10, 0], [20, 10, 0]])
    via = NONE.copy()
    via[1] = [10 - 10 * np.cos(np.pi / 4), 10 * np.sin(np.pi / 4), 0]
    circular = np.array([False, True, False])
    assert rounding_mm(position, via, circular, 1.0)[1] == pytest.approx(0, abs=1e-9)
    position[2] = [10, 20, 0]
    assert rounding_mm(position, via, circular, 1.0)[1] == pytest.approx(np.sin(np.pi / 4) / 2)


def test_a_turn_on_the_spot_is_never_rounded() -> None:
    position = np.array([[0.0, 0, 0], [1, 0, 0], [1, 0, 0]])
    assert rounding_mm(position, NONE, np.zeros(3, bool), 0.3)[1] == np.inf


def test_each_step_is_run_at_the_feed_towards_its_point():
    feed = np.array([99.0, 2.0, 4.0, 1.0])  # the first counts nothing: the robot is there
    np.testing.assert_allclose(step_lengths_mm(CORNERS), [0.0, 5.0, 12.0, 0.0])
    np.testing.assert_allclose(step_times_s(CORNERS, feed), [0.0, 2.5, 3.0, 0.0])
    assert travel_time_s(CORNERS, feed) == pytest.approx(5.5)


@pytest.mark.parametrize("count", [0, 1])
def test_a_path_without_steps_takes_no_time(count):
    assert travel_time_s(CORNERS[:count], np.ones(count)) == 0.0
