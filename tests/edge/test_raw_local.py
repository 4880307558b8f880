"""The local mean of a rough face where a scan leaves some of it out."""

from __future__ import annotations

import numpy as np
import pytest

from workbench.edge.raw_local import local_mean
from workbench.units import Float

STEP_MM, LENGTH_MM = 0.25, 110.0


def _waves(rng: np.random.Generator, s: Float) -> Float:
    """Forty waves of 0.7 to 20 mm, the shorter the lower."""
    length = np.exp(rng.uniform(np.log(0.7), np.log(20.0), 40))
    phase = rng.uniform(0.0, 2.0 * np.pi, 40)
    return np.asarray((np.sqrt(length) * np.cos(2.0 * np.pi * s[:, None] / length + phase)).sum(axis=1))


def _smooth(rng: np.random.Generator, s: Float) -> Float:
    """Noise through a Gaussian 1.5 mm wide."""
    width = round(1.5 / STEP_MM)
    kernel = np.exp(-0.5 * (np.arange(-4 * width, 4 * width + 1) / width) ** 2)
    return np.convolve(rng.normal(size=s.size + kernel.size - 1), kernel, mode="valid")


@pytest.mark.parametrize("rough", [_waves, _smooth], ids=lambda rough: rough.__name__)
def test_u_holds_the_mean_over_a_window_that_is_seen_in_part(rough) -> None:
    """The scan leaves out 4 mm at either end and 15 mm under a clamp, of a face that hangs together by millimetres."""
    rng = np.random.default_rng(5)
    s = np.arange(0.0, LENGTH_MM, STEP_MM)
    seen = (s > 4.0) & (s < LENGTH_MM - 4.0) & ~((s > 60.0) & (s < 75.0))
    at = np.array([5.0, 9.0, 55.0, 59.0, 76.0, 80.0, LENGTH_MM - 9.0, LENGTH_MM - 5.0])
    off, u, by_seen = [], [], []
    for _ in range(25):
        value = rough(rng, s)
        course = local_mean(s[seen], value[seen], np.zeros(int(seen.sum()), np.int64))
        window = np.abs(s[None, :] - at[:, None]) <= 10.0
        true = (window * value).sum(axis=1) / window.sum(axis=1)
        off.append(course.value(at) - true)
        u.append(course.u(at))
        by_seen.append((window * seen * value).sum(axis=1) / (window * seen).sum(axis=1) - true)
    ratio = np.abs(np.array(off)) / np.array(u)
    assert (ratio <= 2.0).mean() > 0.93
    assert ratio.max() < 4.0
    assert np.median(ratio) > 0.35
    assert np.square(off).sum() < np.square(by_seen).sum()  # what is seen tells of what is not
    assert np.square(u).sum() < 2.5 * np.square(off).sum()


def test_a_face_on_a_straight_line_is_known_wherever_the_scan_ends() -> None:
    s = np.arange(0.0, 60.0, STEP_MM)
    course = local_mean(s, 0.02 * s - 0.3, np.zeros(s.size, np.int64))
    at = np.array([0.5, 10.0, 30.0, 59.5])
    assert np.abs(course.value(at) - 0.02 * at + 0.3).max() < 0.002  # a tenth of a cell: frames stand where they stand


def test_a_scan_shorter_than_a_window_is_measured() -> None:
    s = np.arange(0.0, 7.0, STEP_MM)
    course = local_mean(s, _smooth(np.random.default_rng(2), s), np.zeros(s.size, np.int64))
    assert np.isfinite(course.u(s)).all()
    assert (course.u(s) > 0.0).all()
