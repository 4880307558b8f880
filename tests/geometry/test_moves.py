"""Runs of poses as lines and circles, on courses whose answer is known.

How far a rounded corner leaves its path: against the parabola itself.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from workbench.geometry.moves import Tolerances, merge_poses, rounding_mm, step_lengths_mm, step_times_s, travel_time_s

DEG = np.pi / 180
NONE = np.full((3, 3), np.nan)

CORNERS = np.array([[0.0, 0.0, 0.0], [3.0, 4.0, 0.0], [3.0, 4.0, 12.0], [3.0, 4.0, 12.0]])


def merge(position, quaternion=None, feed=None, label=None, least_sweep=4.2 * DEG, feed_share=0.1, **tolerances):
    n = len(position)
    quaternion = np.tile([1.0, 0, 0, 0], (n, 1)) if quaternion is None else quaternion
    allowed = Tolerances(**{"chord_mm": 0.01, "angle": 0.05 * DEG, "least_sweep": least_sweep} | tolerances)
    return merge_poses(
        position,
        quaternion,
        np.ones(n) if feed is None else feed,
        np.broadcast_to(feed_share, n),
        np.zeros(n, int) if label is None else label,
        allowed,
    )


def ring(radius, degrees, n=200):
    a = np.linspace(0, degrees * DEG, n)
    return np.stack([radius * np.cos(a), radius * np.sin(a), np.full(n, 7.0)], axis=1), a


def test_a_line_is_one_move_however_uneven_its_points() -> None:
    s = np.cumsum(np.random.default_rng(1).uniform(1e-3, 10, 500))
    targets, circular, via, via_turn = merge(s[:, None] * [[0.6, 0.0, 0.8]] + [[1e3, 2e3, 3e3]])
    assert targets.tolist() == [0, 499]
    assert not circular.any()
    assert np.isnan(via).all()
    assert np.isnan(via_turn).all()


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


def test_an_arc_is_one_move_and_its_via_is_the_middle() -> None:
    """The tool turns with the tangent: slerp along the arc is then exact."""
    position, a = ring(300, 120)
    quaternion = Rotation.from_rotvec(a[:, None] * [[0, 0, 1]]).as_quat(scalar_first=True)
    targets, circular, via, via_turn = merge(position, quaternion)
    assert targets.tolist() == [0, 199]
    assert circular.tolist() == [False, True]
    assert via[1] == pytest.approx([150, 300 * np.sqrt(3) / 2, 7], abs=1e-6)
    assert via_turn[1] == pytest.approx([np.cos(30 * DEG), 0, 0, np.sin(30 * DEG)], abs=1e-9)


@pytest.mark.parametrize(("degrees", "moves"), [(4.0, 0), (4.5, 1), (165, 1), (175, 2), (355, 3)])
def test_sweeps_of_arcs_are_limited(degrees: float, moves: int) -> None:
    position, _ = ring(3000, degrees, 4000)
    assert merge(position)[1].sum() == moves


def test_arcs_turn_both_ways() -> None:
    position, _ = ring(300, 100)
    for mirrored in (position * [[1, -1, 1]], position * [[-1, 1, 1]], position[::-1]):
        assert merge(mirrored)[0].tolist() == [0, 199]


def test_orientation_alone_splits_a_line() -> None:
    s = np.linspace(0, 100, 401)
    angle = 0.4 * DEG * np.sin(s * 2 * np.pi / 100)
    quaternion = Rotation.from_rotvec(angle[:, None] * [[1, 0, 0]]).as_quat(scalar_first=True)
    quaternion[::2] *= -1  # q and -q are the same
    position = s[:, None] * [[1.0, 0, 0]]
    split = merge(position, quaternion)[0]
    error = angle - np.interp(s, s[split], angle[split])
    assert 0.03 * DEG < np.abs(error).max() <= 0.05 * DEG + 1e-9
    assert merge(position, quaternion, angle=1 * DEG)[0].tolist() == [0, 400]


def test_feed_and_label_split_a_line() -> None:
    position = np.arange(30.0)[:, None] * [[1.0, 0, 0]]
    label = np.repeat([5, 2, 5], 10)
    assert merge(position, label=label)[0].tolist() == [0, 9, 19, 29]
    feed = np.repeat([1.0, 1.1, 1.2], 10)
    assert merge(position, feed=feed)[0].tolist() == [0, 19, 29]
    assert merge(position, feed=feed, feed_share=np.full(30, 0.2))[0].tolist() == [0, 29]


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
