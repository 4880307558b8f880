"""Compiled splines against scipy's."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import make_interp_spline

from workbench.geometry.splines import Spline, through


@pytest.mark.parametrize("degree", [1, 2, 3])
@pytest.mark.parametrize("components", [(), (3,)])
def test_as_scipy(degree: int, components: tuple[int, ...]) -> None:
    rng = np.random.default_rng(3)
    places = np.sort(rng.uniform(0.0, 10.0, 12))
    theirs = make_interp_spline(places, rng.normal(size=(12, *components)), k=degree)
    ours = Spline(theirs.t, theirs.c, degree)
    at = np.concatenate([rng.uniform(-2.0, 12.0, 300), places, [np.nan]])
    for order in range(min(degree, 2) + 1):
        np.testing.assert_allclose(ours(at, order), theirs(at, order), rtol=1e-11, atol=1e-11)
    assert np.isnan(ours(at)[-1]).all()
    np.testing.assert_allclose(ours(at.reshape(1, -1), 0)[0], ours(at))


def test_goes_straight_on_beyond_its_ends() -> None:
    theirs = make_interp_spline(np.arange(8.0), np.sin(np.arange(8.0)))
    spline = Spline(theirs.t, theirs.c)
    first, last = spline.ends
    assert (first, last) == (0.0, 7.0)
    at = np.array([first - 3.0, first, 3.3, last, last + 2.0])
    expected = spline(np.clip(at, first, last)) + (at - np.clip(at, first, last)) * spline(np.clip(at, first, last), 1)
    np.testing.assert_allclose(spline.straight_on(at), expected)


@pytest.mark.parametrize("size", [4, 5, 7, 60])
@pytest.mark.parametrize("components", [(), (3,)])
def test_through_values_as_scipy(size: int, components: tuple[int, ...]) -> None:
    rng = np.random.default_rng(size)
    places, values = np.cumsum(rng.uniform(0.2, 3.0, size)), rng.normal(size=(size, *components))
    ours, theirs = through(places, values), make_interp_spline(places, values)
    np.testing.assert_array_equal(ours.t, theirs.t)
    np.testing.assert_allclose(ours.c, theirs.c, rtol=1e-11, atol=1e-11)
