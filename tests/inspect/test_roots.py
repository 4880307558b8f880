"""Root faces along edges whose sizes and noise are known."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from workbench.artefacts import Edge
from workbench.inspect.angles import BevelAngles, bevel_angles
from workbench.inspect.roots import root_sizes
from workbench.units import DEG, Float

AT = (np.arange(9) + 0.5) * 10.0
Maker = Callable[..., Edge]


def course(s: Float) -> Float:
    return np.asarray(1.4 + 0.2 * s / 90 + 0.05 * np.sin(2 * np.pi * s / 100))


def exact(at: Float, local_u: float = 0.0, tilt_u: float = 0.0) -> BevelAngles:
    same = np.ones(at.size)
    return BevelAngles(40 * DEG * same, np.hypot(local_u, tilt_u) * same, local_u * same, tilt_u * same, 0.0, 0.0)


def test_the_size_follows_the_root_face_along_the_edge(edge: Maker) -> None:
    part = edge(1, root=course)
    found = root_sizes(part, AT, bevel_angles(part, AT, 10.0))
    np.testing.assert_allclose(found.root_mm, course(AT), rtol=0, atol=0.005)
    assert (found.u_mm < 0.005).all()


def test_coverage(edge: Maker) -> None:
    inside, ratio = [], []
    for seed in range(30):
        found = root_sizes(edge(seed, root=course), AT, exact(AT))
        error = found.root_mm - course(AT)
        inside += list(np.abs(error) <= 2 * found.u_mm)
        ratio += list(error / found.u_mm)
    assert 0.88 < np.mean(inside) < 0.995
    assert 0.7 < np.sqrt(np.mean(np.square(ratio))) < 1.3


def test_errors_of_the_angles_move_the_corner(edge: Maker) -> None:
    """The bevel's by its lever over the sine of the angle, the tilt's by half the root face times the cotangent."""
    part, none = edge(2), root_sizes(edge(2), AT, exact(AT))
    bevel = root_sizes(part, AT, exact(AT, local_u=0.002))
    expected = 4.0 / np.sin(40 * DEG) * 0.002
    np.testing.assert_allclose(np.sqrt(bevel.u_mm**2 - none.u_mm**2), expected, rtol=1e-6)
    tilt = root_sizes(part, AT, exact(AT, tilt_u=0.01))
    expected = 0.5 * none.root_mm / np.tan(40 * DEG) * 0.01
    np.testing.assert_allclose(np.sqrt(tilt.u_mm**2 - none.u_mm**2), expected, rtol=1e-6)
    np.testing.assert_array_equal(bevel.root_mm, none.root_mm)


def test_all_passes_count_together(edge: Maker) -> None:
    one, two = (root_sizes(edge(3, passes=n), AT, exact(AT)) for n in (1, 2))
    assert np.median(two.u_mm) < 0.85 * np.median(one.u_mm)
    np.testing.assert_allclose(two.root_mm, 1.5, rtol=0, atol=0.004)


def test_frames_that_do_not_show_the_end_are_left_out(edge: Maker) -> None:
    part = edge(4)
    low = part.frames.root_low_mm.copy()
    low[::3] = np.nan
    some = root_sizes(replace(part, frames=replace(part.frames, root_low_mm=low)), AT, exact(AT))
    np.testing.assert_allclose(some.root_mm, 1.5, rtol=0, atol=0.004)
    whole = root_sizes(part, AT, exact(AT))
    assert np.median(some.u_mm) > 1.05 * np.median(whole.u_mm)


def test_hidden_stretches(edge: Maker) -> None:
    at = np.array([10.0, 45.0, 80.0])
    found = root_sizes(edge(5, hidden_mm=(15.0, 75.0)), at, exact(at))
    np.testing.assert_array_equal(np.isfinite(found.root_mm), [True, False, True])
    assert found.root_mm[2] == pytest.approx(1.5, abs=0.005)
