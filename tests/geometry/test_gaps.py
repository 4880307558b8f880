"""Which places count as measured: between frames that are near enough to each other, in any pass."""

from __future__ import annotations

import numpy as np

from workbench.geometry.curves import GAP_PITCHES, LEAST_GAP_MM, covered
from workbench.units import Bool, Float


def one_pass(s: Float, at: Float) -> list[bool]:
    return list(covered(s, np.zeros(s.size, int), at))


def test_between_frames_and_not_beyond_them() -> None:
    s = np.arange(0.0, 10.01, 0.2)
    assert one_pass(s, np.array([-0.1, 0.0, 5.03, 10.0, 10.1])) == [False, True, True, True, False]


def test_a_gap_is_hidden_and_its_rims_are_seen() -> None:
    s = np.concatenate([np.arange(0.0, 4.01, 0.2), np.arange(6.0, 10.01, 0.2)])
    assert one_pass(s, np.array([3.99, 4.01, 5.0, 5.99, 6.01])) == [True, False, False, False, True]


def test_how_wide_a_gap_may_be() -> None:
    """A few frames lost are no gap: up to the least gap of a dense scan, up to some pitches of a coarse one."""
    for pitch, widest in ((0.1, LEAST_GAP_MM), (1.0, GAP_PITCHES)):
        s = np.arange(40.0) * pitch
        for stretch, seen in ((0.98 * widest, True), (1.02 * widest, False)):
            torn = np.concatenate([s, s[-1] + stretch + s])
            assert one_pass(torn, np.array([s[-1] + 0.5 * stretch])) == [seen]


def test_order_of_frames_and_frames_without_the_edge_do_not_matter() -> None:
    rng = np.random.default_rng(1)
    s = np.concatenate([np.arange(0.0, 4.0, 0.2), np.arange(7.0, 10.0, 0.2), np.full(5, np.nan)])
    at = np.linspace(-1, 11, 60)
    number = np.zeros(s.size, int)
    shuffled: Bool = covered(rng.permutation(s), number, at)
    np.testing.assert_array_equal(shuffled, covered(s, number, at))
    assert 0 < shuffled.sum() < at.size


def test_another_pass_closes_a_gap_only_if_it_spans_it() -> None:
    """Passes are not mixed: frames of two passes side by side do not make each other's gaps narrow."""
    s = np.concatenate([np.arange(0.0, 4.1, 0.2), np.arange(6.0, 10.1, 0.2)])
    at = np.array([5.0])
    across, beside, alone = np.arange(4.5, 5.6, 0.2), np.array([3.6, 3.8, 4.0, 6.0]), np.array([5.0])
    for more, seen in ((across, True), (beside, False), (alone, False)):
        number = np.concatenate([np.full(s.size, 3), np.full(more.size, -1)])
        assert covered(np.concatenate([s, more]), number, at)[0] == seen


def test_nothing_seen() -> None:
    assert one_pass(np.full(4, np.nan), np.array([0.0, 1.0])) == [False, False]
