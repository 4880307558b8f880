"""Bevel angles along edges whose angles, noise and root face are known."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from workbench.artefacts import Edge
from workbench.inspect.angles import bevel_angles
from workbench.units import DEG, Float

AT = (np.arange(9) + 0.5) * 10.0
Maker = Callable[..., Edge]


def course(s: Float) -> Float:
    """40 deg, drifting by 1 deg and waving by 0.3 deg."""
    return np.asarray((40 + s / 90 + 0.3 * np.sin(2 * np.pi * s / 90)) * DEG)


def test_the_angle_follows_the_bevel_along_the_edge(edge: Maker) -> None:
    found = bevel_angles(edge(1, bevel=course, root_noise=1e-6), AT, 10.0)
    np.testing.assert_allclose(found.bevel, course(AT), rtol=0, atol=0.07 * DEG)


@pytest.mark.parametrize("stated", [1.0, 0.4])
def test_coverage(edge: Maker, stated: float) -> None:
    """Within 2u in about 95 of 100 parts, also where the frames' variances say too little: their scatter says more."""
    inside, ratio = [], []
    for seed in range(120):
        found = bevel_angles(edge(seed, bevel=course, stated=stated, length_mm=90.0), AT[seed % 9 :: 4], 10.0)
        error = found.bevel - course(AT[seed % 9 :: 4])
        inside += list(np.abs(error) <= 2 * found.u)
        ratio += list(error / found.u)
    assert 0.88 < np.mean(inside) < 0.99
    assert 0.8 < np.sqrt(np.mean(np.square(ratio))) < 1.25


def test_what_is_shared_and_what_is_each_places_own(edge: Maker) -> None:
    """All sections share the root face's error, here by far the greater part: they err together."""
    together, apart, tilt_u, local_u = [], [], [], []
    for seed in range(60):
        found = bevel_angles(edge(seed, root_noise=0.05), AT, 10.0)
        error = found.bevel - 40 * DEG
        together.append(error.mean())
        apart.append(error - error.mean())
        tilt_u.append(found.tilt_u)
        local_u.append(found.local_u)
        assert found.tilt_variation == 0
    assert np.std(together) == pytest.approx(np.mean(tilt_u), rel=0.25)
    assert np.mean(tilt_u) == pytest.approx(0.05 / np.sqrt(451), rel=0.1)
    assert np.std(apart) == pytest.approx(np.mean(local_u), rel=0.15)


def test_two_passes_halve_the_variance(edge: Maker) -> None:
    one, two = (bevel_angles(edge(3, passes=n, root_noise=0.05), AT, 10.0) for n in (1, 2))
    np.testing.assert_allclose(one.u / two.u, np.sqrt(2), rtol=0.1)
    np.testing.assert_allclose(two.bevel, 40 * DEG, rtol=0, atol=3.5 * two.u.max())


def test_the_tangents_uncertainty_counts_by_its_leverage(edge: Maker) -> None:
    plain = bevel_angles(edge(4, tangent_u=0.001), AT, 10.0)
    oblique = bevel_angles(edge(4, tangent_u=0.001, tangent_leverage=0.2), AT, 10.0)
    np.testing.assert_allclose(oblique.u**2 - plain.u**2, (0.2 * 0.001) ** 2, rtol=1e-6)
    np.testing.assert_array_equal(oblique.bevel, plain.bevel)


def test_stray_frames_count_for_nothing(edge: Maker) -> None:
    found = bevel_angles(edge(5, stray_share=0.05, root_noise=1e-6), AT, 10.0)
    np.testing.assert_allclose(found.bevel, 40 * DEG, rtol=0, atol=0.07 * DEG)
    assert (found.u < 0.03 * DEG).all()


def test_a_root_face_that_turns_along_the_edge_makes_every_angle_less_certain(edge: Maker) -> None:
    def turning(s: Float) -> Float:
        return np.asarray(0.3 + 1.0 * DEG * np.sin(2 * np.pi * s / 90))

    steady, varying = (bevel_angles(edge(6, tilt=tilt), AT, 10.0) for tilt in (lambda s: 0.3 + 0 * s, turning))
    assert steady.tilt_variation == 0
    assert varying.tilt_variation == pytest.approx(1.0 * DEG / np.sqrt(2), rel=0.35)
    assert (varying.u >= varying.tilt_variation).all()
    assert (steady.u < 0.3 * varying.u).all()


def test_a_steady_root_face_is_hardly_ever_said_to_turn(edge: Maker) -> None:
    assert sum(bevel_angles(edge(seed), AT[:1], 10.0).tilt_variation > 0 for seed in range(60)) <= 1


def test_roughness_is_averaged_a_drift_is_not(edge: Maker) -> None:
    """A rough face's direction wanders about its mean, which u then tells how well is known."""
    once, far = np.arange(0, 90.1, 0.2), []
    for seed in range(40):
        rng = np.random.default_rng(seed)
        kernel = np.exp(-np.abs(np.arange(-30, 30.1, 0.2)) / 5.0)
        wander = 0.5 * DEG * np.convolve(rng.normal(0, 1, once.size + kernel.size - 1), kernel / 5.0, "valid")
        rough = bevel_angles(edge(seed, tilt=lambda s, w=wander: 0.3 + np.interp(s, once, w)), AT[:1], 10.0)
        far.append(wander.mean() / rough.tilt_u[0])  # truth: the direction about which it wanders
    assert 0.8 < np.mean(np.abs(far) <= 2) < 1
    assert np.std(far) > 0.6  # not safe for being huge


def test_hidden_stretches(edge: Maker) -> None:
    """NaN where no frame lies within the half width; less certain beside it than far away."""
    found = bevel_angles(edge(7, hidden_mm=(30.0, 60.0)), np.array([10.0, 31.0, 45.0, 59.0]), 10.0)
    np.testing.assert_array_equal(np.isfinite(found.bevel), [True, True, False, True])
    for name in ("u", "local_u", "tilt_u"):
        np.testing.assert_array_equal(np.isfinite(getattr(found, name)), np.isfinite(found.bevel))
    assert found.local_u[1] > 1.3 * found.local_u[0]


def test_one_pass_fills_in_for_another(edge: Maker) -> None:
    both = edge(8, passes=2, root_noise=1e-6)
    hide = (both.pass_index == 1) & (np.abs(both.frames.bevel_arc_length_mm - 45) < 15)
    both.frames.bevel_angle[hide] = np.nan
    found = bevel_angles(both, np.array([10.0, 45.0]), 10.0)
    assert np.isfinite(found.bevel).all()
    assert found.u[1] > 1.2 * found.u[0]


def test_angles_are_counted_the_short_way_round(edge: Maker) -> None:
    """Directions in the section plane may pass from pi to -pi between root face and bevel face."""
    plain = bevel_angles(edge(9), AT, 10.0)
    turned = edge(9)
    for name in ("tilt", "root_angle", "bevel_angle"):
        angle = getattr(turned.frames, name)
        angle[:] = np.angle(np.exp(1j * (angle + np.pi - 0.3 + 0.2)))
    found = bevel_angles(turned, AT, 10.0)
    np.testing.assert_allclose(found.bevel, plain.bevel, rtol=0, atol=1e-9)
    np.testing.assert_allclose(found.u, plain.u, rtol=1e-6)
