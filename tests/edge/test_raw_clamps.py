"""What stands before the edge is told from the edge by where it stands, not by how much of it there is."""

from __future__ import annotations

import numpy as np
import pytest

from bench.score.measure import named
from workbench.edge.raw_faces import not_in_front
from workbench.units import Bool, Float

WAY = np.arange(0.0, 100.0, 0.25)


def frames(height: Float, seen: Bool | None = None) -> Bool:
    """Which frames are kept, of faces that run along x and stand out along -y by `height` (n,)."""
    middle = np.stack([WAY, -height, np.zeros(WAY.size)], axis=1)
    outward = np.tile([0.0, -1.0, 0.0], (WAY.size, 1))
    return not_in_front(middle, outward, np.ones(WAY.size, bool) if seen is None else seen, np.zeros(WAY.size, int))


@pytest.mark.parametrize("course", [0.0 * WAY, 0.3 * WAY, 3.0 * np.sin(WAY / 20.0), (WAY - 50.0) ** 2 / 600.0])
def test_clamps_are_left_out_of_straight_and_bent_edges(course: Float) -> None:
    clamp = ((WAY > 10) & (WAY < 45)) | ((WAY > 55) & (WAY < 95))
    np.testing.assert_array_equal(frames(course + 6.0 * clamp), ~clamp)


def test_an_edge_without_clamps_is_whole() -> None:
    assert frames(3.0 * np.sin(WAY / 20.0) + np.random.default_rng(1).normal(0, 0.05, WAY.size)).all()


def test_a_shadow_beside_the_clamp_hides_nothing_else() -> None:
    clamp, shadow = (WAY > 40) & (WAY < 60), (WAY > 60) & (WAY < 66)
    kept = frames(0.1 * WAY + 6.0 * clamp, ~shadow)
    np.testing.assert_array_equal(kept, ~clamp & ~shadow)


def test_a_few_stray_frames_behind_do_not_make_the_edge_a_clamp() -> None:
    height = np.zeros(WAY.size)
    height[200:203] = -4.0
    kept = frames(height)
    np.testing.assert_array_equal(kept, height == 0)


@pytest.mark.slow
def test_an_end_that_is_lost_up_to_a_clamp_is_uncertain_by_that() -> None:
    """Three columns lost along the first half, and a clamp where that ends: 0.15 mm off at 7 u before."""
    found = named("swept_raw_mixed", 4_060_001).found["along_m_mm"]
    assert np.abs(found.error).max() > 0.05
    assert (np.abs(found.error) / found.u).max() < 2.0
