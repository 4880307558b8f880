"""`compare.register`: known motions, open directions, poor fits, covariance over many draws."""

import dataclasses
import json

import numpy as np
import pytest

from tests.compare.bodies import AT, box, scanned
from workbench.api import inverse, pose_from, rotation_from_vector, vector_from_rotation
from workbench.compare import register
from workbench.errors import InputError
from workbench.units import Float

MIDDLE = AT + np.array([20.0, -4.0, -3.0])


def motion(shift_mm: Float, turn: Float) -> Float:
    """A small motion about the body's middle."""
    rotation = rotation_from_vector(np.asarray(turn, float))
    return pose_from(rotation, MIDDLE - rotation @ MIDDLE + shift_mm)


def laid_off(surface, pose: Float):
    """The scan as it is before it is registered: reference_from_scan is `pose`."""
    back = inverse(pose)
    return dataclasses.replace(surface, points_mm=surface.points_mm @ back[:3, :3].T + back[:3, 3])


def error(found: Float, true: Float, pivot_mm: Float) -> Float:
    """What is left, (6,) as in `Registration.covariance`."""
    left = true @ inverse(found)
    return np.r_[left[:3, :3] @ pivot_mm + left[:3, 3] - pivot_mm, vector_from_rotation(left[:3, :3])]


def test_a_corner_fixes_all_six() -> None:
    true = motion([0.4, -0.3, 0.5], [0.01, -0.008, 0.012])
    found, document = register(laid_off(scanned(1, "corner"), true), scanned(2, "corner"))
    left = error(found.reference_from_scan, true, found.pivot_mm)
    assert np.abs(left[:3]).max() < 2e-3
    assert np.abs(left[3:]).max() < 5e-4
    assert found.held == ()
    assert found.overlap > 0.9
    content = json.loads(document.content)
    assert content["held"] == []
    np.testing.assert_allclose(content["reference_from_scan"], found.reference_from_scan)


def test_an_initial_pose_reaches_far() -> None:
    """40 deg and 100 mm away, with a start that is roughly right."""
    true = motion([100.0, 20.0, -30.0], [0.1, 0.2, 0.7])
    start = motion([100.3, 19.8, -30.2], [0.1, 0.205, 0.705])
    found, _ = register(laid_off(scanned(1, "corner"), true), scanned(2, "corner"), initial=start.tolist())
    assert np.abs(error(found.reference_from_scan, true, found.pivot_mm)[:3]).max() < 3e-3


@pytest.mark.parametrize("reference", [scanned(2, "corner"), box()], ids=["scan", "mesh"])
def test_features_find_the_start(reference) -> None:
    """150 deg and half a metre away, with nothing known."""
    true = motion([400.0, 200.0, -300.0], [0.5, -1.2, 2.2])
    scan = laid_off(scanned(1, "corner"), true)
    scan = dataclasses.replace(scan, range_axis=true[:3, :3].T @ scan.range_axis)
    found, _ = register(scan, reference, start="features")
    assert np.abs(error(found.reference_from_scan, true, found.pivot_mm)[:3]).max() < 3e-3
    with pytest.raises(InputError, match="expected no initial pose"):
        register(scanned(1, "corner"), scanned(2, "corner"), start="features", initial=np.eye(4).tolist())


def test_a_straight_edge_slides_and_is_refused() -> None:
    with pytest.raises(InputError, match=r"sliding along the edge by \(1\.00, -?0\.00, -?0\.00\)"):
        register(scanned(1), scanned(2))


def test_held_directions_stay_at_the_initial_pose() -> None:
    """Across the edge it is fitted, along it the start stays, with its stated uncertainty."""
    true = motion([0.0, 0.3, -0.2], [0.004, 0.003, 0.002])
    found, _ = register(laid_off(scanned(1), true), scanned(2), open_directions="hold", held_u_mm=0.7)
    left = error(found.reference_from_scan, true, found.pivot_mm)
    assert np.abs(left[:3]).max() < 3e-3
    assert np.sqrt(found.covariance[0, 0]) == pytest.approx(0.7, rel=1e-3)
    assert np.sqrt(np.diagonal(found.covariance)[1:3]).max() < 2e-3
    assert "sliding along the edge" in found.held[0]
    assert found.warnings


def test_covariance_holds_over_draws() -> None:
    """Errors against their covariance over 20 draws, with noise of points and frames."""
    square, parts = [], []
    for seed in range(20):
        true = motion(*np.random.default_rng(seed).normal(0.0, [[0.2], [0.003]], (2, 3)))
        mine, other = (scanned(2 * seed + k, "corner", frame_noise_mm=0.01) for k in (0, 1))
        found, _ = register(laid_off(mine, true), other)
        left = error(found.reference_from_scan, true, found.pivot_mm)
        square.append(left @ np.linalg.solve(found.covariance, left))
        parts.append(left**2 / np.diagonal(found.covariance))
    assert 3.5 < np.mean(square) < 9.0  # six degrees of freedom: 6, and 0.77 the standard deviation of this mean
    assert np.all(np.sqrt(np.mean(parts, axis=0)) < 1.4)
    assert np.all(np.sqrt(np.mean(parts, axis=0)) > 0.5)


def test_another_part_is_refused() -> None:
    """Far off: no overlap; near, but of another shape: a poor fit or a small overlap; the reason in words."""
    far = laid_off(scanned(1, "corner"), motion([0.0, 0.0, 50.0], [0.0, 0.0, 0.0]))
    with pytest.raises(InputError, match="of the scan lies on the reference"):
        register(far, scanned(2, "corner"))
    with pytest.raises(InputError, match=r"does not fit|lies on the reference"):
        register(scanned(1, "corner", noise_mm=0.03), scanned(2, "corner", noise_mm=0.03), largest_rms_mm=0.005)
    with pytest.raises(InputError, match="places are flat"):
        register(scanned(1, "corner", noise_mm=0.3), scanned(2, "corner"))


def test_an_initial_pose_that_is_none_is_refused() -> None:
    with pytest.raises(InputError, match="rigid motion"):
        register(scanned(1), scanned(2), initial=(2 * np.eye(4)).tolist())
