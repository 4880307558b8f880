"""Times of a path: length over the feed towards each point."""

from __future__ import annotations

import numpy as np
import pytest

from workbench.geometry.feeds import step_lengths_mm, step_times_s, travel_time_s

CORNERS = np.array([[0.0, 0.0, 0.0], [3.0, 4.0, 0.0], [3.0, 4.0, 12.0], [3.0, 4.0, 12.0]])


def test_each_step_is_run_at_the_feed_towards_its_point():
    feed = np.array([99.0, 2.0, 4.0, 1.0])  # the first counts nothing: the robot is there
    np.testing.assert_allclose(step_lengths_mm(CORNERS), [0.0, 5.0, 12.0, 0.0])
    np.testing.assert_allclose(step_times_s(CORNERS, feed), [0.0, 2.5, 3.0, 0.0])
    assert travel_time_s(CORNERS, feed) == pytest.approx(5.5)


@pytest.mark.parametrize("count", [0, 1])
def test_a_path_without_steps_takes_no_time(count):
    assert travel_time_s(CORNERS[:count], np.ones(count)) == 0.0
