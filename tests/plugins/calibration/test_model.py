"""The measurement model against plain geometry, differences and simulation."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest

from tests.plugins.calibration.conftest import (
    CENTER,
    RADIUS,
    TRUE,
    cell,
    circles,
    postures,
    recording,
)
from workbench.api import rotation_from_vector
from workbench.plugins.calibration import circles as measured
from workbench.plugins.calibration.model import (
    Estimate,
    Noise,
    View,
    information,
    linearise,
    volume_u,
)
from workbench.plugins.calibration.observations import from_arrays
from workbench.plugins.calibration.plan import circle_covariance, optics_of

TRUTH = Estimate(TRUE[:3, :3], TRUE[:3, 3], CENTER, RADIUS)
EXACT = Noise(0.0, 0.0)


def exact(rng: np.random.Generator, k: int = 8) -> Any:
    turns, centre = postures(rng, k)
    made = cell(rng, turns, centre, 0.0, 0.0)
    return from_arrays(*circles(rng, made, 1e-9), made.poses), centre


def test_predicts_what_the_plane_cuts_out_of_the_sphere(rng: np.random.Generator) -> None:
    seen, centre = exact(rng)
    linear = linearise(TRUTH, seen, EXACT)
    np.testing.assert_allclose(linear.centre, centre, atol=1e-9)
    np.testing.assert_allclose(linear.residual, 0.0, atol=1e-7)


def test_jacobian_is_the_derivative(rng: np.random.Generator) -> None:
    seen, _ = exact(rng)
    linear = linearise(TRUTH, seen, EXACT)
    for unknown in range(10):
        step = np.zeros(10)
        step[unknown] = 1e-6
        ahead, behind = (linearise(TRUTH.moved(s * step), seen, EXACT).residual for s in (1, -1))
        np.testing.assert_allclose(linear.jacobian[..., unknown], (behind - ahead) / 2e-6, atol=1e-5)


def test_covariance_is_that_of_noisy_poses(rng: np.random.Generator) -> None:
    """Poses drawn 20,000 times: mean and covariance of what the plane cuts out."""
    turns, centre = postures(rng, 1, off_plane=0.5)
    centre[0] = [4.0, 0.6, -7.0]
    noise = Noise(0.2, 0.05)
    made = cell(rng, np.repeat(turns, 20_000, axis=0), np.repeat(centre, 20_000, axis=0), 0.2, 0.05)
    around = linearise(TRUTH, from_arrays(np.zeros((20_000, 3)), np.zeros((20_000, 3, 3)), made.poses), EXACT)
    seen = from_arrays(np.zeros((1, 3)), np.zeros((1, 3, 3)), made.true_poses[:1])
    linear = linearise(TRUTH, seen, noise)
    np.testing.assert_allclose(-linear.residual[0], -around.residual.mean(axis=0), atol=0.012)
    np.testing.assert_allclose(linear.covariance[0], np.cov(around.residual.T), atol=0.06 * linear.covariance[0].max())


@pytest.mark.parametrize("sense", [-1, 1])
def test_a_planned_circle_is_known_as_a_measured_one(rng: np.random.Generator, sense: int) -> None:
    shown = recording(rng, cell(rng, *postures(rng, 20)), sense=sense)
    found = measured(shown)
    u = np.sqrt(np.diagonal(found.covariance, axis1=1, axis2=2))
    relative = circle_covariance(found.circle[:, 2], optics_of(found, shown)) - found.covariance
    assert np.abs((relative / u[:, :, None] / u[:, None]).mean(axis=0)).max() < 0.12


def test_volume_u_is_the_rms_over_the_field(rng: np.random.Generator) -> None:
    A = rng.normal(size=(6, 6)) * np.repeat([0.1, 0.005], 3)[:, None]
    covariance = A @ A.T
    points = np.column_stack([rng.uniform(-1, 1, 4000) * 16 + 4, np.zeros(4000), rng.uniform(-1, 1, 4000) * 20 - 2])
    draws = rng.multivariate_normal(np.zeros(6), covariance * 1e-6, 4000)  # small: the figure is of first order
    moved = (rotation_from_vector(draws[:, 3:]) @ (points @ TRUE[:3, :3].T)[..., None])[..., 0] + draws[:, :3]
    error = np.sqrt(np.mean(np.sum((moved - points @ TRUE[:3, :3].T) ** 2, axis=1))) * 1e3
    assert volume_u(covariance, TRUTH.rotation, View((4.0, -2.0), (16.0, 20.0))) == pytest.approx(error, rel=0.03)


def test_volume_u_does_not_depend_on_where_z_is_zero(rng: np.random.Generator) -> None:
    seen, _ = exact(rng)
    here = np.linalg.inv(information(TRUTH, seen, Noise()))[:6, :6]
    shift = np.array([0.0, 0.0, 300.0])
    there = dataclasses.replace(TRUTH, translation_mm=TRUTH.translation_mm - TRUE[:3, :3] @ shift)
    moved = dataclasses.replace(seen, circle=seen.circle + np.array([0.0, 300.0, 0.0]))
    other = np.linalg.inv(information(there, moved, Noise()))[:6, :6]
    assert volume_u(other, there.rotation, View((0.0, 300.0), (16.0, 20.0))) == pytest.approx(
        volume_u(here, TRUTH.rotation, View((0.0, 0.0), (16.0, 20.0))), rel=1e-6
    )
