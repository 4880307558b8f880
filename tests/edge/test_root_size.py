"""The root size of each frame, and what is missing at its end."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from workbench.edge.root_size import MIXED, missing_share, smooth_size

Scans = Callable[..., Any]


@pytest.mark.parametrize("share", [0.0, 0.1, 0.3])
def test_share_of_missing_returns(scanned: Scans, share: float) -> None:
    scan = scanned(disturbances={"dropout_share": share})
    found = missing_share(scan.tracked, scan.cloud.pass_index)
    plain = ~scan.tracked.end_is_mixed
    assert np.unique(found[plain]).size == 1
    assert found[plain][0] == pytest.approx(max(share, 0.02), abs=0.03)


def test_a_mixed_pixel_may_have_taken_the_last_returns_place(scanned: Scans) -> None:
    scan = scanned(disturbances={"mixed_pixel_probability": 1.0})
    found = missing_share(scan.tracked, scan.cloud.pass_index)
    assert (found[scan.tracked.end_is_mixed] == MIXED).all()
    assert scan.tracked.end_is_mixed.any() or (found < 0.1).all()


def test_passes_have_their_own_share(scanned: Scans) -> None:
    scan = scanned()
    half = np.arange(len(scan.cloud.keep)) % 2
    thin = scan.tracked.faces[1]
    fewer = replace(thin, count=np.where(half == 1, np.maximum(3, (0.7 * thin.count).astype(int)), thin.count))
    tracked = replace(scan.tracked, faces={**scan.tracked.faces, 1: fewer})
    found = missing_share(tracked, half)
    assert found[half == 1].max() > found[half == 0].max() + 0.15


def test_frames_that_do_not_see_the_end_have_no_size(scanned: Scans) -> None:
    """Cut off by the field of view, or by something in front: nothing is made up."""
    scan = scanned(part={"length_mm": 60.0, "clamps": [{"from_mm": 25.0, "to_mm": 35.0, "height_mm": 6.0}]})
    low = scan.measured.frames.root_low_mm
    assert np.isnan(low[scan.tracked.end_is_cut | ~scan.tracked.seen]).all()
    assert np.isfinite(low).sum() > 150


def test_the_size_runs_smoothly_through_all_passes_and_skips_what_was_not_seen() -> None:
    rng = np.random.default_rng(1)
    s = np.concatenate([np.arange(0, 60, 0.2), np.arange(59.9, 0, -0.2)])
    true = 1.5 + 0.003 * s
    phase = rng.uniform(0, 0.05, s.size)
    low = phase + 0.05 * np.floor((true - phase) / 0.05)
    s[10] = low[20] = np.nan
    same = np.ones(s.size)
    size, slope = smooth_size(s, low, 0.05 * same, 0.003 * same, 0.02 * same, same, np.zeros(s.size, bool))
    hidden = [10, 20]
    assert np.isnan(size[hidden]).all()
    assert np.isnan(slope[hidden]).all()
    good = np.setdiff1d(np.arange(s.size), hidden)
    assert np.abs(size - true)[good].max() < 0.008
    inner = good[(s[good] > 5) & (s[good] < 55)]
    assert slope[inner].mean() == pytest.approx(0.003, abs=2e-4)
