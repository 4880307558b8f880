"""Profiles that show the order in which they were taken are told from those that do not."""

from __future__ import annotations

import numpy as np
import pytest

from workbench.edge.frame_order import scatter, shows_order

N = 300
S = np.arange(float(N))
ONE_PASS = np.zeros(N, int)


@pytest.mark.parametrize("digit", [0.0, 0.7])
def test_what_drifts_shows_the_order_and_what_is_shuffled_does_not(digit: float) -> None:
    rng = np.random.default_rng(5)
    still = rng.normal(size=(N, 4))
    drifting = still + np.array([0.0, 0.0, 0.0, 4.0]) * (S / N)[:, None]
    if digit:
        still, drifting = (np.round(one / digit) * digit for one in (still, drifting))
    assert not shows_order(still, S, ONE_PASS)
    assert shows_order(drifting, S, ONE_PASS)
    assert not shows_order(rng.permutation(drifting), S, ONE_PASS)


def test_the_order_is_that_along_the_edge_not_that_of_the_rows() -> None:
    mixed = np.random.default_rng(2).permutation(N)
    assert shows_order((S / N)[mixed, None], S[mixed], ONE_PASS)


def test_few_frames_and_lost_ones_show_nothing() -> None:
    assert not shows_order(S[:20, None], S[:20], ONE_PASS[:20])
    assert not shows_order(np.full((N, 1), np.nan), S, ONE_PASS)


def test_scatter_is_what_the_noise_does_not_explain() -> None:
    left = np.random.default_rng(0).normal(0.0, 0.05, 4000)
    assert scatter(left, np.full(4000, 0.03**2)) == pytest.approx(0.04, rel=0.06)
    assert scatter(left, np.full(4000, 0.06**2)) == 0.0
    assert scatter(np.full(3, np.nan), np.ones(3)) == 0.0
